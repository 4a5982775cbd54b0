// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "m4gnDictionary.H"

using testing::dict;

TEST(entriesBecomeJson)
{
    EXPECT_TEXT(
        m4gn::json(dict("a 1; b -2.5; c yes; d off; e word; f \"two words\"; g { h 3; }")),
        "{\"a\": 1, \"b\": -2.5, \"c\": true, \"d\": false, \"e\": \"word\","
        " \"f\": \"two words\", \"g\": {\"h\": 3}}");
}

TEST(listsBecomeJson)
{
    EXPECT_TEXT(
        m4gn::json(dict("a (1 2 3); b 2(x y); c (); d ((0 (1 2)) (3 (4 5))); e List<word> 2 (u v);")),
        "{\"a\": [1, 2, 3], \"b\": [\"x\", \"y\"], \"c\": [],"
        " \"d\": [[0, [1, 2]], [3, [4, 5]]], \"e\": [\"u\", \"v\"]}");
}

TEST(severalWordsBecomeOneText)
{
    EXPECT_TEXT(m4gn::json(dict("a Gauss linear 0.5;")), "{\"a\": \"Gauss linear 0.5\"}");
}

TEST(numbersKeepTheirDigits)
{
    EXPECT_TEXT(m4gn::text(0.1), "0.10000000000000001");
    EXPECT(std::stod(m4gn::text(1.0 / 3)) == 1.0 / 3);
    EXPECT(std::stod(m4gn::text(-1.2345678901234567e-200)) == -1.2345678901234567e-200);
}

TEST(quotesAreEscaped) { EXPECT_TEXT(m4gn::quoted("a \"b\" \\ c\nd"), "\"a \\\"b\\\" \\\\ c d\""); }

TEST(anUnknownEntryIsNamed)
{
    EXPECT_REFUSED(m4gn::checkKeys(dict("model a; tua 3;"), {"model", "tau"}, false), "Unknown entry tua");
    EXPECT_REFUSED(m4gn::checkKeys(dict("tua 3;"), {"model", "tau"}, false), "Valid entries: model, tau");
    m4gn::checkKeys(dict("model a; libs (b);"), {"model"}, true);
    EXPECT_REFUSED(m4gn::checkKeys(dict("libs (b);"), {"model"}, false), "Unknown entry libs");
}

TEST(aLimitIsKept)
{
    m4gn::checkAtLeast(dict("n 1;"), "n", 1, 1);
    EXPECT_REFUSED(m4gn::checkAtLeast(dict("n 0;"), "n", 0, 1), "Entry n");
    const scalar none = std::numeric_limits<scalar>::quiet_NaN();
    EXPECT_REFUSED(m4gn::checkAtLeast(dict("n 0;"), "n", none, 1), "expected at least 1");
}

TEST(noneIsNoDictionary)
{
    EXPECT(m4gn::isNone(dict("relaxation none;"), "relaxation", "example"));
    EXPECT(!m4gn::isNone(dict("relaxation { time 1; }"), "relaxation", "example"));
    EXPECT(!m4gn::isNone(dict(""), "relaxation", "example"));
    EXPECT_REFUSED(
        m4gn::isNone(dict("relaxation off;"), "relaxation", "example"), "expected none, or example");
}

TEST(aSchemeIsItsFirstWordButBounded)
{
    const dictionary schemes(dict("ddtSchemes { default Euler; ddt(U) bounded backward; ddt(D) NewmarkBeta "
                                  "0.25 0.5; ddt(k) CrankNicolson"
                                  " ocCoeff { type scale; scale linearRamp; duration 0.01; value 0.9; }; }"));
    EXPECT_TEXT(m4gn::scheme(schemes, "ddtSchemes", "ddt(k)"), "CrankNicolson");
    EXPECT_TEXT(m4gn::scheme(schemes, "ddtSchemes", "ddt(U)"), "backward");
    EXPECT_TEXT(m4gn::scheme(schemes, "ddtSchemes", "ddt(D)"), "NewmarkBeta");
    EXPECT_TEXT(m4gn::scheme(schemes, "ddtSchemes", "ddt(T)"), "Euler");
    EXPECT_TEXT(m4gn::scheme(schemes, "d2dt2Schemes", "d2dt2(D)"), "");
}
