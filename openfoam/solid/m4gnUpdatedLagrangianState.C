// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnUpdatedLagrangianState.H"
#include "m4gnSolverStateType.H"
#include "m4gnRun.H"
#include "volFields.H"

addM4gnSolverState(m4gnUpdatedLagrangianState, updatedLagrangian)

    const char* const Foam::m4gnUpdatedLagrangianState::needs =
        "displacements D and DD and solidProperties with solidModel"
        " nonLinearGeometryUpdatedLagrangian (solids4foam)";

void Foam::m4gnUpdatedLagrangianState::update()
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

    m4gnIncrementalDisplacementState::update();
    pending_ = true;
}

bool Foam::m4gnUpdatedLagrangianState::applies(const fvMesh& mesh, const dictionary&)
{
    return mesh.foundObject<volVectorField>("D") && mesh.foundObject<volVectorField>("DD")
           && m4gn::meshFollowsBody(mesh);
}

Foam::m4gnUpdatedLagrangianState::m4gnUpdatedLagrangianState(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnIncrementalDisplacementState(mesh, dict, session), pending_(false)
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

void Foam::m4gnUpdatedLagrangianState::beforeStride()
{
    autoPtr<volVectorField> moved(new volVectorField("moved", D()));
    autoPtr<volVectorField> movedRate;
    if (dynamic_) {
        movedRate.reset(new volVectorField("movedRate", rate()));
    }

    m4gnIncrementalDisplacementState::beforeStride();

    pending_ = false;
    moved_ = std::move(moved);
    movedRate_ = std::move(movedRate);
}

void Foam::m4gnUpdatedLagrangianState::complete(const scalar deltaT, const bool handOver)
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
        settle(deltaT, handOver);
        followed_ = law_->follow();
        if (!followed_) {
            FatalErrorInFunction << "The surrogate's increment turns cells inside out, and the mesh"
                                 << " cannot be moved by it" << nl
                                 << "    Take fewer surrogateSteps, or the entry control, which"
                                 << " ends jumps whose error grows" << exit(FatalError);
        }
        law_->move();
    }

    m4gnDisplacementState::complete(deltaT, handOver);
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

Foam::wordList Foam::m4gnUpdatedLagrangianState::advanced() const
{
    wordList names(m4gnIncrementalDisplacementState::advanced());
    names.append("rho");
    return names;
}
