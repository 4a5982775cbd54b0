// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnObstacles.H"
#include "Time.H"
#include "volFields.H"

const Foam::word Foam::m4gnObstacles::fileNameOf("obstacles");

Foam::IOobject Foam::m4gnObstacles::io(const fvMesh& mesh)
{
    return IOobject(fileNameOf, mesh.time().constant(), mesh, IOobject::MUST_READ, IOobject::NO_WRITE);
}

Foam::m4gnObstacles::m4gnObstacles(const fvMesh& mesh)
    : IOdictionary(io(mesh)), mesh_(mesh), range_(get<scalar>("range")), ahead_(get<scalar>("ahead"))
{
    if (range_ <= 0 || ahead_ <= 0) {
        FatalIOErrorInFunction(*this) << "Entries range and ahead are " << range_ << " m and " << ahead_
                                      << " s; expected numbers above 0" << nl
                                      << "    range: the distance up to which a network is to see an"
                                      << " obstacle; ahead: the stride of the model" << exit(FatalIOError);
    }

    for (const entry& e : *this) {
        if (!e.isDict() || e.keyword() == "FoamFile") {
            continue;
        }

        const dictionary& dict = e.dict();
        const word name(e.keyword());

        if (!dict.found("motion")) {
            FatalIOErrorInFunction(dict) << "The obstacle " << name << " has no entry motion" << nl
                                         << "    Give its displacement over time, as motion table"
                                         << " ((0 (0 0 0)) (1 (0 -0.02 0))); or motion constant"
                                         << " (0 0 0); for one that rests" << exit(FatalIOError);
        }

        surfaces_.append(searchableSurface::New(
            dict.get<word>("type"),
            IOobject(
                name, mesh.time().constant(), "triSurface", mesh.time(), IOobject::MUST_READ,
                IOobject::NO_WRITE),
            dict));
        motions_.append(Function1<vector>::New("motion", dict));

        if (!surfaces_.last().hasVolumeType()) {
            FatalIOErrorInFunction(dict)
                << "The surface of the obstacle " << name << ", a " << surfaces_.last().type()
                << ", is open: nothing tells what"
                << " is inside of it" << nl << "    Give a closed surface (surfaceCheck looks for its"
                << " open edges), a searchableSphere, a searchableCylinder or"
                << " a searchableBox" << exit(FatalIOError);
        }
    }

    if (surfaces_.empty()) {
        FatalIOErrorInFunction(*this)
            << "There is no obstacle in this file; expected at least one"
            << " dictionary with type, what the type needs, and motion" << exit(FatalIOError);
    }
}

bool Foam::m4gnObstacles::present(const fvMesh& mesh)
{
    IOobject header(io(mesh));

    return mesh.foundObject<m4gnObstacles>(fileNameOf) || header.typeHeaderOk<IOdictionary>(false);
}

const Foam::m4gnObstacles& Foam::m4gnObstacles::of(const fvMesh& mesh)
{
    const auto* found = mesh.findObject<m4gnObstacles>(fileNameOf);

    if (!found) {
        if (!present(mesh)) {
            FatalErrorInFunction << "There is no file " << fileName("constant" / fileNameOf)
                                 << ", which says what obstacles there are, and how they move" << nl
                                 << "    docs/explanation/contact.md describes it" << exit(FatalError);
        }

        auto* made = new m4gnObstacles(mesh);
        mesh.objectRegistry::store(made);
        found = made;
    }

    return *found;
}

void Foam::m4gnObstacles::gaps(
    const pointField& points, const scalar time, const scalar limit, scalarField& gap,
    vectorField& direction) const
{
    gap.resize(points.size());
    direction.resize(points.size());
    gap = limit;
    direction = Zero;

    const scalarField limits(points.size(), sqr(limit));

    forAll(surfaces_, i) {
        const pointField moved(points - motions_[i].value(time));

        // Outside of a distance of the limit there is no nearest point
        List<pointIndexHit> nearest;
        surfaces_[i].findNearest(moved, limits, nearest);

        List<volumeType> side;
        surfaces_[i].getVolumeType(moved, side);

        forAll(points, pointi) {
            if (!nearest[pointi].hit()) {
                continue;
            }

            vector out(moved[pointi] - nearest[pointi].hitPoint());
            scalar distance = mag(out);

            if (side[pointi] == volumeType::INSIDE) {
                out = -out;
                distance = -distance;
            }

            if (distance >= gap[pointi]) {
                continue;
            }

            if (mag(distance) < SMALL * mesh_.bounds().mag()) {
                // On the surface: the surface says where out is
                vectorField normal;
                surfaces_[i].getNormal(List<pointIndexHit>(1, nearest[pointi]), normal);
                out = normal[0];
            }

            for (Foam::direction cmpt = 0; cmpt < vector::nComponents; ++cmpt) {
                if (mesh_.solutionD()[cmpt] == -1) {
                    out[cmpt] = 0;
                }
            }

            gap[pointi] = distance;
            direction[pointi] = out / max(mag(out), VSMALL);
        }
    }
}

Foam::scalar Foam::m4gnObstacles::smallestGap(const volVectorField& D) const
{
    // All of the body is nearer than this
    const scalar limit = GREAT;
    scalar smallest = limit;

    scalarField gap;
    vectorField direction;

    for (const fvPatchVectorField& patch : D.boundaryField()) {
        if (!patch.size() || patch.coupled()) {
            continue;
        }

        gaps(patch.patch().Cf() + patch, mesh_.time().value(), limit, gap, direction);
        smallest = min(smallest, min(gap));
    }

    return returnReduce(smallest, minOp<scalar>());
}
