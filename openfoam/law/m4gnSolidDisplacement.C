// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolidDisplacement.H"
#include "fixedGradientFvPatchFields.H"
#include "fixedValueFvPatchFields.H"
#include "fvOptions.H"
#include "fvc.H"
#include "fvm.H"
#include "m4gnMixing.H"
#include "m4gnVersion.H"
#include "zeroGradientFvPatchFields.H"

namespace
{
//- Correctors that the mixing remembers
const Foam::label correctorDepth = 20;

} // End anonymous namespace

Foam::m4gnSolidDisplacement::m4gnSolidDisplacement(const fvMesh& mesh)
    : mesh_(mesh), D_(mesh.lookupObjectRef<volVectorField>("D")),
      sigmaD_(mesh.lookupObjectRef<volSymmTensorField>("sigmaD")),
      divSigmaExp_(mesh.lookupObjectRef<volVectorField>("divSigmaExp")), warned_(false)
{
    const volScalarField& nu = mesh_.lookupObject<volScalarField>("nu");
    const volScalarField E(
        mesh_.lookupObject<volScalarField>("E") / mesh_.lookupObject<volScalarField>("rho"));

    const bool planeStress =
        mesh_.lookupObject<IOdictionary>("mechanicalProperties").get<bool>("planeStress");

    // Not to be found in the registry in place of the solver's
    mu_.reset(new volScalarField("m4gnMu", E / (2 * (1 + nu))));
    lambda_.reset(
        new volScalarField("m4gnLambda", nu * E / ((1 + nu) * (planeStress ? 1 - nu : 1 - 2 * nu))));
}

bool Foam::m4gnSolidDisplacement::registered(const fvMesh& mesh)
{
    return mesh.foundObject<volVectorField>("D") && mesh.foundObject<volSymmTensorField>("sigmaD")
           && mesh.foundObject<volVectorField>("divSigmaExp") && mesh.foundObject<volScalarField>("E")
           && mesh.foundObject<volScalarField>("nu") && mesh.foundObject<volScalarField>("rho")
           && mesh.foundObject<IOdictionary>("mechanicalProperties");
}

const Foam::dictionary& Foam::m4gnSolidDisplacement::controls() const
{
    return mesh_.solutionDict().subDict("stressAnalysis");
}

Foam::string Foam::m4gnSolidDisplacement::cannotStep() const
{
    if (controls().getOrDefault<label>("nCorrectors", 1) < 2) {
        return "nCorrectors of stressAnalysis in fvSolution is 1, so that time steps are not iterated; "
               "needed: as"
               " many as a time step may take (some hundreds), and D, a tolerance";
    }
    if (mesh_.lookupObject<IOdictionary>("thermalProperties").get<bool>("thermalStress")) {
        return "a time step solves for the temperature as well; needed: thermalStress no";
    }
    const fv::optionList* options = mesh_.cfindObject<fv::options>(fv::options::typeName);
    if (options && options->size()) {
        return "fvOptions change the equation; needed: none";
    }
    for (const fvPatchVectorField& patch : D_.boundaryField()) {
        // The values of these follow from the time, the cells and the gradient
        if (!polyPatch::constraintType(patch.patch().type()) && !isA<fixedValueFvPatchVectorField>(patch)
            && !isA<zeroGradientFvPatchVectorField>(patch) && !isA<fixedGradientFvPatchVectorField>(patch))
        {
            return "it is unknown what condition " + patch.type() + " of the patch " + patch.patch().name()
                   + " keeps from one corrector to the next; needed: fixed values or a traction";
        }
    }

    return string();
}

Foam::labelList Foam::m4gnSolidDisplacement::tractions() const
{
    DynamicList<label> found;
    forAll(D_.boundaryField(), patchi) {
        if (isA<fixedGradientFvPatchVectorField>(D_.boundaryField()[patchi])) {
            found.append(patchi);
        }
    }

    return labelList(std::move(found));
}

Foam::tmp<Foam::vectorField> Foam::m4gnSolidDisplacement::unknowns(const labelList& patches) const
{
    DynamicList<vector> all(D_.primitiveField());
    for (const label patchi : patches) {
        const auto& patch = refCast<const fixedGradientFvPatchVectorField>(D_.boundaryField()[patchi]);
        all.append(vectorField(patch.gradient() / patch.patch().deltaCoeffs()));
    }

    return tmp<vectorField>::New(std::move(all));
}

void Foam::m4gnSolidDisplacement::take(const vectorField& unknowns, const labelList& patches)
{
    label i = 0;
    for (vector& value : D_.primitiveFieldRef()) {
        value = unknowns[i++];
    }
    for (const label patchi : patches) {
        auto& patch = refCast<fixedGradientFvPatchVectorField>(D_.boundaryFieldRef()[patchi]);
        forAll(patch, facei) {
            patch.gradient()[facei] = patch.patch().deltaCoeffs()[facei] * unknowns[i++];
        }
        // It counts as updated, so that its gradient stays
        patch.fvPatchVectorField::updateCoeffs();
    }
    D_.correctBoundaryConditions();

    const volTensorField gradD(fvc::grad(D_));
    sigmaD_ = *mu_ * twoSymm(gradD) + (*lambda_ * I) * tr(gradD);
    if (controls().get<bool>("compactNormalStress")) {
        divSigmaExp_ = fvc::div(sigmaD_ - stiffness() * gradD, "div(sigmaD)");
    } else {
        divSigmaExp_ = fvc::div(sigmaD_) - fvc::laplacian(stiffness(), D_, "laplacian(DD,D)");
    }
}

void Foam::m4gnSolidDisplacement::checkConverged() const
{
    List<SolverPerformance<vector>> solves;
    m4gn::solverPerformance(mesh_).readIfPresent(D_.name(), solves);
    const label most = controls().get<label>("nCorrectors");
    if (warned_ || solves.size() < most) {
        return;
    }
    const scalar residual = cmptMax(solves.last().initialResidual());
    const scalar tolerance = controls().get<scalar>("D");
    if (residual > tolerance) {
        WarningInFunction
            << "The solver's last time step ended at nCorrectors " << most << " with a residual of "
            << residual << "; expected at most entry D of stressAnalysis, " << tolerance << nl
            << "    Time steps that are solved ahead are nearer to the solution. Raise nCorrectors,"
            << " or remove m4gnAnderson" << endl;
        warned_ = true;
    }
}

Foam::label Foam::m4gnSolidDisplacement::step(const label most)
{
    checkConverged();

    const volVectorField before("before", D_);
    const volSymmTensorField stressBefore("stressBefore", sigmaD_);
    const volVectorField explicitBefore("explicitBefore", divSigmaExp_);
    const labelList patches(tractions());
    tmp<vectorField> now(unknowns(patches));
    const vectorField unknownsBefore(now());

    const dictionary linear(m4gnMixing::linearControls(mesh_.solverDict(D_.name())));
    const scalar tolerance = controls().get<scalar>("D");

    // As many lines as correctors that are saved
    const label debug = SolverPerformance<vector>::debug;
    SolverPerformance<vector>::debug = 0;

    m4gnMixing mixing(correctorDepth);
    label nCorrectors = 0;
    bool converged = false;
    while (!converged && nCorrectors < most) {
        take(now(), patches);
        fvVectorMatrix equation(
            fvm::d2dt2(D_) == fvm::laplacian(stiffness(), D_, "laplacian(DD,D)") + divSigmaExp_);
        converged = equation.solve(linear).max().initialResidual() <= tolerance;
        ++nCorrectors;

        // The list of a time step's solves becomes text with each of them
        const_cast<dictionary&>(m4gn::solverPerformance(mesh_)).clear();

        const tmp<vectorField> next(unknowns(patches));
        now = converged ? tmp<vectorField>::New(next()) : mixing.next(now(), next());
    }
    SolverPerformance<vector>::debug = debug;

    if (converged) {
        take(now(), patches);
        return nCorrectors;
    }
    take(unknownsBefore, patches);
    D_ == before;
    sigmaD_ == stressBefore;
    divSigmaExp_ == explicitBefore;
    return -1;
}

void Foam::m4gnSolidDisplacement::write(const fvMesh& mesh)
{
    const auto object = [&](const word& name) {
        // Not registered: the solver registers its own
        return IOobject(name, mesh.time().timeName(), mesh, IOobject::NO_READ, IOobject::NO_WRITE, false);
    };
    const volScalarField& rho = mesh.lookupObject<volScalarField>("rho");

    volSymmTensorField sigma(object("sigma"), rho * mesh.lookupObject<volSymmTensorField>("sigmaD"));
    if (mesh.lookupObject<IOdictionary>("thermalProperties").get<bool>("thermalStress")) {
        sigma = sigma
                - I
                      * (rho * mesh.lookupObject<volScalarField>("threeKalpha")
                         * mesh.lookupObject<volScalarField>("T"));
    }
    sigma.write();

    volScalarField(object("sigmaEq"), sqrt(1.5 * magSqr(dev(sigma)))).write();
}
