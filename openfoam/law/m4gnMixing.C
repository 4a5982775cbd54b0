// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnMixing.H"
#include "PstreamReduceOps.H"
#include "simpleMatrix.H"

namespace
{
//- Changes that differ by less than about the root of this count as the same
const Foam::scalar alike = 1e-12;

//- The part of its residual that the linear solver of an iteration leaves
const Foam::scalar linearTolerance = 1e-3;

} // End anonymous namespace

Foam::m4gnMixing::m4gnMixing(const label depth)
    : depth_(depth), dg_(depth), df_(depth), products_(depth * depth, Zero), n_(0)
{}

Foam::dictionary Foam::m4gnMixing::linearControls(dictionary controls)
{
    // A coupled solver has them for each component
    if (controls.getOrDefault<word>("type", "segregated") == "coupled") {
        controls.set("tolerance", vector::uniform(VSMALL));
        controls.set("relTol", vector::uniform(linearTolerance));
    } else {
        controls.set("tolerance", VSMALL);
        controls.set("relTol", linearTolerance);
    }

    return controls;
}

Foam::tmp<Foam::vectorField> Foam::m4gnMixing::next(const vectorField& x, const vectorField& g)
{
    vectorField f(g - x);
    auto mixed = tmp<vectorField>::New(g);

    if (n_++) {
        for (label i = 0; i + 1 < depth_; ++i) {
            dg_[i].swap(dg_[i + 1]);
            df_[i].swap(df_[i + 1]);
            for (label j = 0; j + 1 < depth_; ++j) {
                products_[i * depth_ + j] = products_[(i + 1) * depth_ + j + 1];
            }
        }
        dg_.last() = g - g_;
        df_.last() = f - f_;
    }
    g_ = g;
    f_.transfer(f);

    // Of m changes: the products with f, and of the latest with each
    const label m = min(n_ - 1, depth_);
    const label first = depth_ - m;
    List<scalar> sums(2 * m, Zero);
    const vectorField& last = df_.last();
    for (label i = 0; i < m; ++i) {
        const vectorField& change = df_[first + i];
        scalar withF = 0, withLast = 0;
        forAll(change, j) {
            withF += change[j] & f_[j];
            withLast += change[j] & last[j];
        }
        sums[i] = withF;
        sums[m + i] = withLast;
    }
    Pstream::listCombineGather(sums, plusEqOp<scalar>());
    Pstream::listCombineScatter(sums);

    for (label i = 0; i < m; ++i) {
        products_[(first + i) * depth_ + depth_ - 1] = sums[m + i];
        products_[(depth_ - 1) * depth_ + first + i] = sums[m + i];
    }

    // Each change counts by its direction, for the latest are the smallest
    scalarField scale(m);
    for (label i = 0; i < m; ++i) {
        scale[i] = 1 / sqrt(max(products_[(first + i) * (depth_ + 1)], ROOTVSMALL));
    }

    if (m) {
        // The small term keeps changes that are alike from cancelling
        simpleMatrix<scalar> system(m, 0, 0);
        for (label i = 0; i < m; ++i) {
            for (label j = 0; j < m; ++j) {
                system(i, j) = scale[i] * scale[j] * products_[(first + i) * depth_ + first + j];
            }
            system(i, i) += alike;
            system.source()[i] = scale[i] * sums[i];
        }

        const scalarField weights(scale * system.LUsolve());
        vectorField& values = mixed.ref();
        for (label i = 0; i < m; ++i) {
            const vectorField& change = dg_[first + i];
            const scalar weight = weights[i];
            forAll(change, j) {
                values[j] -= weight * change[j];
            }
        }
    }

    return mixed;
}
