// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnAddressing.H"
#include "labelIOList.H"
#include "polyMesh.H"
#include "PstreamReduceOps.H"

bool Foam::m4gn::procAddressing
(
    const polyMesh& mesh,
    const word& name,
    const label size,
    labelList& addressing
)
{
    const labelIOList stored
    (
        IOobject
        (
            name,
            mesh.facesInstance(),
            polyMesh::meshSubDir,
            mesh,
            IOobject::READ_IF_PRESENT,
            IOobject::NO_WRITE,
            false
        )
    );

    addressing = stored;

    // A rank may be without cells, and without the file
    return returnReduce
    (
        size == 0
     || (stored.headerClassName() == labelIOList::typeName && stored.size() == size),
        andOp<bool>()
    );
}
