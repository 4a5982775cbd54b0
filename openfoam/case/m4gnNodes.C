// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnNodes.H"
#include "m4gnDictionary.H"
#include "m4gnNodeTypes.H"
#include "m4gnVersion.H"
#include "coupledPolyPatch.H"
#include "cyclicFvPatch.H"
#include "globalIndex.H"
#include "labelIOList.H"
#include "laplacianScheme.H"
#include "processorFvPatch.H"
#include "snGradScheme.H"
#include "StringStream.H"
#include "surfaceFields.H"
#include "surfaceInterpolationScheme.H"
#include "syncTools.H"
#include <cmath>

static_assert(
    sizeof(Foam::scalar) == sizeof(double) && sizeof(Foam::vector) == 3 * sizeof(double)
        && sizeof(Foam::label) == sizeof(int32_t),
    "m4gn needs an OpenFOAM with double precision and 32-bit labels");

Foam::FixedList<int32_t, 7> Foam::m4gnNodes::values::exponents(const word& name) const
{
    FixedList<int32_t, 7> integers(0);

    for (int i = 0; i < dimensionSet::nDimensions; ++i) {
        const scalar exponent = dimensions[dimensionSet::dimensionType(i)];

        integers[i] = int32_t(std::lround(exponent));

        if (mag(exponent - integers[i]) > 1e-10) {
            FatalErrorInFunction << "Field " << name << " has the dimensions " << dimensions
                                 << ", and m4gn handles only whole exponents" << exit(FatalError);
        }
    }

    return integers;
}

std::vector<int64_t> Foam::m4gnNodes::places(const labelList& mine)
{
    List<labelList> ofRanks(Pstream::nProcs());
    ofRanks[Pstream::myProcNo()] = mine;
    Pstream::gatherList(ofRanks);

    // Not scatterList: it leaves a rank's own list as the rank has it
    labelList all;
    if (Pstream::master()) {
        DynamicList<label> collected;
        for (const labelList& some : ofRanks) {
            collected.append(some);
        }
        std::sort(collected.begin(), collected.end());
        all.transfer(collected);
    }
    m4gn::broadcast(all);

    std::vector<int64_t> place(mine.size());
    forAll(mine, i) {
        place[i] = std::lower_bound(all.begin(), all.end(), mine[i]) - all.begin();
    }

    return place;
}

bool Foam::m4gnNodes::procAddressing(
    const polyMesh& mesh, const word& name, const label size, labelList& addressing)
{
    const labelIOList stored(IOobject(
        name, mesh.facesInstance(), polyMesh::meshSubDir, mesh, IOobject::READ_IF_PRESENT, IOobject::NO_WRITE,
        false));

    addressing = stored;

    // A rank may be without cells, and without the file
    return returnReduce(
        size == 0 || (stored.headerClassName() == labelIOList::typeName && stored.size() == size),
        andOp<bool>());
}

void Foam::m4gnNodes::setDirections()
{
    const Vector<label>& solved = mesh_.solutionD();

    for (direction cmpt = 0; cmpt < vector::nComponents; ++cmpt) {
        if (solved[cmpt] == 1) {
            data_.directions[data_.n_directions++] = cmpt;
        }
    }

    if (data_.n_directions < 2) {
        FatalErrorInFunction << "The mesh has " << label(data_.n_directions)
                             << " solved directions; m4gn needs 2 or 3." << exit(FatalError);
    }
}

void Foam::m4gnNodes::checkPatches() const
{
    for (const fvPatch& patch : mesh_.boundary()) {
        const word& type = patch.type();

        const bool coupled = patch.coupled();

        // cyclicSlip, cyclicAMI, ... derive from what is handled: by name
        const bool known = coupled ? (type == "processor" || type == "processorCyclic" || type == "cyclic")
                                   : (type == "empty" || m4gnNodeTypes::handles(patch));

        if (!known) {
            m4gnNodeTypes::refuse(patch);
        }

        if (coupled) {
            const auto& pp = refCast<const coupledPolyPatch>(patch.patch());

            if (!pp.parallel()) {
                FatalErrorInFunction << "Patch " << patch.name() << " of type " << type
                                     << " turns vectors (a rotational transform), which m4gn"
                                     << " does not handle." << nl
                                     << "    Handled: translational cyclic patches." << exit(FatalError);
            }
        }
    }
}

void Foam::m4gnNodes::checkCells() const
{
    const scalarField& V = mesh_.cellVolumes();
    const vectorField& C = mesh_.cellCentres();
    const vectorField& S = mesh_.faceAreas();

    forAll(V, celli) {
        if (!(V[celli] > 0)) {
            FatalErrorInFunction << "Cell " << celli << " at " << C[celli] << " is inverted,"
                                 << " flat or folded: expected a positive volume, found " << V[celli] << nl
                                 << "    checkMesh tells more" << exit(FatalError);
        }
    }

    for (label facei = 0; facei < mesh_.nInternalFaces(); ++facei) {
        const label own = mesh_.faceOwner()[facei];
        const label nei = mesh_.faceNeighbour()[facei];

        if (!((S[facei] & (C[nei] - C[own])) > 0)) {
            FatalErrorInFunction << "Cells " << own << " at " << C[own] << " and " << nei << " at " << C[nei]
                                 << ": one is inverted, flat or folded. The"
                                 << " normal of their face, " << S[facei]
                                 << ", does not lead from one to the other" << nl
                                 << "    checkMesh tells more" << exit(FatalError);
        }
    }
}

Foam::tmp<Foam::surfaceScalarField> Foam::m4gnNodes::deltaCoeffs() const
{
    const string text(laplacianScheme(mesh_));

    IStringStream is(text);
    const word laplacian(is);

    if (laplacian != "Gauss") {
        FatalErrorInFunction << "laplacianSchemes: " << text << "is no Gauss scheme. Give"
                             << " m4gn one: \"laplacian(m4gn)\" Gauss linear corrected;" << exit(FatalError);
    }

    // As fv::laplacianScheme reads it
    tmp<surfaceInterpolationScheme<scalar>> interpolation(surfaceInterpolationScheme<scalar>::New(mesh_, is));
    tmp<fv::snGradScheme<scalar>> snGrad(fv::snGradScheme<scalar>::New(mesh_, is));

    // The schemes look at no value of the field
    const volScalarField scratch(
        IOobject("m4gn", mesh_.time().timeName(), mesh_, IOobject::NO_READ, IOobject::NO_WRITE, false), mesh_,
        dimensionedScalar(dimless, Zero));

    return snGrad().deltaCoeffs(scratch) * scalar(1);
}

void Foam::m4gnNodes::setPatches()
{
    DynamicList<label> patches;
    DynamicList<word> names;

    for (const fvPatch& patch : mesh_.boundary()) {
        if (m4gnNodeTypes::carriesValues(patch)) {
            patches.append(patch.index());
            names.append(patch.name());
        }
    }

    valuePatches_.transfer(patches);
    patchNames_.transfer(names);

    for (const word& name : patchNames_) {
        patchNamePtrs_.push_back(name.c_str());
    }

    data_.n_patches = patchNamePtrs_.size();
    data_.patch_names = patchNamePtrs_.data();
}

void Foam::m4gnNodes::setCells()
{
    labelList global;
    const bool decomposed =
        Pstream::parRun() && procAddressing(mesh_, "cellProcAddressing", mesh_.nCells(), global);

    const globalIndex consecutive(mesh_.nCells());

    cellGlobal_.resize(mesh_.nCells());
    forAll(mesh_.C(), celli) {
        cellGlobal_[celli] = decomposed ? global[celli] : consecutive.toGlobal(celli);
    }

    data_.n_cells = mesh_.nCells();
    data_.cell_global = cellGlobal_.data();
    data_.cell_centres = reinterpret_cast<const double*>(mesh_.C().primitiveField().cdata());
    data_.cell_volumes = mesh_.V().field().cdata();

    data_.n_faces = mesh_.nInternalFaces();
    data_.face_owner = mesh_.owner().cdata();
    data_.face_neighbour = mesh_.neighbour().cdata();
}

void Foam::m4gnNodes::setBoundary(const labelList& nodeTypes, const surfaceScalarField& deltaCoeffs)
{
    label nBoundary = 0;
    for (const label patchi : valuePatches_) {
        nBoundary += mesh_.boundary()[patchi].size();
    }

    boundaryOwner_.reserve(nBoundary);
    boundaryType_.reserve(nBoundary);
    boundaryPatch_.reserve(nBoundary);
    boundaryCentres_.resize(nBoundary);
    boundaryArea_.resize(nBoundary);
    boundaryCoeff_.resize(nBoundary);

    label nodei = 0;

    forAll(valuePatches_, i) {
        const fvPatch& patch = mesh_.boundary()[valuePatches_[i]];
        const labelUList& owner = patch.faceCells();
        const vectorField& area = patch.Sf();
        const vectorField& centres = patch.Cf();

        // fvPatchField::gradientInternalCoeffs of a fixed value
        const scalarField coeffs(patch.magSf() * patch.deltaCoeffs());

        forAll(patch, facei) {
            boundaryOwner_.push_back(owner[facei]);
            boundaryType_.push_back(nodeTypes[patch.index()]);
            boundaryPatch_.push_back(i);
            boundaryCentres_[nodei] = centres[facei];
            boundaryArea_[nodei] = area[facei];
            boundaryCoeff_[nodei] = coeffs[facei];
            ++nodei;
        }
    }

    setBoundaryGlobal();

    data_.n_boundary = boundaryOwner_.size();
    data_.boundary_owner = boundaryOwner_.data();
    data_.boundary_global = boundaryGlobal_.data();
    data_.boundary_centres = reinterpret_cast<const double*>(boundaryCentres_.cdata());
    data_.boundary_area = reinterpret_cast<const double*>(boundaryArea_.cdata());
    data_.boundary_coeff = boundaryCoeff_.cdata();
    data_.boundary_type = boundaryType_.data();
    data_.boundary_patch = boundaryPatch_.data();

    faceCoeff_ = deltaCoeffs.primitiveField() * mesh_.magSf().primitiveField();
    data_.face_coeff = faceCoeff_.cdata();
}

void Foam::m4gnNodes::setBoundaryGlobal()
{
    const label nBoundary = boundaryOwner_.size();

    boundaryGlobal_.resize(nBoundary);

    labelList faceGlobal;
    if (!Pstream::parRun() || !procAddressing(mesh_, "faceProcAddressing", mesh_.nFaces(), faceGlobal)) {
        const globalIndex consecutive(nBoundary);
        for (label nodei = 0; nodei < nBoundary; ++nodei) {
            boundaryGlobal_[nodei] = consecutive.toGlobal(nodei);
        }
        return;
    }

    // The undecomposed face of each node. Among all of them in order, its
    // place is the number that a serial run gives: patches are in order of
    // faces there.
    labelList mine(nBoundary);
    label nodei = 0;
    for (const label patchi : valuePatches_) {
        const polyPatch& pp = mesh_.boundaryMesh()[patchi];
        for (label i = 0; i < pp.size(); ++i) {
            mine[nodei++] = mag(faceGlobal[pp.start() + i]) - 1;
        }
    }
    boundaryGlobal_ = places(mine);
}

void Foam::m4gnNodes::setCoupled(const surfaceScalarField& deltaCoeffs)
{
    labelList global(mesh_.nCells());
    forAll(global, celli) {
        global[celli] = cellGlobal_[celli];
    }

    // Cells on the other side, by face - nInternalFaces
    labelList across;
    syncTools::swapBoundaryCellList(mesh_, global, across);

    for (const fvPatch& patch : mesh_.boundary()) {
        if (!patch.coupled()) {
            continue;
        }

        const auto* processor = dynamic_cast<const processorFvPatch*>(&patch);
        const label rank = processor ? processor->neighbProcNo() : Pstream::myProcNo();

        const labelUList& owner = patch.faceCells();
        const vectorField delta(patch.delta());
        const scalarField coeffs(patch.magSf() * deltaCoeffs.boundaryField()[patch.index()]);
        const label start = patch.patch().start() - mesh_.nInternalFaces();

        forAll(patch, facei) {
            coupledOwner_.push_back(owner[facei]);
            coupledRank_.push_back(rank);
            coupledGlobal_.push_back(across[start + facei]);
            coupledDelta_.push_back(delta[facei]);
            coupledCoeff_.push_back(coeffs[facei]);
        }
    }

    data_.n_coupled = coupledOwner_.size();
    data_.coupled_owner = coupledOwner_.data();
    data_.coupled_rank = coupledRank_.data();
    data_.coupled_global = coupledGlobal_.data();
    data_.coupled_delta = reinterpret_cast<const double*>(coupledDelta_.data());
    data_.coupled_coeff = coupledCoeff_.data();
}

Foam::m4gnNodes::m4gnNodes(const fvMesh& mesh, const labelList& nodeTypes) : mesh_(mesh), data_()
{
    setDirections();
    setPatches();
    checkPatches();
    checkCells();

    const tmp<surfaceScalarField> tdeltaCoeffs(deltaCoeffs());

    setCells();
    setBoundary(nodeTypes, tdeltaCoeffs());
    setCoupled(tdeltaCoeffs());
}

Foam::string Foam::m4gnNodes::laplacianScheme(const fvMesh& mesh)
{
    // Read from the registered dictionary: the accessors differ by version
    const dictionary schemes(mesh.lookupObject<IOdictionary>("fvSchemes").subOrEmptyDict("laplacianSchemes"));

    for (const word key : {"laplacian(m4gn)", "default"}) {
        if (schemes.found(key)) {
            OStringStream os;
            const ITstream& is = schemes.lookup(key);
            forAll(is, i) {
                os << is[i] << ' ';
            }

            if (os.str() != "none ") {
                return os.str();
            }
        }
    }

    return "Gauss linear corrected";
}

bool Foam::m4gnNodes::registered(const word& name) const
{
    return mesh_.foundObject<volScalarField>(name) || mesh_.foundObject<volVectorField>(name);
}

Foam::string Foam::m4gnNodes::fieldTypes()
{
    return volScalarField::typeName + " or " + volVectorField::typeName;
}

Foam::string Foam::m4gnNodes::registered() const
{
    wordList names(mesh_.sortedNames<volScalarField>());
    names.append(mesh_.sortedNames<volVectorField>());

    return names.empty() ? "no field of cells" : m4gn::join(names);
}

Foam::autoPtr<Foam::m4gnNodes> Foam::m4gnNodes::New(const fvMesh& mesh, const dictionary& dict)
{
    const m4gnNodeTypes nodeTypes(
        mesh, dict, dict.getOrDefault<word>("U", "U"), dict.getOrDefault<word>("p", "p"),
        dict.getOrDefault<word>("D", "D"));
    nodeTypes.print(mesh);

    return autoPtr<m4gnNodes>(new m4gnNodes(mesh, nodeTypes.types()));
}

void Foam::m4gnNodes::setModes(const scalarList& eigenvalues, const vectorField& cells)
{
    data_.n_modes = eigenvalues.size();
    data_.mode_eigenvalues = eigenvalues.cdata();
    data_.mode_cells = reinterpret_cast<const double*>(cells.cdata());
}

template <class Type> bool Foam::m4gnNodes::gatherOf(const word& name, values& to) const
{
    autoPtr<fieldOf<Type>> owned;
    const fieldOf<Type>* field = find(mesh_, name, owned);

    if (!field) {
        return false;
    }

    to.components = pTraits<Type>::nComponents;
    to.dimensions.reset(field->dimensions());
    to.boundary.resize(to.components * nBoundary());
    auto* boundary = reinterpret_cast<Type*>(to.boundary.data());
    for (const label patchi : valuePatches_) {
        const Field<Type>& patch = field->boundaryField()[patchi];
        boundary = std::copy(patch.begin(), patch.end(), boundary);
    }

    to.cells = reinterpret_cast<const scalar*>(field->primitiveField().cdata());
    if (owned) {
        to.copy.resize(to.components * field->size());
        std::copy(to.cells, to.cells + to.copy.size(), to.copy.begin());
        to.cells = to.copy.cdata();
    }

    return true;
}

template <class Type> void Foam::m4gnNodes::imposeOf(const word& name, const scalarField& nodes) const
{
    auto& field = mesh_.lookupObjectRef<fieldOf<Type>>(name);

    // Stores the old time before it gives access
    Field<Type>& imposed = field.primitiveFieldRef();

    const auto* of = reinterpret_cast<const Type*>(nodes.cdata());
    std::copy(of, of + imposed.size(), imposed.begin());
}

bool Foam::m4gnNodes::gather(const word& name, values& to) const
{
    return gatherOf<scalar>(name, to) || gatherOf<vector>(name, to);
}

void Foam::m4gnNodes::impose(const word& name, const label components, const scalarField& nodes) const
{
    components == 1 ? imposeOf<scalar>(name, nodes) : imposeOf<vector>(name, nodes);
}
