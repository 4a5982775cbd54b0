// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSegmentGraph.H"
#include "m4gnVersion.H"
#include "PstreamReduceOps.H"
#include "emptyPolyPatch.H"
#include "syncTools.H"

Foam::m4gnSegmentGraph::m4gnSegmentGraph(
    const polyMesh& mesh, const labelList& segments, const scalarField& cellWeights)
{
    // Segments of the cells on the other side, by face - nInternalFaces
    labelList across;
    syncTools::swapBoundaryCellList(mesh, segments, across);

    const label n = returnReduce(segments.empty() ? label(-1) : max(segments), maxOp<label>()) + 1;
    const bool weighted = returnReduce(cellWeights.size() > 0, orOp<bool>());

    scalarList sizes(n, Zero);
    scalarList adjacency(n * n, Zero);

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

    sizes_.assign(sizes.begin(), sizes.end());
    adjacency_.assign(adjacency.begin(), adjacency.end());
}
