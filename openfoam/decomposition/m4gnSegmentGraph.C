// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSegmentGraph.H"
#include "PstreamReduceOps.H"
#include "emptyPolyPatch.H"
#include "syncTools.H"

Foam::label Foam::m4gnSegmentGraph::root(label segment) const
{
    while (parent_[segment] != segment)
    {
        parent_[segment] = parent_[parent_[segment]];
        segment = parent_[segment];
    }
    return segment;
}

void Foam::m4gnSegmentGraph::join(const label a, const label b)
{
    const label first = root(a);
    const label second = root(b);

    // The lowest stands for the group, in whatever order they are joined
    parent_[max(first, second)] = min(first, second);
}

void Foam::m4gnSegmentGraph::combine()
{
    List<labelList> all(Pstream::nProcs());
    all[Pstream::myProcNo()] = parent_;
    Pstream::gatherList(all);
    Pstream::scatterList(all);

    for (const labelList& parents : all)
    {
        forAll(parents, segmenti)
        {
            join(segmenti, parents[segmenti]);
        }
    }
}

void Foam::m4gnSegmentGraph::joinSet(const labelList& faces)
{
    // As decompositionMethod does it: all cells around the faces' points
    labelList touched(count_, Zero);

    for (const label facei : faces)
    {
        for (const label pointi : mesh_.faces()[facei])
        {
            for (const label pFacei : mesh_.pointFaces()[pointi])
            {
                touched[segments_[mesh_.faceOwner()[pFacei]]] = 1;
                if (mesh_.isInternalFace(pFacei))
                {
                    touched[segments_[mesh_.faceNeighbour()[pFacei]]] = 1;
                }
            }
        }
    }

    Pstream::listCombineGather(touched, maxEqOp<label>());
    Pstream::listCombineScatter(touched);

    label first = -1;
    forAll(touched, segmenti)
    {
        if (touched[segmenti])
        {
            first = (first < 0) ? segmenti : first;
            join(first, segmenti);
        }
    }
}

void Foam::m4gnSegmentGraph::number()
{
    group_.resize(count_);
    nGroups_ = 0;

    for (label segmenti = 0; segmenti < count_; ++segmenti)
    {
        const label first = root(segmenti);
        group_[segmenti] =
            (first == segmenti) ? nGroups_++ : group_[first];
    }
}

void Foam::m4gnSegmentGraph::sum(const scalarField& cellWeights)
{
    const label n = nGroups_;

    scalarList sizes(n, Zero);
    scalarList adjacency(n*n, Zero);

    const auto groupOf = [&](const label celli)
    {
        return group_[segments_[celli]];
    };

    const bool weighted =
        returnReduce(cellWeights.size() > 0, orOp<bool>());

    forAll(segments_, celli)
    {
        sizes[groupOf(celli)] += weighted ? cellWeights[celli] : scalar(1);
    }

    for (label facei = 0; facei < mesh_.nInternalFaces(); ++facei)
    {
        const label own = groupOf(mesh_.faceOwner()[facei]);
        const label nei = groupOf(mesh_.faceNeighbour()[facei]);
        adjacency[own*n + nei] += 1;
        adjacency[nei*n + own] += 1;
    }

    for (const polyPatch& pp : mesh_.boundaryMesh())
    {
        forAll(pp, i)
        {
            const label own = groupOf(pp.faceCells()[i]);
            if (pp.coupled())
            {
                const label nei =
                    across_[pp.start() + i - mesh_.nInternalFaces()];
                adjacency[own*n + group_[nei]] += 1;
            }
            else if (!weighted && !isA<emptyPolyPatch>(pp))
            {
                // A boundary face is a node too
                sizes[own] += 1;
            }
        }
    }

    Pstream::listCombineGather(sizes, plusEqOp<scalar>());
    Pstream::listCombineScatter(sizes);
    Pstream::listCombineGather(adjacency, plusEqOp<scalar>());
    Pstream::listCombineScatter(adjacency);

    sizes_.assign(sizes.begin(), sizes.end());
    adjacency_.assign(adjacency.begin(), adjacency.end());
}

Foam::m4gnSegmentGraph::m4gnSegmentGraph
(
    const polyMesh& mesh,
    const labelList& segments,
    const scalarField& cellWeights
)
:
    m4gnSegmentGraph
    (
        mesh,
        segments,
        cellWeights,
        boolList(),
        PtrList<labelList>(),
        labelList(),
        List<labelPair>()
    )
{}

Foam::m4gnSegmentGraph::m4gnSegmentGraph
(
    const polyMesh& mesh,
    const labelList& segments,
    const scalarField& cellWeights,
    const boolList& blockedFace,
    const PtrList<labelList>& specifiedProcessorFaces,
    const labelList& specifiedProcessor,
    const List<labelPair>& explicitConnections
)
:
    mesh_(mesh),
    segments_(segments),
    across_(),
    count_(returnReduce(segments.empty() ? label(-1) : max(segments), maxOp<label>()) + 1),
    parent_(identity(count_)),
    fixed_(count_, -1),
    group_(),
    nGroups_(0)
{
    syncTools::swapBoundaryCellList(mesh_, segments_, across_);

    // Cells on both sides of a face that is not blocked
    forAll(blockedFace, facei)
    {
        if (blockedFace[facei])
        {
            continue;
        }

        const label own = segments_[mesh_.faceOwner()[facei]];

        if (mesh_.isInternalFace(facei))
        {
            join(own, segments_[mesh_.faceNeighbour()[facei]]);
        }
        else
        {
            const label patchi = mesh_.boundaryMesh().whichPatch(facei);
            if (mesh_.boundaryMesh()[patchi].coupled())
            {
                join(own, across_[facei - mesh_.nInternalFaces()]);
            }
        }
    }

    // Cells on both sides of two faces that belong together
    for (const labelPair& faces : explicitConnections)
    {
        const label first = segments_[mesh_.faceOwner()[faces.first()]];

        for (const label facei : {faces.first(), faces.second()})
        {
            join(first, segments_[mesh_.faceOwner()[facei]]);
            if (mesh_.isInternalFace(facei))
            {
                join(first, segments_[mesh_.faceNeighbour()[facei]]);
            }
        }
    }

    for (const labelList& faces : specifiedProcessorFaces)
    {
        joinSet(faces);
    }

    if (Pstream::parRun())
    {
        combine();
    }

    forAll(specifiedProcessorFaces, seti)
    {
        const labelList& faces = specifiedProcessorFaces[seti];
        const label proci = specifiedProcessor[seti];

        const label first = returnReduce
        (
            faces.empty()
          ? label(-1)
          : root(segments_[mesh_.faceOwner()[faces.first()]]),
            maxOp<label>()
        );

        if (first < 0 || proci < 0)
        {
            continue;
        }
        if (fixed_[first] >= 0 && fixed_[first] != proci)
        {
            FatalErrorInFunction
                << "The constraints send cells that must stay together to the"
                << " processors " << fixed_[first] << " and " << proci << nl
                << "    The segments of two of the singleProcessorFaceSets"
                << " are the same or held together. Give both sets the same"
                << " processor, or raise segments so that they have no segment"
                << " in common."
                << exit(FatalError);
        }
        fixed_[first] = proci;
    }

    number();
    sum(cellWeights);
}

std::vector<int32_t> Foam::m4gnSegmentGraph::fixed() const
{
    std::vector<int32_t> ranks(nGroups_, -1);
    forAll(group_, segmenti)
    {
        if (fixed_[segmenti] >= 0)
        {
            ranks[group_[segmenti]] = fixed_[segmenti];
        }
    }
    return ranks;
}
