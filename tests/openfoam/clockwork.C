// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "m4gnClockwork.H"

//- Written each 0.3 s from 0 on; carried on at 0.5 with steps of 0.08
TEST(timesToWriteGoOnFromBetweenTwoOfThem)
{
    const dictionary control(
        testing::dict("startFrom startTime; startTime 0.5; stopAt endTime; endTime 2; deltaT 0.08;"
                      " writeControl adjustableRunTime; writeInterval 0.3; writeFormat ascii;"));
    Time time(control, "/tmp", "m4gnClockwork");
    const scalar from = m4gnClockwork::carryOn(time, 0);
    EXPECT_NEAR(from, 0.3, 1e-12);

    // The first step is as long as it takes
    const auto usual = m4gnClockwork::toNext(time, from);
    time.setDeltaT(0.08);
    ++time;
    EXPECT_NEAR(time.value(), 0.6, 1e-12);
    EXPECT(time.writeTime());

    m4gnClockwork::countFrom(time, from, usual);
    label steps = 0;
    do {
        time.setDeltaT(0.08);
        ++time;
        ++steps;
    } while (!time.writeTime());
    EXPECT_NEAR(time.value(), 0.9, 1e-12);
    EXPECT(steps == 4);
}

//- The interval of 0.3 s becomes one of 0.15 s while the first step lasts
TEST(anIntervalThatIsEditedInTheFirstStepHolds)
{
    const dictionary control(
        testing::dict("startFrom startTime; startTime 0.5; stopAt endTime; endTime 2; deltaT 0.01;"
                      " writeControl runTime; writeInterval 0.3; writeFormat ascii;"));
    Time time(control, "/tmp", "m4gnClockwork");
    const scalar from = m4gnClockwork::carryOn(time, 0);
    const auto usual = m4gnClockwork::toNext(time, from);
    ++time;
    m4gnClockwork::interval(time) = 0.15;
    m4gnClockwork::countFrom(time, from, usual);
    for (const scalar expected : {0.6, 0.75}) {
        do {
            ++time;
        } while (!time.writeTime());
        EXPECT_NEAR(time.value(), expected, 1e-12);
    }
}

//- 12.004 would be 12, which was written before
TEST(timesThatAreWrittenInBetweenHaveNamesOfTheirOwn)
{
    const dictionary control(
        testing::dict("startFrom startTime; startTime 12; stopAt endTime; endTime 13; deltaT 0.004;"
                      " writeControl runTime; writeInterval 1; writeFormat ascii; timePrecision 4;"));
    Time time(control, "/tmp", "m4gnClockwork");
    ++time;
    EXPECT(!time.writeTime() && time.timeName() == "12");

    m4gnClockwork::write(time);
    EXPECT(time.writeTime() && time.timeName() == "12.004");
}
