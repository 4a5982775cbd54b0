// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnNodes.H"
#include "m4gnDictionary.H"
#include "m4gnMeshAdapter.H"
#include "m4gnNodeTypes.H"
#include "m4gnVersion.H"
#include "labelIOList.H"
#include "volFields.H"

static_assert(
    sizeof(Foam::scalar) == sizeof(double) && sizeof(Foam::vector) == 3 * sizeof(double)
        && sizeof(Foam::label) == sizeof(int32_t),
    "m4gn needs an OpenFOAM with double precision and 32-bit labels");

void Foam::m4gnNodes::publishBoundary()
{
    data_.n_boundary = boundaryOwner_.size();
    data_.boundary_owner = boundaryOwner_.data();
    data_.boundary_global = boundaryGlobal_.data();
    data_.boundary_centres = reinterpret_cast<const double*>(boundaryCentres_.cdata());
    data_.boundary_area = reinterpret_cast<const double*>(boundaryArea_.cdata());
    data_.boundary_coeff = boundaryCoeff_.cdata();
    data_.boundary_type = boundaryType_.data();
    data_.boundary_patch = boundaryPatch_.data();
}

void Foam::m4gnNodes::publishCoupled()
{
    data_.n_coupled = coupledOwner_.size();
    data_.coupled_owner = coupledOwner_.data();
    data_.coupled_rank = coupledRank_.data();
    data_.coupled_global = coupledGlobal_.data();
    data_.coupled_delta = reinterpret_cast<const double*>(coupledDelta_.data());
    data_.coupled_coeff = coupledCoeff_.data();
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

Foam::m4gnNodes::m4gnNodes(const fvMesh& mesh) : mesh_(mesh), data_()
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

    return autoPtr<m4gnNodes>(new m4gnMeshAdapter(mesh, nodeTypes.types()));
}

void Foam::m4gnNodes::setModes(const scalarList& eigenvalues, const vectorField& cells)
{
    data_.n_modes = eigenvalues.size();
    data_.mode_eigenvalues = eigenvalues.cdata();
    data_.mode_cells = reinterpret_cast<const double*>(cells.cdata());
}
