// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "m4gnExtrapolate.H"

// t^2 at 1, 2 and 4: the change from 4 to 7 is 33
TEST(aParabolaIsExtrapolatedExactly)
{
    const scalarField rate(1, (16.0 - 4) / 2), before(1, (4.0 - 1) / 1);
    const tmp<scalarField> change(m4gn::parabola<scalar>(3, 2, rate, before, -(2.0 + 1)));
    EXPECT_NEAR(change()[0], 33, 1e-12);
}
