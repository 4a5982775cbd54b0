// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnFlowCompletion.H"
#include "m4gnDictionary.H"
#include "m4gnHandOver.H"
#include "m4gnCompletionType.H"
#include "calculatedFvPatchFields.H"
#include "findRefCell.H"
#include "fixedFluxPressureFvPatchScalarField.H"
#include "turbulenceModel.H"

addM4gnCompletion(m4gnFlowCompletion, flow)

    const char* const Foam::m4gnFlowCompletion::needs =
        "a velocity, a pressure and a volumetric flux (names: U, p, phi),"
        " incompressible";

namespace
{
//- Coefficients of a turbulence model: their wall functions look at its other fields, and can be evaluated at any time
const Foam::wordHashSet coefficients({"nut", "alphat"});
} // End anonymous namespace

Foam::volVectorField& Foam::m4gnFlowCompletion::U() const
{
    return mesh_.lookupObjectRef<volVectorField>(UName_);
}

Foam::surfaceScalarField& Foam::m4gnFlowCompletion::phi() const
{
    return mesh_.lookupObjectRef<surfaceScalarField>(phiName_);
}

Foam::scalar Foam::m4gnFlowCompletion::heldLevel(const volScalarField& p) const
{
    const m4gn_mesh_data& nodes = session_.nodes().data();
    scalar least = VGREAT;
    scalar largest = -VGREAT;
    label facei = 0;

    for (const label patchi : session_.nodes().valuePatches()) {
        const fvPatchScalarField& patch = p.boundaryField()[patchi];
        forAll(patch, i) {
            if (patch.fixesValue() && nodes.boundary_type[facei] == M4GN_OUTLET) {
                least = min(least, patch[i]);
                largest = max(largest, patch[i]);
            }
            ++facei;
        }
    }
    reduce(least, minOp<scalar>());
    reduce(largest, maxOp<scalar>());

    return least <= largest ? 0.5 * (least + largest) : 0;
}

void Foam::m4gnFlowCompletion::setLevel(const scalar heldBefore) const
{
    volScalarField& p = mesh_.lookupObjectRef<volScalarField>(pName_);
    scalar change = heldLevel(p) - heldBefore;

    if (p.needReference()) {
        label cell = -1;
        scalar value = 0;
        setRefCell(p, m4gnPressureEquation::algorithm(mesh_), cell, value);
        change = value - getRefCellValue(p, cell);
    }
    if (change != 0) {
        p.primitiveFieldRef() += change;
        p.correctBoundaryConditions();
    }
}

void Foam::m4gnFlowCompletion::correctBoundary(const word& name) const
{
    volScalarField& field = mesh_.lookupObjectRef<volScalarField>(name);

    for (fvPatchScalarField& patch : field.boundaryFieldRef()) {
        // The solver sets these gradients from the flux before it solves
        if (isA<fixedFluxPressureFvPatchScalarField>(patch)) {
            auto& fixedFlux = refCast<fixedFluxPressureFvPatchScalarField>(patch);
            const scalarField gradient(fixedFlux.gradient());
            fixedFlux.updateSnGrad(gradient);
        }
        const bool ofWall = patch.type().find("WallFunction") != std::string::npos;
        if ((ofWall && !coefficients.found(name)) || isA<calculatedFvPatchScalarField>(patch)) {
            // As wall functions of omega and epsilon have it. They can be evaluated within the model's correct() alone: this
            // says that they are up to date.
            patch == patch.patchInternalField()();
            patch.fvPatchScalarField::updateCoeffs();
        }
    }

    field.correctBoundaryConditions();
}

Foam::turbulenceModel* Foam::m4gnFlowCompletion::turbulence() const
{
    return session_.outputs().found("nut") || !mesh_.foundObject<volScalarField>("nut")
               ? nullptr
               : mesh_.getObjectPtr<turbulenceModel>(turbulenceModel::propertiesName);
}

void Foam::m4gnFlowCompletion::checkCase() const
{
    const string why(m4gn::notHandedOver(mesh_, UName_, pName_, phiName_));
    if (why.size()) {
        FatalErrorInFunction << "mode replace cannot hand states of this case over to its solver: "
                             << why.c_str() << nl << "    Use mode observe" << exit(FatalError);
    }

    // The scheme's state must be in the old-time levels of the fields:
    // CrankNicolson keeps fields of its own, pseudo-time has no real time.
    const word used(m4gn::scheme(mesh_.schemesDict(), "ddtSchemes", "ddt(" + UName_ + ')'));

    if (used != "Euler" && used != "backward") {
        FatalErrorInFunction << "mode replace does not handle the time scheme of " << UName_ << ": " << used
                             << nl << "    Handled: Euler, backward" << exit(FatalError);
    }

    refuseLeftBehind({UName_, pName_});
}

bool Foam::m4gnFlowCompletion::applies(const fvMesh& mesh, const dictionary& dict)
{
    return mesh.foundObject<volVectorField>(dict.getOrDefault<word>("U", "U"))
           && mesh.foundObject<volScalarField>(dict.getOrDefault<word>("p", "p"))
           && mesh.foundObject<surfaceScalarField>(dict.getOrDefault<word>("phi", "phi"));
}

Foam::m4gnFlowCompletion::m4gnFlowCompletion(
    const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
    : m4gnCompletion(mesh, session), UName_(dict.getOrDefault<word>("U", "U")),
      pName_(dict.getOrDefault<word>("p", "p")), phiName_(dict.getOrDefault<word>("phi", "phi")),
      projection_(mesh, dict),
      pressure_(
          mesh.lookupObject<volScalarField>(pName_), dict.subOrEmptyDict("projection"),
          // A pressure predicted on groups of many cells drifts; on a few cells
          // the solved one shows the roughness of the predicted velocity
          session.cellsAGroup() >= 8 || !session.outputs().found(pName_)),
      divInterpolated_(0), divProjected_(0), completed_(false)
{
    checkCase();
}

void Foam::m4gnFlowCompletion::advance(const m4gnState& predicted, const scalar)
{
    const bool predictsP = session_.outputs().found(pName_);
    const scalar held = predictsP ? heldLevel(mesh_.lookupObject<volScalarField>(pName_)) : 0;

    completed_ = false;
    predicted.impose();

    U().correctBoundaryConditions();
    m4gnFluxProjection::interpolate(U(), phi());

    // Conditions that look at phi (inletOutlet) now see the new one, and those of the coefficients see k
    for (const bool ofCoefficients : {false, true}) {
        for (const word& name : session_.outputs()) {
            if (auto* field = mesh_.getObjectPtr<volVectorField>(name)) {
                field->correctBoundaryConditions();
            } else if (coefficients.found(name) == ofCoefficients) {
                correctBoundary(name);
            }
        }
    }

    if (predictsP) {
        setLevel(held);
    }
}

void Foam::m4gnFlowCompletion::complete(const scalar deltaT, const bool handOver)
{
    volScalarField& p = mesh_.lookupObjectRef<volScalarField>(pName_);

    if (!completed_) {
        divInterpolated_ = maxDiv(phi());
        completed_ = true;
    }
    projection_.project(p, U(), phi(), handOver);
    if (pressure_.solved()) {
        pressure_.solve(U(), phi(), deltaT, p);
    }
    divProjected_ = maxDiv(phi());
    if (turbulenceModel* model = turbulence()) {
        model->validate();
    }
}

Foam::wordList Foam::m4gnFlowCompletion::advanced() const
{
    wordList names(m4gnCompletion::advanced());
    names.append(UName_);
    names.append(phiName_);
    if (pressure_.solved()) {
        names.append(pName_);
    }
    if (turbulence()) {
        names.append("nut");
    }
    return names;
}

Foam::List<Foam::m4gnCompletion::quantity> Foam::m4gnFlowCompletion::quantities() const
{
    const tmp<scalarField> magU(mag(U().primitiveField()));

    return {
        quantity("maxDivBefore", divInterpolated_), quantity("maxDivAfter", divProjected_),
        quantity("minMag" + UName_, gMin(magU())), quantity("maxMag" + UName_, gMax(magU()))};
}
