// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnVertexCentredCompletion.H"
#include "m4gnCompletionType.H"
#include "m4gnDictionary.H"
#include "m4gnCaseChecks.H"
#include "Time.H"

addM4gnCompletion(m4gnVertexCentredCompletion, vertexCentred)

    const char* const Foam::m4gnVertexCentredCompletion::needs =
        "a displacement of the points (name: D, pointD), pointU, and"
        " solidProperties with solidModel vertexCentredLinearGeometry or"
        " vertexCentredNonLinTotalLagGeometry (solids4foam)";

Foam::pointVectorField& Foam::m4gnVertexCentredCompletion::field(const word& name) const
{
    return mesh_.lookupObjectRef<pointVectorField>(name);
}

void Foam::m4gnVertexCentredCompletion::holdFixed()
{
    const pointVectorField& D = field(DName_);

    for (const char* name : {"pointU", "pointA"}) {
        if (!session_.outputs().found(name)) {
            continue;
        }
        vectorField& rate = field(name).primitiveFieldRef();
        forAll(D.boundaryField(), patchi) {
            // Those that are derived from it may move
            if (D.boundaryField()[patchi].type() == "fixedValue") {
                const auto& patch = D.mesh().boundary()[patchi];
                for (const label pointi : patch.meshPoints()) {
                    rate[pointi] = Zero;
                }
            }
        }
    }
}

Foam::vectorField* Foam::m4gnVertexCentredCompletion::accelerations() const
{
    return scheme_ == "NewmarkBeta" ? &field("pointA").primitiveFieldRef() : nullptr;
}

bool Foam::m4gnVertexCentredCompletion::applies(const fvMesh& mesh, const dictionary& dict)
{
    const word model(m4gn::solidModel(mesh));

    return mesh.foundObject<pointVectorField>(displacementName(dict, "pointD"))
           && mesh.foundObject<pointVectorField>("pointU")
           && (model == "vertexCentredLinearGeometry" || model == "vertexCentredNonLinTotalLagGeometry");
}

Foam::m4gnVertexCentredCompletion::m4gnVertexCentredCompletion(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnDisplacementCompletion(mesh, session, displacementName(dict, "pointD"))
{
    checkSolver(
        {{"Euler", {"pointU"}}, {"NewmarkBeta", {"pointU", "pointA"}}, {"steadyState", {}}},
        " with location points");
    useLaw(dict, atPoints);
}

void Foam::m4gnVertexCentredCompletion::advance(const m4gnState& predicted, const scalar)
{
    predicted.impose();

    auto* cells = mesh_.getObjectPtr<volVectorField>("D");
    if (cells) {
        const vectorField& points = field(DName_).primitiveField();
        vectorField& D = cells->primitiveFieldRef();
        forAll(D, celli) {
            const labelList& ofCell = mesh_.cellPoints()[celli];
            D[celli] = Zero;
            for (const label pointi : ofCell) {
                D[celli] += points[pointi] / ofCell.size();
            }
        }
        cells->correctBoundaryConditions();
    }
    followed_ = false;
}

void Foam::m4gnVertexCentredCompletion::complete(const scalar deltaT, const bool handOver)
{
    // What Euler's scheme has for the rate
    if (leftAsPredicted(scheme_ == "Euler" ? deltaT : 0, handOver)) {
        field(DName_).correctBoundaryConditions();
    }
    holdFixed();

    if (scheme_ == "Euler") {
        pointVectorField& D = field(DName_);

        D.oldTime().primitiveFieldRef() = D.primitiveField() - deltaT * field("pointU").primitiveField();
    }

    followed_ = law_ && law_->follow();
}

Foam::wordList Foam::m4gnVertexCentredCompletion::advanced() const
{
    wordList names(m4gnCompletion::advanced());
    names.append(wordList({DName_, "D"}));
    if (followed_) {
        names.append(m4gnSolidLaw::fields());
    }
    return names;
}
