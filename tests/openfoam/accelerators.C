// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "m4gnPredictor.H"

// t^2 at 1, 2 and 4: the change from 4 to 7 is 33
TEST(aParabolaIsExtrapolatedExactly)
{
    const vectorField rate(1, vector(0, (16.0 - 4) / 2, 0)), before(1, vector(0, (4.0 - 1) / 1, 0));
    const tmp<vectorField> change(functionObjects::m4gnPredictor::parabola(3, 2, 1, rate, before));
    EXPECT_NEAR(change()[0].y(), 33, 1e-12);
}
