// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnStoredSegments.H"
#include "m4gnNodes.H"
#include "m4gnCore.H"
#include "m4gnSegmentField.H"
#include "m4gnVersion.H"
#include "IFstream.H"
#include "OSspecific.H"
#include "PstreamReduceOps.H"
#include "StringStream.H"
#include "Time.H"
#include "globalIndex.H"
#include "localIOdictionary.H"
#include "m4gn.h"
#include <cmath>
#include <vector>

namespace
{
using namespace Foam;

//- The values of a field's file, as many as there are; a uniform one nCells
//  times
scalarField internalField(const dictionary& dict, const label nCells)
{
    ITstream& is = dict.lookup("internalField");
    const word kind(is);

    if (kind == "uniform") {
        return scalarField(nCells, readScalar(is));
    }

    scalarField values;
    is >> static_cast<List<scalar>&>(values);
    return values;
}

//- The last file of the undecomposed case that is not later than now. Collective:
//  with a file handler like collated, the ranks look for times together.
fileName findUndecomposed(const fvMesh& mesh)
{
    const Time& time = mesh.time();
    const instantList times(Time::findTimes(time.globalPath(), time.constant()));

    forAllReverse(times, i) {
        const bool late =
            times[i].name() != time.constant() && times[i].value() > time.value() + 0.5 * time.deltaTValue();

        const fileName file(time.globalPath() / times[i].name() / mesh.dbDir() / m4gn::segmentName);

        if (!late && isFile(file)) {
            return file;
        }
    }

    return fileName();
}

} // End anonymous namespace

bool Foam::m4gnStoredSegments::readOwn()
{
    word instance(mesh_.time().findInstance(mesh_.dbDir(), m4gn::segmentName, IOobject::READ_IF_PRESENT));
    m4gn::broadcast(instance);

    IOobject io(m4gn::segmentName, instance, mesh_, IOobject::MUST_READ, IOobject::NO_WRITE, false);

    // A rank without cells, as redistributePar has them, may be without the
    // file
    const bool found = io.typeHeaderOk<volScalarField>(true, false);

    if (!returnReduce(found || mesh_.nCells() == 0, andOp<bool>()) || !returnReduce(found, orOp<bool>())) {
        return false;
    }

    scalarField values;
    if (found) {
        // Not as a field: that ends the run if the mesh has changed
        const localIOdictionary dict(io, volScalarField::typeName);
        values = internalField(dict, mesh_.nCells());
    }

    from_ = fileName(instance) / m4gn::segmentName;
    folders_ = m4gn::segmentFolders(mesh_, instance);
    set(values, returnReduce(values.size(), sumOp<label>()));

    return true;
}

bool Foam::m4gnStoredSegments::readUndecomposed()
{
    // A rank may see another disk: the master's answer counts
    fileName file(findUndecomposed(mesh_));
    m4gn::broadcast(file);

    labelList global;
    if (file.empty() || !m4gnNodes::procAddressing(mesh_, "cellProcAddressing", mesh_.nCells(), global)) {
        return false;
    }

    const label nCells = returnReduce(mesh_.nCells(), sumOp<label>());
    scalarField whole;

    if (Pstream::master()) {
        IFstream is(file);
        IOobject io(m4gn::segmentName, mesh_.time().constant(), mesh_.time());

        if (!io.readHeader(is)) {
            FatalIOErrorInFunction(is) << "No header of an OpenFOAM file" << exit(FatalIOError);
        }

        const dictionary dict(is);
        whole = internalField(dict, nCells);
    }
    m4gn::broadcast(whole);

    from_ = file;
    folders_ = {file.path(), mesh_.time().globalPath() / mesh_.time().constant() / mesh_.dbDir()};
    scalarField values;
    if (whole.size() == nCells) {
        values = scalarField(whole, global);
    }
    set(values, whole.size());

    return true;
}

void Foam::m4gnStoredSegments::set(const UList<scalar>& values, const label nStored)
{
    const label nCells = returnReduce(mesh_.nCells(), sumOp<label>());

    OStringStream why;

    otherSize_ = returnReduce(values.size() != mesh_.nCells(), orOp<bool>());

    if (otherSize_) {
        why << "they are of another mesh: " << nStored << " values for " << nCells << " cells";
        problem_ = why.str();
        return;
    }

    // The largest value that is no label, if there is one
    scalar wrong = -VGREAT;
    cells_.resize(values.size());

    forAll(values, celli) {
        const scalar value = values[celli];

        if (value >= 0 && value < nCells && value == std::floor(value)) {
            cells_[celli] = int32_t(value);
        } else {
            wrong = Foam::max(wrong, std::isfinite(value) ? value : VGREAT);
        }
    }
    reduce(wrong, maxOp<scalar>());

    if (wrong > -VGREAT) {
        why << "one of them is " << wrong << ", and labels of segments are"
            << " whole numbers from 0 that are less than the number of cells"
            << " (mapFields interpolates them)";
        problem_ = why.str();
    }
}

void Foam::m4gnStoredSegments::removeModes() const
{
    const fileName folder(from_.isAbsolute() ? from_.path() : mesh_.time().path() / from_.path());

    for (label i = 1;; ++i) {
        const fileName file(folder / ("m4gnMode" + Foam::name(i)));

        if (m4gn::noteOf(mesh_.time(), file).substr(0, 4) != "m4gn") {
            return;
        }
        for (const fileName& f : {file, fileName(file + ".gz")}) {
            if (isFile(f, false)) {
                rm(f);
            }
        }
    }
}

Foam::m4gnStoredSegments::m4gnStoredSegments(const fvMesh& mesh) : mesh_(mesh), otherSize_(false)
{
    if (!readOwn() && Pstream::parRun()) {
        readUndecomposed();
    }
}

const Foam::wordList& Foam::m4gnStoredSegments::choices()
{
    static const wordList words({"recompute", "refuse", "keep"});

    return words;
}

bool Foam::m4gnStoredSegments::use(const m4gnModel* model, const std::string& options, const word& choice)
{
    if (from_.empty()) {
        return false;
    }

    string why(problem_);

    if (why.empty() && choice != "keep") {
        string record;
        if (Pstream::master()) {
            record = m4gn::readSegmentRecord(folders_);
        }

        // The marks of a mesh are of its cells alone, and redistributePar has
        // meshes without patches: no m4gnNodes
        std::vector<int64_t> numbers(mesh_.nCells());
        const globalIndex consecutive(mesh_.nCells());
        forAll(cells_, celli) {
            numbers[celli] = consecutive.toGlobal(celli);
        }
        m4gn_mesh_data data = {};
        data.n_directions = 3;
        data.directions[1] = 1;
        data.directions[2] = 2;
        data.n_cells = mesh_.nCells();
        data.cell_global = numbers.data();
        data.cell_centres = reinterpret_cast<const double*>(mesh_.cellCentres().cdata());
        data.cell_volumes = mesh_.cellVolumes().cdata();

        int32_t fit = 0;
        char text[1024] = "";
        m4gn::check(
            m4gn_segments_fit(
                m4gn::communicator(), &data, model ? model->handle() : nullptr, options.c_str(),
                m4gn::labels(cells_), record.c_str(), &fit, text, sizeof(text)),
            "The stored segments cannot be compared with those wanted");
        why = fit ? "" : text;
    }

    if (why.empty()) {
        Info << "m4gn: segments read from " << from_.c_str() << endl;

        return true;
    }

    if (choice != "recompute") {
        FatalErrorInFunction << "The segments stored in " << from_.c_str()
                             << " are not those wanted: " << why.c_str() << nl
                             << "    Remove the file, or give stored recompute, to have them"
                             << " computed anew";
        if (choice == "refuse" && problem_.empty()) {
            FatalError << "; stored keep takes them as they are";
        }
        FatalError << '.' << exit(FatalError);
    }

    Info << "m4gn: the segments stored in " << from_.c_str() << " are not taken: " << why.c_str() << nl
         << "m4gn: they are computed anew (entry stored)" << endl;

    if (otherSize_) {
        removeModes();
    }
    from_.clear();
    cells_.clear();

    return false;
}
