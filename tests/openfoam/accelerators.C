// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "m4gnExtrapolate.H"
#include "m4gnPredictorChoice.H"
#include "m4gnSolveHistory.H"

using testing::caseFolder;
using testing::dict;

// t^2 at 1, 2 and 4: the change from 4 to 7 is 33
TEST(aParabolaIsExtrapolatedExactly)
{
    const scalarField rate(1, (16.0 - 4)/2), before(1, (4.0 - 1)/1);
    const tmp<scalarField> change(m4gn::parabola<scalar>(3, 2, rate, before, -(2.0 + 1)));
    EXPECT_NEAR(change()[0], 33, 1e-12);
}

TEST(autoFindsTheCheapestGuess)
{
    m4gnPredictorChoice choice(dict("predictor auto;"));
    label linear = 0;
    for (label step = 0; step < 100; ++step)
    {
        const auto used = choice.used();
        linear += used == m4gnPredictorChoice::LINEAR;
        choice.next(used == m4gnPredictorChoice::LINEAR ? 10 : 20);
    }
    // All but the trials of the others
    EXPECT(linear > 70 && linear < 100);
    EXPECT(!choice.never());
}

TEST(autoGuessesNothingThatSavesNothing)
{
    m4gnPredictorChoice choice(dict(""));
    label none = 0;
    for (label step = 0; step < 100; ++step)
    {
        const auto used = choice.used();
        none += used == m4gnPredictorChoice::NONE;
        choice.next(used == m4gnPredictorChoice::NONE ? 20 : 19.5);
    }
    EXPECT(none > 70);
}

TEST(aPredictorThatIsGivenStays)
{
    m4gnPredictorChoice choice(dict("predictor quadratic;"));
    choice.next(1000);
    EXPECT(choice.used() == m4gnPredictorChoice::QUADRATIC);
    EXPECT(m4gnPredictorChoice(dict("predictor none;")).never());
    EXPECT_REFUSED
    (
        m4gnPredictorChoice::check(dict("predictor cubic;")),
        "Entry predictor is cubic; expected linear, none, quadratic, auto"
    );
}

// A solve that changes the unknown by 1, 2, 3, ...: 2 d1 - d0 is the next
TEST(solvesOfATimeStepAreExtrapolated)
{
    caseFolder run;
    const dictionary controls(dict("predictor quadratic;"));
    m4gnSolveHistory& history = m4gnSolveHistory::of("p", run.time(), controls);
    EXPECT(&history == &m4gnSolveHistory::of("p", run.time(), controls));

    for (label step = 1; step <= 3; ++step)
    {
        ++run.time();
        history.begin(scalarField(2, scalar(step)));
        const tmp<scalarField> guess(history.guess());
        EXPECT(guess.valid() == (step == 3));
        if (step == 3)
        {
            EXPECT_NEAR(guess()[1], 3, 1e-12);
        }
        history.end(scalarField(2, scalar(step)), 5);
        // No earlier time step had a second solve
        EXPECT(!history.guess().valid());
    }

    // Nothing is known of what follows a gap
    run.time() += 1;
    ++run.time();
    history.begin(scalarField(2, 4.0));
    EXPECT(!history.guess().valid());
}
