// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolids4FoamLaw.H"
#include "addToRunTimeSelectionTable.H"
#include "fvm.H"
#include "lookupSolidModel.H"
#include "m4gnMechanicalProperties.H"
#include "m4gnSolidsBuild.H"
#include "SHA1.H"
#include <dlfcn.h>
#include <fstream>

namespace Foam
{
defineTypeNameAndDebug(m4gnSolids4FoamLaw, 0);
addToRunTimeSelectionTable(m4gnSolidLaw, m4gnSolids4FoamLaw, mesh);
}

namespace
{
using namespace Foam;

//- Set a field and its boundary values; its old level has those of before
template <class Type>
void set(
    GeometricField<Type, fvPatchField, volMesh>& field,
    const tmp<GeometricField<Type, fvPatchField, volMesh>>& values)
{
    field.oldTime();
    field == values;
}

//- Set a field, if it is there
template <class Type>
void setIfFound(
    const fvMesh& mesh, const word& name, const tmp<GeometricField<Type, fvPatchField, volMesh>>& values)
{
    auto* field = mesh.getObjectPtr<GeometricField<Type, fvPatchField, volMesh>>(name);
    if (field) {
        set(*field, values);
    }
    values.clear();
}

//- Digest of the library that the solver has loaded, as CMake makes it
string digest()
{
    Dl_info where;
    if (!::dladdr(&solidModel::typeName, &where) || !where.dli_fname) {
        return string();
    }

    std::ifstream file(where.dli_fname, std::ios::binary);
    SHA1 sha;
    std::vector<char> part(1 << 16);
    while (file.read(part.data(), part.size()) || file.gcount()) {
        sha.append(part.data(), file.gcount());
    }

    return sha.str();
}

} // End anonymous namespace

Foam::mechanicalModel& Foam::m4gnSolids4FoamLaw::mechanical()
{
    // The model hands it out to its own classes only
    return const_cast<mechanicalModel&>(const_cast<const solidModel&>(*solid_).mechanical());
}

bool Foam::m4gnSolids4FoamLaw::solvesPressure() const
{
    // A solid that only conducts heat has none
    for (const dictionary& law : m4gnMechanicalProperties(mesh_).lawEntries()) {
        if (law.getOrDefault<bool>("solvePressureEqn", false)) {
            return true;
        }
    }

    return false;
}

Foam::scalar Foam::m4gnSolids4FoamLaw::strain(const bool graded)
{
    solidModel& solid = *solid_;
    const dimensionedTensor one("one", dimless, tensor::I);

    if (!graded) {
        mechanical().grad(solid.solutionD(), solid.incremental() ? solid.gradDD() : solid.gradD());
    }
    if (solid.incremental()) {
        solid.D() == solid.D().oldTime() + solid.DD();
        if (!solid.movingMesh()) {
            set(solid.gradD(), solid.gradD().oldTime() + solid.gradDD());
        }
    }

    auto* F = mesh_.getObjectPtr<volTensorField>("F");
    if (!F || solid.nonLinGeom() == nonLinearGeometry::LINEAR_GEOMETRY) {
        return 1;
    }

    volScalarField& J = mesh_.lookupObjectRef<volScalarField>("J");

    if (solid.movingMesh()) {
        const volTensorField relF(one + solid.gradDD().T());
        const volScalarField relJ(det(relF));

        set(*F, relF & F->oldTime());
        set(J, relJ * J.oldTime());
        setIfFound(mesh_, "relF", tmp<volTensorField>(1.0 * relF));
        setIfFound(mesh_, "relJ", tmp<volScalarField>(1.0 * relJ));

        const scalar smallest = min(relJ).value();
        if (smallest > SMALL) {
            setIfFound(mesh_, "relFinv", inv(relF));
        }
        return smallest;
    }

    set(*F, one + solid.gradD().T());
    set(J, det(*F));

    // Its boundary values too, on all ranks
    const scalar smallest = min(J).value();
    if (smallest > SMALL) {
        setIfFound(mesh_, "Finv", inv(*F));
    }

    return smallest;
}

bool Foam::m4gnSolids4FoamLaw::stress(const bool graded)
{
    if (strain(graded) <= SMALL) {
        return false;
    }

    autoPtr<volScalarField> diagonal;
    if (impKf_) {
        // What the solver has for it at this point of a corrector
        volVectorField& u = solid_->solutionD();
        const fvVectorMatrix equation(
            fvm::d2dt2(const_cast<const solidModel&>(*solid_).rho(), u)
            == fvm::laplacian(*impKf_, u, "laplacian(DD,D)"));
        diagonal.reset(new volScalarField("DEqnA", equation.A()));
    }

    mechanical().correct(solid_->sigma());

    return true;
}

Foam::string Foam::m4gnSolids4FoamLaw::mismatch() const
{
    if (!solid_) {
        return "libm4gnSolids4Foam.so was built with another"
               " libsolids4FoamModels.so than the one that the solver has loaded";
    }

    return string();
}

Foam::m4gnSolids4FoamLaw::m4gnSolids4FoamLaw(const fvMesh& mesh)
    : mesh_(mesh), solid_(nullptr), warning_(false)
{
    // Classes of another build may be laid out in another way
    if (digest() != M4GN_SOLIDS4FOAM_DIGEST) {
        return;
    }

    solid_ = const_cast<solidModel*>(&lookupSolidModel(mesh));
    if (solvesPressure()) {
        impKf_.reset(new surfaceScalarField(mechanical().impKf()));
    }
}

bool Foam::m4gnSolids4FoamLaw::follow()
{
    solidModel& solid = *solid_;
    solid.enforceLinear() = false;

    if (!agree()) {
        if (!warning_) {
            warning_ = true;
            WarningInFunction << "No boundary values were found with which the stress of the"
                              << " surrogate's displacement agrees, or it turns cells inside"
                              << " out: stresses of such states stay as they were, and boundary"
                              << " values are extrapolated" << endl;
        }
        return false;
    }

    solid.DD() = solid.D() - solid.D().oldTime();
    solid.gradDD() = solid.gradD() - solid.gradD().oldTime();
    solid.pointD().oldTime();
    mechanical().interpolate(solid.D(), solid.gradD(), solid.pointD());
    solid.pointDD() = solid.pointD() - solid.pointD().oldTime();

    return true;
}

void Foam::m4gnSolids4FoamLaw::write() const { solid_->writeFields(mesh_.time()); }
