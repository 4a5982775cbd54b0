/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnMixing.H"
#include "PstreamReduceOps.H"
#include "simpleMatrix.H"

// * * * * * * * * * * * * * * * Local Functions * * * * * * * * * * * * * * //

namespace
{

Foam::scalar product(const Foam::vectorField& a, const Foam::vectorField& b)
{
    Foam::scalar sum = 0;
    forAll(a, i)
    {
        sum += a[i] & b[i];
    }
    return sum;
}

} // End anonymous namespace


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnMixing::m4gnMixing(const label depth)
:
    depth_(depth),
    dx_(depth),
    df_(depth),
    n_(0)
{}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

Foam::tmp<Foam::vectorField> Foam::m4gnMixing::next
(
    const vectorField& x,
    const vectorField& g
)
{
    const vectorField f(g - x);
    auto mixed = tmp<vectorField>::New(g);

    if (n_++)
    {
        for (label i = 0; i + 1 < depth_; ++i)
        {
            dx_[i] = dx_[i + 1];
            df_[i] = df_[i + 1];
        }
        dx_.last() = x - x_;
        df_.last() = f - f_;
    }
    x_ = x;
    f_ = f;

    const label m = min(n_ - 1, depth_);
    const label first = depth_ - m;

    // Of m changes: the products with each other, and with f
    List<scalar> sums(m*(m + 1), Zero);
    for (label i = 0; i < m; ++i)
    {
        for (label j = 0; j < m; ++j)
        {
            sums[i*(m + 1) + j] = product(df_[first + i], df_[first + j]);
        }
        sums[i*(m + 1) + m] = product(df_[first + i], f);
    }
    Pstream::listCombineGather(sums, plusEqOp<scalar>());
    Pstream::listCombineScatter(sums);

    scalar trace = 0;
    for (label i = 0; i < m; ++i)
    {
        trace += sums[i*(m + 1) + i];
    }

    if (m && trace > 0)
    {
        // The small term keeps changes that are alike from cancelling
        simpleMatrix<scalar> system(m, 0, 0);
        for (label i = 0; i < m; ++i)
        {
            for (label j = 0; j < m; ++j)
            {
                system(i, j) = sums[i*(m + 1) + j];
            }
            system(i, i) += 1e-13*trace;
            system.source()[i] = sums[i*(m + 1) + m];
        }

        const scalarField weights(system.LUsolve());
        for (label i = 0; i < m; ++i)
        {
            mixed.ref() -= weights[i]*(dx_[first + i] + df_[first + i]);
        }
    }

    return mixed;
}


// ************************************************************************* //
