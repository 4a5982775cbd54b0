// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSegmentField.H"
#include "m4gnFieldFiles.H"
#include "IFstream.H"
#include "m4gnNodes.H"
#include "m4gnVersion.H"
#include "OSspecific.H"
#include "PstreamReduceOps.H"
#include "Time.H"
#include "emptyPolyPatch.H"
#include "processorPolyPatch.H"
#include "zeroGradientFvPatchFields.H"

const Foam::word Foam::m4gn::segmentName("m4gnSegment");

const Foam::word Foam::m4gn::groupName("m4gnGroup");

static const char* const recordName = "m4gnSegmentDict";

void Foam::m4gn::writeSegmentRecord(
    m4gnFieldFiles& files, const Time& time, const fileName& folder, const std::string& record)
{
    files.write(
        time, folder / recordName,
        [&](Ostream& os) {
            os << "// How m4gnSegment was made (m4gn); a run compares it with"
               << " what its model wants" << nl << "FoamFile" << nl << '{' << nl << "    version     2.0;"
               << nl << "    format      ascii;" << nl << "    class       dictionary;" << nl
               << "    object      m4gnSegmentDict;" << nl << '}' << nl << nl;
            os.writeQuoted("record #{" + record + "#};\n", false);
        },
        true);
}

namespace Foam
{
//- To the undecomposed case, from the ranks of a case that decomposePar made
static void writeUndecomposed(const volScalarField& field, const labelList& global)
{
    const fvMesh& mesh = field.mesh();
    const Time& time = mesh.time();

    List<labelList> cells(Pstream::nProcs());
    List<scalarField> values(Pstream::nProcs());
    cells[Pstream::myProcNo()] = global;
    values[Pstream::myProcNo()] = field.primitiveField();
    Pstream::gatherList(cells);
    Pstream::gatherList(values);

    if (!Pstream::master()) {
        return;
    }

    fileName instance(time.globalPath() / field.instance());
    if (!isDir(instance)) {
        // A new time folder there would be taken for the latest time
        instance = time.globalPath() / time.constant();
    }
    if (!isDir(instance)) {
        return;
    }

    label nCells = 0;
    for (const labelList& some : cells) {
        nCells += some.size();
    }
    scalarField whole(nCells);
    forAll(cells, proci) {
        UIndirectList<scalar>(whole, cells[proci]) = values[proci];
    }

    m4gnFieldFiles files;
    files.write(time, instance / mesh.dbDir() / field.name(), [&](Ostream& os) {
        field.writeHeader(os, volScalarField::typeName);
        os.writeEntry("dimensions", field.dimensions());
        os << nl;
        whole.writeEntry("internalField", os);
        os << nl;
        os.beginBlock("boundaryField");
        for (const polyPatch& pp : mesh.boundaryMesh()) {
            if (!isA<processorPolyPatch>(pp)) {
                os.beginBlock(pp.name());
                os.writeEntry(
                    "type", polyPatch::constraintType(pp.type()) ? pp.type()
                                                                 : zeroGradientFvPatchScalarField::typeName);
                os.endBlock();
            }
        }
        os.endBlock();
        IOobject::writeEndDivider(os);
    });
    files.rename();
}

} // End namespace Foam

template <class Type>
Foam::tmp<Foam::GeometricField<Type, Foam::fvPatchField, Foam::volMesh>> Foam::m4gn::cellField(
    const fvMesh& mesh, const word& name, const word& instance)
{
    IOobject io(name, instance, mesh, IOobject::NO_READ, IOobject::NO_WRITE, false);
    // Such a file may be replaced by us. OpenFOAM's own tools name the file
    // and the line at which another mesh has another number of cells.
    io.note() = "m4gn: of the mesh that the case had; after remeshing remove this file";

    return tmp<GeometricField<Type, fvPatchField, volMesh>>::New(
        io, mesh, dimensioned<Type>(dimless, Zero), zeroGradientFvPatchField<Type>::typeName);
}

template Foam::tmp<Foam::volScalarField> Foam::m4gn::cellField<Foam::scalar>(
    const fvMesh&, const word&, const word&);

template Foam::tmp<Foam::volVectorField> Foam::m4gn::cellField<Foam::vector>(
    const fvMesh&, const word&, const word&);

void Foam::m4gn::writeToInstance(const regIOobject& field)
{
    m4gnFieldFiles files;
    files.write(field);
    files.rename();
}

Foam::fileNameList Foam::m4gn::segmentFolders(const fvMesh& mesh, const word& instance)
{
    const Time& time = mesh.time();

    return {
        time.path() / instance / mesh.dbDir(), time.globalPath() / instance / mesh.dbDir(),
        time.globalPath() / time.constant() / mesh.dbDir()};
}

Foam::string Foam::m4gn::readSegmentRecord(const fileNameList& folders)
{
    for (const fileName& folder : folders) {
        const fileName file(folder / recordName);

        if (isFile(file)) {
            IFstream is(file);
            const dictionary dict(is);

            const string record(dict.getOrDefault<string>("record", "none"));

            // Line breaks are for people
            return string(record).replaceAll("\n", " ");
        }
    }

    return string();
}

Foam::string Foam::m4gn::noteOf(const Time& time, const fileName& file)
{
    // Compressed files too
    if (!isFile(file)) {
        return string();
    }

    IFstream is(file);
    IOobject io(file.name(), time.constant(), time);
    const bool read = io.readHeader(is);

    return read && io.note().size() ? string(io.note()) : string("unknown");
}

void Foam::m4gn::writeLabels(
    const fvMesh& mesh, const word& name, const word& instance, const UList<int32_t>& labels)
{
    tmp<volScalarField> tfield(cellField<scalar>(mesh, name, instance));
    volScalarField& field = tfield.ref();

    forAll(field, celli) {
        field[celli] = labels[celli];
    }
    field.correctBoundaryConditions();

    writeToInstance(field);

    labelList global;
    if (Pstream::parRun() && m4gnNodes::procAddressing(mesh, "cellProcAddressing", mesh.nCells(), global)) {
        writeUndecomposed(field, global);
    }
}

bool Foam::m4gn::writeSegments(
    const fvMesh& mesh, const UList<int32_t>& segments, const std::string& record, const word& folder)
{
    const Time& time = mesh.time();
    const word instance(folder.empty() ? Time::timeName(time.startTime().value()) : folder);
    const fileNameList folders(segmentFolders(mesh, instance));

    // Somebody's own segments are not ours to replace: those of the ranks,
    // which the file handler finds with all ranks together, and those of the
    // undecomposed case
    const fileName mine(fileHandler().filePath(folders.first() / segmentName));
    bool ours = true;
    if (Pstream::master() && readSegmentRecord(folders).empty()) {
        fileNameList files(1, mine);
        if (Pstream::parRun()) {
            files.append((isDir(folders[1]) ? folders[1] : folders[2]) / segmentName);
        }
        for (const fileName& file : files) {
            const string note(noteOf(time, file));
            ours = ours && (note.empty() || note.substr(0, 4) == "m4gn");
        }
    }
    m4gn::broadcast(ours);

    if (!ours) {
        Info << "m4gn: " << (instance / segmentName).c_str()
             << " was not written by m4gn and is left as it is; the segments"
             << " of this run are not stored. Remove the file to have them"
             << " stored." << endl;

        return false;
    }

    writeLabels(mesh, segmentName, instance, segments);

    if (Pstream::master()) {
        // Of a decomposed case, also where all ranks and a serial run find it
        const label last = !Pstream::parRun() ? 0 : isDir(folders[1]) ? 1 : 2;

        for (label i = 0; i <= last; ++i) {
            const bool needed = i == 0 || i == last;
            if (needed && isDir(folders[i])) {
                // One by one: folders may be links to each other
                m4gnFieldFiles files;
                writeSegmentRecord(files, time, folders[i], record);
                files.rename();
            }
        }
    }

    return true;
}
