// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnElasticSmoothing.H"
#include "m4gnDictionary.H"
#include "fvcGrad.H"
#include "fvcLaplacian.H"

namespace
{
//- Most sweeps for the boundary values of the rate
const Foam::label maxSweeps = 200;
}

Foam::scalar Foam::m4gnElasticSmoothing::lengthOf(const dictionary& dict)
{
    const word name("smoothing");
    const scalar defaultLength = 2;

    if (m4gn::isNone(dict, name, "smoothing { length 2; }")) {
        return 0;
    }
    if (!dict.found(name)) {
        return defaultLength;
    }

    const dictionary& own = dict.subDict(name);
    m4gn::checkKeys(own, {"length"}, false);

    const scalar length = own.getOrDefault<scalar>("length", defaultLength);

    if (!(length > 0)) {
        FatalIOErrorInFunction(own) << "Entry length of " << own.dictName() << " is " << length
                                    << " cells; expected more than 0" << nl
                                    << "    To hand over what was predicted: smoothing none;"
                                    << exit(FatalIOError);
    }

    return length;
}

Foam::tmp<Foam::volVectorField> Foam::m4gnElasticSmoothing::elasticForce(
    const volVectorField& field, const word& gradScheme) const
{
    const volTensorField gradient(fvc::grad(field, gradScheme));

    return fvc::laplacian(response_.stiffness(), field, "laplacian(DD,D)")
           + law_.explicitPart(law_.stress(gradient)(), gradient);
}

Foam::tmp<Foam::volVectorField> Foam::m4gnElasticSmoothing::correction(
    const volVectorField& D, const volVectorField::Internal& force, const scalar size) const
{
    auto r = response_.respond(D, force, size);
    const volVectorField::Internal inertial(response_.inertia() * r().internalField());
    r.ref() -= response_.respond(D, inertial, size);

    return r;
}

Foam::m4gnElasticSmoothing::m4gnElasticSmoothing(
    const fvMesh& mesh, const dictionary& dict, const m4gnExplicitStress& law)
    : mesh_(mesh), law_(law), response_(mesh, law, lengthOf(dict))
{}

Foam::scalar Foam::m4gnElasticSmoothing::smoothDisplacement(volVectorField& D) const
{
    volVectorField force(elasticForce(D, "grad(" + D.name() + ')'));

    if (law_.thermal()) {
        force -= fvc::grad(
            mesh_.lookupObject<volScalarField>("threeKalpha") * mesh_.lookupObject<volScalarField>("T"));
    }

    const auto change = correction(D, force.internalField(), gMax(mag(D.primitiveField())()));

    D.primitiveFieldRef() += change().primitiveField();

    return gMax(mag(change().primitiveField())());
}

void Foam::m4gnElasticSmoothing::smoothRate(const volVectorField& D, volVectorField& rate) const
{
    const word gradScheme("grad(" + D.name() + ')');
    const scalar size = gMax(mag(rate.primitiveField())());

    auto tv = response_.heldAs(D, "m4gnRate", rate.dimensions());
    volVectorField& v = tv.ref();
    v.primitiveFieldRef() = rate.primitiveField();
    forAll(v.boundaryField(), patchi) {
        if (v.boundaryField()[patchi].fixesValue()) {
            v.boundaryFieldRef()[patchi] == rate.boundaryField()[patchi];
        }
    }
    v.correctBoundaryConditions();

    for (label sweep = 0; sweep < maxSweeps; ++sweep) {
        const volVectorField::Boundary before(v.boundaryField());
        response_.release(v, law_.stress(fvc::grad(v, gradScheme)())());

        if (m4gnExplicitStress::change(before, v) <= 1e-6 * size) {
            break;
        }
    }

    const volVectorField force(elasticForce(v, gradScheme));

    rate.primitiveFieldRef() += correction(D, force.internalField(), size)().primitiveField();
    rate.correctBoundaryConditions();
}
