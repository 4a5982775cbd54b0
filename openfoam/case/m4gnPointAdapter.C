// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnPointAdapter.H"
#include "m4gnDictionary.H"
#include "globalIndex.H"
#include "processorFvPatch.H"
#include "PstreamBuffers.H"
#include "volFields.H"
#include <map>

namespace
{
using namespace Foam;

//- An end of an edge
struct edgeEnd
{
    label rank;
    label global;
    point position;
};

//- An edge, by the smaller of its ends' numbers, and what cells of all ranks
//  add to its coefficient
struct meshEdge
{
    edgeEnd first, second;
    scalar coeff;
};

typedef std::map<std::pair<label, label>, meshEdge> edgeMap;

void add(edgeMap& edges, const meshEdge& e)
{
    const auto inserted = edges.insert({std::make_pair(e.first.global, e.second.global), e});

    if (!inserted.second) {
        inserted.first->second.coeff += e.coeff;
    }
}

Ostream& operator<<(Ostream& os, const edgeEnd& e)
{
    return os << e.rank << token::SPACE << e.global << token::SPACE << e.position;
}

Istream& operator>>(Istream& is, edgeEnd& e) { return is >> e.rank >> e.global >> e.position; }

} // End anonymous namespace

void Foam::m4gnPointAdapter::checkMesh() const
{
    if (data_.n_directions != 3) {
        FatalErrorInFunction << "location points needs a mesh of three directions; this one is"
                             << " two-dimensional (empty patches)" << exit(FatalError);
    }

    for (const fvPatch& patch : mesh_.boundary()) {
        if (patch.coupled() && patch.type() != processorFvPatch::typeName) {
            FatalErrorInFunction << "Patch " << patch.name() << " is of type " << patch.type()
                                 << ", which location points does not handle" << nl
                                 << "    Handled: all that do not couple, and processor" << exit(FatalError);
        }
    }
}

void Foam::m4gnPointAdapter::setPoints()
{
    const label nPoints = mesh_.nPoints();

    rank_ = labelList(nPoints, Pstream::myProcNo());
    syncTools::syncPointList(mesh_, rank_, minEqOp<label>(), labelMax);

    node_ = labelList(nPoints, -1);
    DynamicList<label> mine(nPoints);
    forAll(rank_, pointi) {
        if (rank_[pointi] == Pstream::myProcNo()) {
            node_[pointi] = mine.size();
            mine.append(pointi);
        }
    }
    points_.transfer(mine);

    if (!Pstream::parRun() || !procAddressing(mesh_, "pointProcAddressing", nPoints, global_)) {
        const globalIndex consecutive(points_.size());

        global_ = labelList(nPoints, -1);
        forAll(points_, nodei) {
            global_[points_[nodei]] = consecutive.toGlobal(nodei);
        }
        syncTools::syncPointList(mesh_, global_, maxEqOp<label>(), label(-1));
    }

    pointVolumes_ = scalarField(nPoints, Zero);
    const labelListList& cellPoints = mesh_.cellPoints();
    forAll(cellPoints, celli) {
        for (const label pointi : cellPoints[celli]) {
            pointVolumes_[pointi] += mesh_.V()[celli] / cellPoints[celli].size();
        }
    }
    syncTools::syncPointList(mesh_, pointVolumes_, plusEqOp<scalar>(), scalar(0));

    for (const label pointi : points_) {
        nodeGlobal_.push_back(global_[pointi]);
    }
    centres_ = vectorField(mesh_.points(), points_);
    volumes_ = scalarField(pointVolumes_, points_);

    data_.n_cells = points_.size();
    data_.cell_global = nodeGlobal_.data();
    data_.cell_centres = reinterpret_cast<const double*>(centres_.cdata());
    data_.cell_volumes = volumes_.cdata();
}

void Foam::m4gnPointAdapter::setEdges()
{
    const edgeList& edges = mesh_.edges();
    const labelListList& cellEdges = mesh_.cellEdges();

    scalarField coeffs(edges.size(), Zero);
    forAll(cellEdges, celli) {
        const scalar share = 3 * mesh_.V()[celli] / cellEdges[celli].size();
        for (const label edgei : cellEdges[celli]) {
            const scalar length = edges[edgei].mag(mesh_.points());
            coeffs[edgei] += share / sqr(length);
        }
    }

    // A rank need not have the edges of its nodes, nor all of their cells:
    // whoever has them tells the ranks of both ends
    edgeMap known;
    List<DynamicList<label>> tell(Pstream::nProcs());

    const auto described = [&](const label edgei) {
        label a = edges[edgei].start();
        label b = edges[edgei].end();
        if (global_[a] > global_[b]) {
            Swap(a, b);
        }

        return meshEdge{
            {rank_[a], global_[a], mesh_.points()[a]},
            {rank_[b], global_[b], mesh_.points()[b]},
            coeffs[edgei]};
    };

    forAll(edges, edgei) {
        const meshEdge e(described(edgei));

        for (const label rank : {e.first.rank, e.second.rank}) {
            if (rank == Pstream::myProcNo()) {
                continue;
            }
            if (tell[rank].empty() || tell[rank].last() != edgei) {
                tell[rank].append(edgei);
            }
        }

        if (e.first.rank == Pstream::myProcNo() || e.second.rank == Pstream::myProcNo()) {
            add(known, e);
        }
    }

    if (Pstream::parRun()) {
        PstreamBuffers buffers(Pstream::commsTypes::nonBlocking);
        forAll(tell, rank) {
            if (tell[rank].size()) {
                UOPstream os(rank, buffers);
                os << tell[rank].size();
                for (const label edgei : tell[rank]) {
                    const meshEdge e(described(edgei));
                    os << e.first << e.second << e.coeff;
                }
            }
        }

        labelList sizes;
        buffers.finishedSends(sizes);
        forAll(sizes, rank) {
            if (sizes[rank] && rank != Pstream::myProcNo()) {
                UIPstream is(rank, buffers);
                for (label n = readLabel(is); n > 0; --n) {
                    meshEdge e;
                    is >> e.first >> e.second >> e.coeff;
                    add(known, e);
                }
            }
        }
    }

    Map<label> nodeOf(2 * points_.size());
    forAll(points_, nodei) {
        nodeOf.insert(global_[points_[nodei]], nodei);
    }

    for (const auto& item : known) {
        const meshEdge& e = item.second;
        const bool first = e.first.rank == Pstream::myProcNo();

        if (first && e.second.rank == Pstream::myProcNo()) {
            owner_.push_back(nodeOf[e.first.global]);
            neighbour_.push_back(nodeOf[e.second.global]);
            coeff_.push_back(e.coeff);
            continue;
        }

        const edgeEnd& own = first ? e.first : e.second;
        const edgeEnd& other = first ? e.second : e.first;
        coupledOwner_.push_back(nodeOf[own.global]);
        coupledRank_.push_back(other.rank);
        coupledGlobal_.push_back(other.global);
        coupledDelta_.push_back(other.position - own.position);
        coupledCoeff_.push_back(e.coeff);
    }

    data_.n_faces = owner_.size();
    data_.face_owner = owner_.data();
    data_.face_neighbour = neighbour_.data();
    data_.face_coeff = coeff_.data();

    publishCoupled();
}

void Foam::m4gnPointAdapter::setBoundary(const labelList& nodeTypes)
{
    const auto priority = [&](const label type) {
        return type == M4GN_HANDLE ? 0 : type == M4GN_SYMMETRY ? 1 : 2;
    };

    // Of the patches of a point, the one with the lowest number counts
    const label nPatches = valuePatches_.size();
    labelList best(mesh_.nPoints(), labelMax);
    vectorField area(mesh_.nPoints(), Zero);

    forAll(valuePatches_, i) {
        const polyPatch& patch = mesh_.boundaryMesh()[valuePatches_[i]];
        const label number = priority(nodeTypes[patch.index()]) * nPatches + i;

        for (const label pointi : patch.meshPoints()) {
            best[pointi] = min(best[pointi], number);
        }

        forAll(patch, facei) {
            const vector share(patch.faceAreas()[facei] / patch[facei].size());
            for (const label pointi : patch[facei]) {
                area[pointi] += share;
            }
        }
    }

    syncTools::syncPointList(mesh_, best, minEqOp<label>(), labelMax);
    syncTools::syncPointList(mesh_, area, plusEqOp<vector>(), vector(Zero));

    DynamicList<label> points;
    DynamicList<label> numbers;
    for (const label pointi : points_) {
        if (best[pointi] != labelMax) {
            const label patch = best[pointi] % nPatches;

            points.append(pointi);
            numbers.append(global_[pointi]);
            boundaryOwner_.push_back(node_[pointi]);
            boundaryPatch_.push_back(patch);
            boundaryType_.push_back(nodeTypes[valuePatches_[patch]]);
        }
    }
    boundaryPoints_.transfer(points);

    boundaryGlobal_ = places(numbers);
    boundaryCentres_ = vectorField(mesh_.points(), boundaryPoints_);
    boundaryArea_ = vectorField(area, boundaryPoints_);
    boundaryCoeff_ = magSqr(boundaryArea_) / scalarField(pointVolumes_, boundaryPoints_);

    publishBoundary();
}

Foam::m4gnPointAdapter::m4gnPointAdapter(const fvMesh& mesh, const labelList& nodeTypes) : m4gnNodes(mesh)
{
    checkMesh();
    setPoints();
    setEdges();
    setBoundary(nodeTypes);
}

template <class Type> bool Foam::m4gnPointAdapter::gatherOf(const word& name, values& to) const
{
    autoPtr<fieldOf<Type>> owned;
    const fieldOf<Type>* field = find(mesh_, name, owned);

    if (!field) {
        return false;
    }

    const Field<Type>& all = field->primitiveField();
    describe(field->dimensions(), Field<Type>(all, boundaryPoints_), to);
    to.copy = flat(Field<Type>(all, points_));
    to.cells = to.copy.cdata();

    return true;
}

template <class Type> void Foam::m4gnPointAdapter::imposeOf(const word& name, const scalarField& nodes) const
{
    Field<Type> all(mesh_.nPoints(), Zero);

    const auto* of = reinterpret_cast<const Type*>(nodes.cdata());
    forAll(points_, nodei) {
        all[points_[nodei]] = of[nodei];
    }

    // One rank has the value, the others zero
    syncTools::syncPointList(mesh_, all, plusEqOp<Type>(), pTraits<Type>::zero);

    auto& field = mesh_.lookupObjectRef<fieldOf<Type>>(name);

    // Stores the old time before it gives access
    field.primitiveFieldRef() = all;
    field.correctBoundaryConditions();
}

bool Foam::m4gnPointAdapter::gather(const word& name, values& to) const
{
    return gatherOf<scalar>(name, to) || gatherOf<vector>(name, to);
}

void Foam::m4gnPointAdapter::impose(const word& name, const label components, const scalarField& nodes) const
{
    components == 1 ? imposeOf<scalar>(name, nodes) : imposeOf<vector>(name, nodes);
}
