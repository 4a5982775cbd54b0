// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnDecomp.H"
#include "addToRunTimeSelectionTable.H"
#include "fvMesh.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnSegmentField.H"
#include "m4gnSegmentation.H"
#include "m4gnVersion.H"
#include "PstreamReduceOps.H"
#include "emptyPolyPatch.H"
#include "syncTools.H"

namespace Foam
{
defineTypeNameAndDebug(m4gnDecomp, 0);
addToRunTimeSelectionTable(decompositionMethod, m4gnDecomp, dictionary);
#ifdef M4GN_DECOMPOSITION_REGION_TABLE
addToRunTimeSelectionTable(decompositionMethod, m4gnDecomp, dictionaryRegion);
#endif
}

namespace Foam
{
//- The graph of the segments over all ranks: the work of each, which is its
//  nodes where there are no weights, and the faces from one to another.
//  Collective.
static void segmentGraph(
    const polyMesh& mesh, const labelList& segments, const scalarField& cellWeights, scalarList& sizes,
    scalarList& adjacency)
{
    // Segments of the cells on the other side, by face - nInternalFaces
    labelList across;
    syncTools::swapBoundaryCellList(mesh, segments, across);

    const label n = returnReduce(segments.empty() ? label(-1) : max(segments), maxOp<label>()) + 1;
    const bool weighted = returnReduce(cellWeights.size() > 0, orOp<bool>());

    sizes = scalarList(n, Zero);
    adjacency = scalarList(n * n, Zero);

    forAll(segments, celli) {
        sizes[segments[celli]] += weighted ? cellWeights[celli] : scalar(1);
    }

    for (label facei = 0; facei < mesh.nInternalFaces(); ++facei) {
        const label own = segments[mesh.faceOwner()[facei]];
        const label nei = segments[mesh.faceNeighbour()[facei]];
        adjacency[own * n + nei] += 1;
        adjacency[nei * n + own] += 1;
    }

    for (const polyPatch& pp : mesh.boundaryMesh()) {
        forAll(pp, i) {
            const label own = segments[pp.faceCells()[i]];
            if (pp.coupled()) {
                const label nei = across[pp.start() + i - mesh.nInternalFaces()];
                adjacency[own * n + nei] += 1;
            } else if (!weighted && !isA<emptyPolyPatch>(pp)) {
                // A boundary face is a node too
                sizes[own] += 1;
            }
        }
    }

    Pstream::listCombineGather(sizes, plusEqOp<scalar>());
    m4gn::broadcast(sizes);
    Pstream::listCombineGather(adjacency, plusEqOp<scalar>());
    m4gn::broadcast(adjacency);
}

} // End namespace Foam

void Foam::m4gnDecomp::read()
{
    m4gnSegmentation::checkDictionary(segmentEntries());

    const scalarList weights(coeffs_.getOrDefault<scalarList>("processorWeights", scalarList()));

    if (weights.size() && weights.size() != nDomains_) {
        FatalIOErrorInFunction(coeffs_) << "processorWeights has " << weights.size() << " entries, and"
                                        << " there are " << nDomains_ << " subdomains" << exit(FatalIOError);
    }

    for (const scalar weight : weights) {
        if (!(weight > 0 && weight < GREAT)) {
            FatalIOErrorInFunction(coeffs_) << "processorWeights has the entry " << weight
                                            << "; expected positive numbers" << exit(FatalIOError);
        }
    }

    weights_.assign(weights.begin(), weights.end());
}

Foam::dictionary Foam::m4gnDecomp::segmentEntries() const
{
    // A dictionary "coeffs" may have entries of other methods
    return m4gn::without(
        coeffs_, {"processorWeights", "n", "delta", "order", "transform", "dataFile", "strategy", "domains",
                  "cellWeightsFile", "writeGraph"});
}

const Foam::fvMesh& Foam::m4gnDecomp::volumeMesh(const polyMesh& mesh) const
{
    const auto* fv = dynamic_cast<const fvMesh*>(&mesh);

    if (!fv) {
        FatalErrorInFunction << "Method " << type() << " needs a finite-volume mesh; " << mesh.name()
                             << " is none." << nl << "    Use hierarchical or simple here."
                             << exit(FatalError);
    }

    return *fv;
}

Foam::labelList Foam::m4gnDecomp::distribute(
    const polyMesh& mesh, const labelList& segments, const scalarField& cellWeights) const
{
    scalarList sizes, adjacency;
    segmentGraph(mesh, segments, cellWeights, sizes, adjacency);
    const label nSegments = sizes.size();

    if (nSegments < nDomains_) {
        FatalErrorInFunction << "Method " << type() << ": " << nSegments << " segments for " << nDomains_
                             << " subdomains: each needs at least one." << nl << "    Raise count in "
                             << typeName << "Coeffs (and"
                             << " remove " << m4gn::segmentName << " if it is stored),"
                             << " or use fewer subdomains." << exit(FatalError);
    }

    std::vector<int32_t> ranks(nSegments);
    m4gn_rank_report report;
    m4gn::check(
        m4gn_segment_ranks(
            nSegments, sizes.cdata(), adjacency.cdata(), nDomains_,
            weights_.empty() ? nullptr : weights_.data(), ranks.data(), &report),
        "Method m4gn cannot give the segments to ranks");

    Info << "m4gn: " << nSegments << " segments on " << nDomains_ << " processors: " << report.cut
         << " faces between processors, largest load " << report.imbalance << " of its share" << endl;

    labelList decomposition(segments.size());
    forAll(segments, celli) {
        decomposition[celli] = ranks[segments[celli]];
    }
    return decomposition;
}

#ifdef M4GN_DECOMPOSITION_REGION_TABLE
Foam::m4gnDecomp::m4gnDecomp(const dictionary& decompDict)
    : decompositionMethod(decompDict), coeffs_(findCoeffsDict(typeName + "Coeffs", selectionType::NULL_DICT))
{
    read();
}
#endif

Foam::m4gnDecomp::m4gnDecomp(const dictionary& decompDict, const word& regionName)
    : decompositionMethod(decompDict, regionName),
      coeffs_(findCoeffsDict(typeName + "Coeffs", selectionType::NULL_DICT))
{
    read();
}

Foam::labelList Foam::m4gnDecomp::decompose(
    const polyMesh& mesh, const pointField& points, const scalarField& pointWeights) const
{
    if (returnReduce(
            points.size() != mesh.nCells() || (pointWeights.size() && pointWeights.size() != mesh.nCells()),
            orOp<bool>()))
    {
        FatalErrorInFunction << "Method " << type() << " decomposes cells, and there are " << points.size()
                             << " points for " << mesh.nCells() << " cells." << nl
                             << "    Use hierarchical or simple here." << exit(FatalError);
    }

    const m4gnSegmentation segmentation(volumeMesh(mesh), segmentEntries(), false);
    const labelList segments(segmentation.cells());

    const labelList decomposition(distribute(mesh, segments, pointWeights));

    segmentation.store(mesh.time().timeName());

    return decomposition;
}

Foam::labelList Foam::m4gnDecomp::withoutMesh() const
{
    FatalErrorInFunction << "Method " << type() << " needs a mesh; it cannot decompose a"
                         << " graph of agglomerated cells." << nl << "    Use hierarchical or simple here."
                         << exit(FatalError);

    return labelList();
}

Foam::labelList Foam::m4gnDecomp::decompose(
    const polyMesh& mesh, const scalarField& cellWeights, const boolList&, const PtrList<labelList>&,
    const labelList&, const List<labelPair>&) const
{
    // The caller applies the constraints, which may move cells out of their
    // segment
    return decompose(mesh, mesh.cellCentres(), cellWeights);
}
