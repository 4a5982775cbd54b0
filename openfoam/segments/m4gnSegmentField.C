/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnSegmentField.H"
#include "m4gnFieldFiles.H"
#include "IFstream.H"
#include "OSspecific.H"
#include "PstreamReduceOps.H"
#include "Time.H"
#include "emptyPolyPatch.H"
#include "labelIOList.H"
#include "processorPolyPatch.H"
#include "zeroGradientFvPatchFields.H"
#include <cmath>

// * * * * * * * * * * * * * * Static Data Members * * * * * * * * * * * * * //

const Foam::word Foam::m4gn::segmentName("m4gnSegment");


// * * * * * * * * * * * * * * * Local Functions * * * * * * * * * * * * * * //

namespace Foam
{

//- Labels from a scalar field
static void round(const UList<scalar>& values, List<int32_t>& segments)
{
    segments.resize(values.size());
    forAll(values, celli)
    {
        segments[celli] = int32_t(std::lround(values[celli]));
    }
}


//- From this rank's own folders
static bool readOwn
(
    const fvMesh& mesh,
    List<int32_t>& segments,
    fileName& from
)
{
    word instance
    (
        mesh.time().findInstance
        (
            mesh.dbDir(),
            m4gn::segmentName,
            IOobject::READ_IF_PRESENT
        )
    );
    Pstream::scatter(instance);

    IOobject io
    (
        m4gn::segmentName,
        instance,
        mesh,
        IOobject::MUST_READ,
        IOobject::NO_WRITE,
        false
    );

    // A rank without cells, as redistributePar has them, may be without the
    // file
    const bool found = io.typeHeaderOk<volScalarField>(true, false);

    if
    (
        !returnReduce(found || mesh.nCells() == 0, andOp<bool>())
     || !returnReduce(found, orOp<bool>())
    )
    {
        return false;
    }

    segments.clear();
    if (found)
    {
        const volScalarField stored(io, mesh);
        round(stored.primitiveField(), segments);
    }
    from = fileName(instance)/m4gn::segmentName;

    return true;
}


//- The last file of the undecomposed case that is not later than now
static fileName findUndecomposed(const fvMesh& mesh)
{
    const Time& time = mesh.time();
    const instantList times
    (
        Time::findTimes(time.globalPath(), time.constant())
    );

    forAllReverse(times, i)
    {
        const bool late =
            times[i].name() != time.constant()
         && times[i].value() > time.value() + 0.5*time.deltaTValue();

        const fileName file
        (
            time.globalPath()/times[i].name()/mesh.dbDir()/m4gn::segmentName
        );

        if (!late && isFile(file))
        {
            return file;
        }
    }

    return fileName();
}


//- From the undecomposed case
static bool readUndecomposed
(
    const fvMesh& mesh,
    List<int32_t>& segments,
    fileName& from
)
{
    fileName file;
    if (Pstream::master())
    {
        file = findUndecomposed(mesh);
    }
    Pstream::scatter(file);

    labelList global;
    if (file.empty() || !m4gn::cellAddressing(mesh, global))
    {
        return false;
    }

    const label nCells = returnReduce(mesh.nCells(), sumOp<label>());

    scalarField whole;
    if (Pstream::master())
    {
        IFstream is(file);
        IOobject io(m4gn::segmentName, mesh.time().constant(), mesh.time());
        if (!io.readHeader(is))
        {
            FatalIOErrorInFunction(is)
                << "No header of an OpenFOAM file" << exit(FatalIOError);
        }
        const dictionary dict(is);
        whole = scalarField("internalField", dict, nCells);
    }
    Pstream::scatter(whole);

    round(scalarField(whole, global), segments);
    from = file;

    return true;
}


//- To the undecomposed case, from the ranks of a case that decomposePar made
static void writeUndecomposed
(
    const volScalarField& field,
    const labelList& global
)
{
    const fvMesh& mesh = field.mesh();
    const Time& time = mesh.time();

    List<labelList> cells(Pstream::nProcs());
    List<scalarField> values(Pstream::nProcs());
    cells[Pstream::myProcNo()] = global;
    values[Pstream::myProcNo()] = field.primitiveField();
    Pstream::gatherList(cells);
    Pstream::gatherList(values);

    if (!Pstream::master())
    {
        return;
    }

    fileName instance(time.globalPath()/field.instance());
    if (!isDir(instance))
    {
        // A new time folder there would be taken for the latest time
        instance = time.globalPath()/time.constant();
    }
    if (!isDir(instance))
    {
        return;
    }

    label nCells = 0;
    for (const labelList& some : cells)
    {
        nCells += some.size();
    }
    scalarField whole(nCells);
    forAll(cells, proci)
    {
        UIndirectList<scalar>(whole, cells[proci]) = values[proci];
    }

    m4gnFieldFiles files;
    files.write
    (
        time,
        instance/mesh.dbDir()/field.name(),
        [&](Ostream& os)
        {
            field.writeHeader(os, volScalarField::typeName);
            os.writeEntry("dimensions", field.dimensions());
            os  << nl;
            whole.writeEntry("internalField", os);
            os  << nl;
            os.beginBlock("boundaryField");
            for (const polyPatch& pp : mesh.boundaryMesh())
            {
                if (!isA<processorPolyPatch>(pp))
                {
                    os.beginBlock(pp.name());
                    os.writeEntry
                    (
                        "type",
                        polyPatch::constraintType(pp.type())
                      ? pp.type()
                      : zeroGradientFvPatchScalarField::typeName
                    );
                    os.endBlock();
                }
            }
            os.endBlock();
            IOobject::writeEndDivider(os);
        }
    );
    files.rename();
}

} // End namespace Foam


// * * * * * * * * * * * * * * * * Functions * * * * * * * * * * * * * * * * //

bool Foam::m4gn::cellAddressing(const fvMesh& mesh, labelList& global)
{
    const labelIOList addressing
    (
        IOobject
        (
            "cellProcAddressing",
            mesh.facesInstance(),
            polyMesh::meshSubDir,
            mesh,
            IOobject::READ_IF_PRESENT,
            IOobject::NO_WRITE,
            false
        )
    );

    global = addressing;

    return returnReduce
    (
        mesh.nCells() == 0
     || (
            addressing.headerClassName() == labelIOList::typeName
         && addressing.size() == mesh.nCells()
        ),
        andOp<bool>()
    );
}


template<class Type>
Foam::tmp<Foam::GeometricField<Type, Foam::fvPatchField, Foam::volMesh>>
Foam::m4gn::cellField
(
    const fvMesh& mesh,
    const word& name,
    const word& instance
)
{
    IOobject io
    (
        name,
        instance,
        mesh,
        IOobject::NO_READ,
        IOobject::NO_WRITE,
        false
    );
    // Such a file may be replaced by us
    io.note() = "m4gn";

    return tmp<GeometricField<Type, fvPatchField, volMesh>>::New
    (
        io,
        mesh,
        dimensioned<Type>(dimless, Zero),
        zeroGradientFvPatchField<Type>::typeName
    );
}


template Foam::tmp<Foam::volScalarField>
Foam::m4gn::cellField<Foam::scalar>(const fvMesh&, const word&, const word&);

template Foam::tmp<Foam::volVectorField>
Foam::m4gn::cellField<Foam::vector>(const fvMesh&, const word&, const word&);


void Foam::m4gn::writeToInstance(const regIOobject& field)
{
    m4gnFieldFiles files;
    files.write(field);
    files.rename();
}


bool Foam::m4gn::readSegments
(
    const fvMesh& mesh,
    List<int32_t>& segments,
    fileName& from
)
{
    return
        readOwn(mesh, segments, from)
     || (Pstream::parRun() && readUndecomposed(mesh, segments, from));
}


void Foam::m4gn::writeSegments
(
    const fvMesh& mesh,
    const UList<int32_t>& segments,
    const word& instance
)
{
    tmp<volScalarField> tfield
    (
        cellField<scalar>
        (
            mesh,
            segmentName,
            instance.empty()
          ? Time::timeName(mesh.time().startTime().value())
          : instance
        )
    );
    volScalarField& field = tfield.ref();

    forAll(field, celli)
    {
        field[celli] = segments[celli];
    }
    field.correctBoundaryConditions();

    writeToInstance(field);

    labelList global;
    if (Pstream::parRun() && cellAddressing(mesh, global))
    {
        writeUndecomposed(field, global);
    }
}


// ************************************************************************* //
