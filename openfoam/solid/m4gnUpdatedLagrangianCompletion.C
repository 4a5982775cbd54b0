// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnUpdatedLagrangianCompletion.H"
#include "m4gnCompletionType.H"
#include "m4gnCaseChecks.H"
#include "volFields.H"

addM4gnCompletion(m4gnUpdatedLagrangianCompletion, updatedLagrangian)

    const char* const Foam::m4gnUpdatedLagrangianCompletion::needs =
        "displacements D and DD and solidProperties with solidModel"
        " nonLinearGeometryUpdatedLagrangian (solids4foam)";

void Foam::m4gnUpdatedLagrangianCompletion::update()
{
    // What the increment begins from, before anything is written to it
    for (const word& name : {word("F"), word("F_"), word("grad(D)")}) {
        auto* field = mesh_.getObjectPtr<volTensorField>(name);
        if (field) {
            field->oldTime();
        }
    }
    mesh_.lookupObjectRef<volScalarField>("J").oldTime();
    mesh_.lookupObjectRef<pointVectorField>("pointD").oldTime();
    if (moved_.valid()) {
        D().oldTime() == moved_();
        moved_.clear();
    }

    m4gnIncrementalDisplacementCompletion::update();
    pending_ = true;
}

bool Foam::m4gnUpdatedLagrangianCompletion::applies(const fvMesh& mesh, const dictionary&)
{
    return mesh.foundObject<volVectorField>("D") && mesh.foundObject<volVectorField>("DD")
           && m4gn::meshFollowsBody(mesh);
}

Foam::m4gnUpdatedLagrangianCompletion::m4gnUpdatedLagrangianCompletion(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnIncrementalDisplacementCompletion(mesh, dict, session), pending_(false)
{
    if (!law_) {
        FatalErrorInFunction << "mode replace hands a state to nonLinearGeometryUpdatedLagrangian"
                             << " with the solver's own material law only, which could not be"
                             << " asked: the log says why" << nl
                             << "    Build lib/libm4gnSolids4Foam.so with this solids4foam"
                             << " (setup/solids4foam.sh, or openfoam/solids4foam), or use"
                             << " nonLinearGeometryTotalLagrangian" << exit(FatalError);
    }
}

bool Foam::m4gnUpdatedLagrangianCompletion::beforeStride()
{
    autoPtr<volVectorField> moved(new volVectorField("moved", D()));
    moved->timeIndex() = time_.timeIndex();
    autoPtr<volVectorField> movedRate;
    if (dynamic_) {
        movedRate.reset(new volVectorField("movedRate", rate()));
    }

    const bool restored = m4gnIncrementalDisplacementCompletion::beforeStride();

    pending_ = false;
    // A run that is carried on has them of this time already
    if (restored || !moved_.valid() || moved_->timeIndex() != time_.timeIndex()) {
        moved_ = std::move(moved);
        movedRate_ = std::move(movedRate);
    }
    return restored;
}

void Foam::m4gnUpdatedLagrangianCompletion::complete(const scalar deltaT, const bool handOver)
{
    const bool moves = pending_;
    pending_ = false;

    if (moved_.valid()) {
        // The stride was not taken
        D() == moved_();
        moved_.clear();
        if (dynamic_) {
            rate() == movedRate_();
        }
    }

    if (moves) {
        relax(deltaT, handOver);
        followed_ = law_->follow();
        if (!followed_) {
            FatalErrorInFunction << "The surrogate's increment turns cells inside out, and the mesh"
                                 << " cannot be moved by it" << nl
                                 << "    Take fewer surrogateSteps, or the entry control, which"
                                 << " ends jumps whose error grows" << exit(FatalError);
        }
        law_->move();
    }

    m4gnDisplacementCompletion::complete(deltaT, handOver);
    setVelocity();
    setLevels(deltaT);

    if (dynamic_ && moves) {
        // rho J is the same at all times. Only the old level is registered:
        // now that of before the increment
        auto& rho = mesh_.lookupObjectRef<volScalarField>("rho_0");
        const auto& relJ = mesh_.lookupObject<volScalarField>("relJ");
        const auto& gradDD = mesh_.lookupObject<volTensorField>("grad(DD)");
        const dimensionedTensor one("one", dimless, tensor::I);
        rho == rho / (relJ * det(one - gradDD.T()));
    }
}

Foam::wordList Foam::m4gnUpdatedLagrangianCompletion::advanced() const
{
    wordList names(m4gnIncrementalDisplacementCompletion::advanced());
    names.append("rho");
    return names;
}
