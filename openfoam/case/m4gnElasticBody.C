// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnElasticBody.H"
#include "m4gnNodes.H"
#include "globalIndex.H"
#include "globalMeshData.H"
#include "StringStream.H"
#include "Time.H"

void Foam::m4gnElasticBody::setPoints()
{
    labelList global(identity(mesh_.nPoints()));

    // Without decomposePar's, points that ranks share are found by their places
    // on the faces between them
    if (Pstream::parRun()
        && !m4gnNodes::procAddressing(mesh_, "pointProcAddressing", mesh_.nPoints(), global)) {
        labelList unique;
        mesh_.globalData().mergePoints(global, unique);
    }

    pointGlobal_.assign(global.begin(), global.end());

    data_.n_points = mesh_.nPoints();
    data_.points = reinterpret_cast<const double*>(mesh_.points().cdata());
    data_.point_global = pointGlobal_.data();
}

void Foam::m4gnElasticBody::setFaces()
{
    faceStart_.push_back(0);
    for (const face& f : mesh_.faces()) {
        facePoints_.insert(facePoints_.end(), f.begin(), f.end());
        faceStart_.push_back(facePoints_.size());
    }

    data_.n_cells = mesh_.nCells();
    data_.n_faces = mesh_.nFaces();
    data_.n_internal_faces = mesh_.nInternalFaces();
    data_.face_start = faceStart_.data();
    data_.face_points = facePoints_.data();
    data_.face_owner = mesh_.faceOwner().cdata();
    data_.face_neighbour = mesh_.faceNeighbour().cdata();
}

void Foam::m4gnElasticBody::setFixed(const labelList& nodeTypes)
{
    labelList held(mesh_.nPoints(), Zero);

    for (const polyPatch& patch : mesh_.boundaryMesh()) {
        const label type = nodeTypes[patch.index()];

        if (type != M4GN_HANDLE && type != M4GN_SYMMETRY) {
            continue;
        }

        forAll(patch, facei) {
            label components = 7;

            if (type == M4GN_SYMMETRY) {
                const vector& area = patch.faceAreas()[facei];
                components = 0;
                for (direction cmpt = 0; cmpt < vector::nComponents; ++cmpt) {
                    if (mag(area[cmpt]) > (1 - 1e-6) * mag(area)) {
                        components = 1 << cmpt;
                    }
                }
                if (!components) {
                    FatalErrorInFunction << "Modes of the elastic body need symmetry planes"
                                         << " normal to x, y or z: a face of patch " << patch.name()
                                         << " has the normal " << area / mag(area) << nl
                                         << "    Turn the mesh, or give operator laplacian"
                                         << exit(FatalError);
                }
            }

            for (const label pointi : patch[facei]) {
                held[pointi] |= components;
            }
        }
    }

    forAll(held, pointi) {
        if (held[pointi]) {
            fixedPoints_.push_back(pointi);
            fixedComponents_.push_back(held[pointi]);
        }
    }

    data_.n_fixed = fixedPoints_.size();
    data_.fixed_point = fixedPoints_.data();
    data_.fixed_components = fixedComponents_.data();
}

Foam::m4gnElasticBody::m4gnElasticBody(const fvMesh& mesh, const dictionary& dict, const labelList& nodeTypes)
    : mesh_(mesh), data_()
{
    for (direction cmpt = 0; cmpt < vector::nComponents; ++cmpt) {
        if (mesh.solutionD()[cmpt] == 1) {
            data_.directions[data_.n_directions++] = cmpt;
        }
    }

    setPoints();
    setFaces();
    setMaterial(dict);
    setFixed(nodeTypes);
    data_.free_body = dict.getOrDefault<bool>("freeBody", false);
}

Foam::string Foam::m4gnElasticBody::describe(const fvMesh& mesh, const word& name)
{
    if (mesh.foundObject<regIOobject>(name)) {
        const auto* D = mesh.findObject<volVectorField>(name);
        OStringStream os;
        os << mesh.lookupObject<regIOobject>(name).type();
        if (D) {
            os << ' ' << D->dimensions();
        }
        return os.str();
    }

    IOobject io(name, mesh.time().timeName(), mesh, IOobject::MUST_READ, IOobject::NO_WRITE, false);

    if (!io.typeHeaderOk<volVectorField>(false)) {
        return string::null;
    }
    if (io.headerClassName() != volVectorField::typeName) {
        return io.headerClassName();
    }

    OStringStream os;
    os << io.headerClassName() << ' ' << volVectorField(io, mesh).dimensions();
    return os.str();
}

Foam::string Foam::m4gnElasticBody::displacement()
{
    OStringStream os;
    os << volVectorField::typeName << ' ' << dimLength;
    return os.str();
}
