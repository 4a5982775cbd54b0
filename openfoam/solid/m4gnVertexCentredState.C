// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnVertexCentredState.H"
#include "m4gnSolverStateType.H"
#include "m4gnDictionary.H"
#include "m4gnRun.H"
#include "Time.H"

addM4gnSolverState(m4gnVertexCentredState, vertexCentred)

    const char* const Foam::m4gnVertexCentredState::needs =
        "a displacement of the points (name: D, pointD), pointU, and"
        " solidProperties with solidModel vertexCentredLinearGeometry or"
        " vertexCentredNonLinTotalLagGeometry (solids4foam)";

Foam::pointVectorField& Foam::m4gnVertexCentredState::field(const word& name) const
{
    return mesh_.lookupObjectRef<pointVectorField>(name);
}

Foam::word Foam::m4gnVertexCentredState::displacementName(const dictionary& dict)
{
    return dict.getOrDefault<word>("D", "pointD");
}

Foam::ITstream& Foam::m4gnVertexCentredState::newmark() const
{
    return mesh_.d2dt2Scheme("d2dt2(" + DName_ + ')');
}

void Foam::m4gnVertexCentredState::holdFixed()
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

Foam::vectorField* Foam::m4gnVertexCentredState::acceleration()
{
    return scheme_ == "NewmarkBeta" ? &field("pointA").primitiveFieldRef() : nullptr;
}

void Foam::m4gnVertexCentredState::settle(const scalar deltaT, const bool handOver)
{
    if (!completeLastTwo()) {
        return;
    }

    pointVectorField& D = field(DName_);

    settled_ = settling_->settle(
        *law_, D.primitiveFieldRef(), field("pointU").primitiveFieldRef(), acceleration(),
        // What Euler's scheme has for the rate
        scheme_ == "Euler" ? deltaT : 0);
    if (!settled_) {
        D.correctBoundaryConditions();
    }
    if (handOver) {
        settling_->end();
    }
}

bool Foam::m4gnVertexCentredState::applies(const fvMesh& mesh, const dictionary& dict)
{
    const word model(m4gn::solidModel(mesh));

    return mesh.foundObject<pointVectorField>(displacementName(dict))
           && mesh.foundObject<pointVectorField>("pointU")
           && (model == "vertexCentredLinearGeometry" || model == "vertexCentredNonLinTotalLagGeometry");
}

Foam::m4gnVertexCentredState::m4gnVertexCentredState(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnModelState(mesh, dict, session), DName_(displacementName(dict)),
      scheme_(m4gn::scheme(mesh.schemesDict(), "d2dt2Schemes", "d2dt2(" + DName_ + ')')),
      law_(m4gnSolidLaw::New(mesh)), followed_(false), settled_(false),
      dampedSteps_(dict.getOrDefault<label>("dampedSteps", 4)),
      dampedStepsSettled_(dict.getOrDefault<label>("dampedSteps", 1)), coefficients_(scalar(0))
{
    refuseHistory();
    m4gn::checkAtLeast(dict, "dampedSteps", dampedSteps_, 0);

    wordList needed(1, DName_);

    if (scheme_ == "Euler") {
        needed.append("pointU");
    } else if (scheme_ == "NewmarkBeta") {
        needed.append("pointU");
        needed.append("pointA");

        ITstream& scheme = newmark();
        word name(scheme);
        for (scalar& coefficient : coefficients_) {
            coefficient = readScalar(scheme);
        }
    } else if (scheme_ != "steadyState") {
        FatalErrorInFunction << "mode replace does not handle the time scheme of " << DName_
                             << " in d2dt2Schemes: " << scheme_ << nl
                             << "    Handled: Euler, NewmarkBeta, steadyState" << exit(FatalError);
    }

    for (const word& name : needed) {
        if (!session_.outputs().found(name)) {
            FatalErrorInFunction << "The solver carries on from " << m4gn::join(needed) << " (d2dt2Schemes "
                                 << scheme_ << "); the model " << session_.model() << " advances "
                                 << m4gn::join(session_.outputs()) << nl
                                 << "    Record these fields with location points, and train a"
                                 << " model that predicts them" << exit(FatalError);
        }
    }

    settling_ = m4gnSettling::New(mesh, dict, session.stride(), atPoints, law_, scheme_ != "steadyState");
}

void Foam::m4gnVertexCentredState::beforeStride()
{
    if (settling_) {
        settling_->restore(
            field(DName_).primitiveFieldRef(), field("pointU").primitiveFieldRef(), acceleration());
    }
}

void Foam::m4gnVertexCentredState::advance(const List<scalarField>& predicted, const scalar duration)
{
    step(duration);

    forAll(predicted, outputi) {
        impose(outputi, predicted[outputi]);
    }

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

void Foam::m4gnVertexCentredState::complete(const scalar deltaT, const bool handOver)
{
    settle(deltaT, handOver);
    holdFixed();

    if (scheme_ == "Euler") {
        pointVectorField& D = field(DName_);

        D.oldTime().primitiveFieldRef() = D.primitiveField() - deltaT * field("pointU").primitiveField();
    }

    followed_ = law_ && law_->follow();
}

void Foam::m4gnVertexCentredState::write() const
{
    if (settling_) {
        settling_->write();
    }
    if (followed_) {
        law_->write();
        return;
    }
    m4gnSolverState::write();
}

void Foam::m4gnVertexCentredState::beforeStep(const label n)
{
    if (scheme_ != "NewmarkBeta") {
        return;
    }

    const FixedList<scalar, 2> damped({1, 1.5});
    const label nDamped = settled_ ? dampedStepsSettled_ : dampedSteps_;
    const auto& wanted = n < nDamped ? damped : coefficients_;

    ITstream& scheme = newmark();
    forAll(wanted, i) {
        scheme[1 + i] = token(wanted[i]);
    }
}

Foam::wordList Foam::m4gnVertexCentredState::advanced() const
{
    wordList names(m4gnModelState::advanced());
    names.append(wordList({DName_, "D"}));
    if (followed_) {
        names.append(m4gnSolidLaw::fields());
    }
    return names;
}

Foam::List<Foam::m4gnSolverState::quantity> Foam::m4gnVertexCentredState::quantities() const
{
    const tmp<scalarField> magD(mag(field(DName_).primitiveField()));

    return {quantity("minMag" + DName_, gMin(magD())), quantity("maxMag" + DName_, gMax(magD()))};
}
