// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnIncrementalDisplacementCompletion.H"
#include "m4gnCompletionType.H"
#include "m4gnCaseChecks.H"
#include "m4gnSetFields.H"
#include "fvcGrad.H"
#include "volFields.H"

addM4gnCompletion(m4gnIncrementalDisplacementCompletion, incrementalDisplacement)

    const char* const Foam::m4gnIncrementalDisplacementCompletion::needs =
        "displacements D and DD and solidProperties with solidModel linearGeometry"
        " or nonLinearGeometryTotalLagrangian (solids4foam)";

namespace
{
//- Strains that solids4foam's laws add up
const char* const smallStrain = "epsilon_";
const char* const deformation = "F_";

} // End anonymous namespace

Foam::volVectorField& Foam::m4gnIncrementalDisplacementCompletion::DD() const
{
    return mesh_.lookupObjectRef<volVectorField>("DD");
}

bool Foam::m4gnIncrementalDisplacementCompletion::linear() const
{
    return m4gn::solidModel(mesh_) == "linearGeometry";
}

void Foam::m4gnIncrementalDisplacementCompletion::update()
{
    followed_ = false;

    const volVectorField& old = D().oldTime();
    auto& boundary = D().boundaryFieldRef();

    DD().oldTime();
    DD().primitiveFieldRef() = D().primitiveField() - old.primitiveField();
    DD().correctBoundaryConditions();

    forAll(boundary, patchi) {
        boundary[patchi] == old.boundaryField()[patchi] + DD().boundaryField()[patchi];
    }
    D().correctBoundaryConditions();

    extrapolate(DD());
}

void Foam::m4gnIncrementalDisplacementCompletion::setLevels(const scalar deltaT)
{
    volVectorField& increment = DD();
    volVectorField& old = D().oldTime();

    if (dynamic_) {
        m4gn::set(increment, dimensionedScalar("deltaT", dimTime, deltaT) * rate());
        old == D() - increment;
        old.oldTime() == old - increment;
        increment.oldTime() == increment;

        if (linear()) {
            auto& inertia = mesh_.lookupObjectRef<volVectorField>("rhoD2dt2D");
            inertia.oldTime();
            inertia == dimensionedVector(inertia.dimensions(), Zero);
        }
    }

    m4gn::set(mesh_.lookupObjectRef<volTensorField>("grad(DD)"), fvc::grad(increment));
}

bool Foam::m4gnIncrementalDisplacementCompletion::applies(const fvMesh& mesh, const dictionary&)
{
    const word model(m4gn::solidModel(mesh));

    return mesh.foundObject<volVectorField>("D") && mesh.foundObject<volVectorField>("DD")
           && (model == "linearGeometry" || model == "nonLinearGeometryTotalLagrangian");
}

Foam::m4gnIncrementalDisplacementCompletion::m4gnIncrementalDisplacementCompletion(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnTotalDisplacementCompletion(mesh, dict, session)
{
    const bool found = linear() ? mesh_.foundObject<volSymmTensorField>(smallStrain)
                                : mesh_.foundObject<volTensorField>(deformation);

    if (!found) {
        FatalErrorInFunction << "The material law has not registered the strain that it adds up, "
                             << (linear() ? smallStrain : deformation) << nl
                             << "    mode replace takes one material that has it;"
                             << " the models of total displacement keep no such strain" << exit(FatalError);
    }
}

void Foam::m4gnIncrementalDisplacementCompletion::complete(const scalar deltaT, const bool handOver)
{
    m4gnTotalDisplacementCompletion::complete(deltaT, handOver);

    setLevels(deltaT);

    if (followed_) {
        return;
    }

    auto& gradD = mesh_.lookupObjectRef<volTensorField>("grad(D)");
    m4gn::set(gradD, fvc::grad(D()));
    if (linear()) {
        m4gn::set(mesh_.lookupObjectRef<volSymmTensorField>(smallStrain), symm(gradD));
        return;
    }

    const dimensionedTensor one("one", dimless, tensor::I);
    for (const word& name : {word(deformation), word("F")}) {
        m4gn::set(mesh_.lookupObjectRef<volTensorField>(name), one + gradD.T());
    }
}

Foam::wordList Foam::m4gnIncrementalDisplacementCompletion::advanced() const
{
    wordList names(m4gnTotalDisplacementCompletion::advanced());
    names.append(wordList({"DD", "grad(D)", "grad(DD)", "F", "rhoD2dt2D", smallStrain, deformation}));
    return names;
}
