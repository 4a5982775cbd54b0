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

Foam::word Foam::m4gnVertexCentredCompletion::displacementName(const dictionary& dict)
{
    return dict.getOrDefault<word>("D", "pointD");
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

Foam::vectorField* Foam::m4gnVertexCentredCompletion::acceleration()
{
    return scheme_ == "NewmarkBeta" ? &field("pointA").primitiveFieldRef() : nullptr;
}

void Foam::m4gnVertexCentredCompletion::settle(const scalar deltaT, const bool handOver)
{
    if (!completeLastTwo()) {
        return;
    }

    pointVectorField& D = field(DName_);

    const bool settled = settling_->settle(
        *law_, D.primitiveFieldRef(), field("pointU").primitiveFieldRef(), acceleration(),
        // What Euler's scheme has for the rate
        scheme_ == "Euler" ? deltaT : 0);
    if (!settled) {
        D.correctBoundaryConditions();
    }
    if (handOver) {
        settling_->end();
    }
}

bool Foam::m4gnVertexCentredCompletion::applies(const fvMesh& mesh, const dictionary& dict)
{
    const word model(m4gn::solidModel(mesh));

    return mesh.foundObject<pointVectorField>(displacementName(dict))
           && mesh.foundObject<pointVectorField>("pointU")
           && (model == "vertexCentredLinearGeometry" || model == "vertexCentredNonLinTotalLagGeometry");
}

Foam::m4gnVertexCentredCompletion::m4gnVertexCentredCompletion(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnCompletion(mesh, dict, session), DName_(displacementName(dict)),
      scheme_(m4gn::scheme(mesh.schemesDict(), "d2dt2Schemes", "d2dt2(" + DName_ + ')')),
      law_(m4gnSolidLaw::New(mesh)), followed_(false)
{
    refuseHistory();

    wordList needed(1, DName_);

    if (scheme_ == "Euler") {
        needed.append("pointU");
    } else if (scheme_ == "NewmarkBeta") {
        needed.append("pointU");
        needed.append("pointA");
    } else if (scheme_ != "steadyState") {
        FatalErrorInFunction << "mode replace does not handle the time scheme of " << DName_
                             << " in d2dt2Schemes: " << scheme_ << nl
                             << "    Handled: Euler, NewmarkBeta, steadyState" << exit(FatalError);
    }

    checkAdvanced(needed, scheme_, " with location points");

    settling_ = m4gnSettling::New(mesh, dict, session.stride(), atPoints, law_, scheme_ != "steadyState");
}

bool Foam::m4gnVertexCentredCompletion::beforeStride()
{
    return settling_
           && settling_->restore(
               field(DName_).primitiveFieldRef(), field("pointU").primitiveFieldRef(), acceleration());
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
    settle(deltaT, handOver);
    holdFixed();

    if (scheme_ == "Euler") {
        pointVectorField& D = field(DName_);

        D.oldTime().primitiveFieldRef() = D.primitiveField() - deltaT * field("pointU").primitiveField();
    }

    followed_ = law_ && law_->follow();
}

void Foam::m4gnVertexCentredCompletion::write() const
{
    if (settling_) {
        settling_->write();
    }
    if (followed_) {
        law_->write();
        return;
    }
    m4gnCompletion::write();
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

Foam::List<Foam::m4gnCompletion::quantity> Foam::m4gnVertexCentredCompletion::quantities() const
{
    const tmp<scalarField> magD(mag(field(DName_).primitiveField()));

    return {quantity("minMag" + DName_, gMin(magD())), quantity("maxMag" + DName_, gMax(magD()))};
}
