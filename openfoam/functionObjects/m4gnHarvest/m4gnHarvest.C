/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnHarvest.H"
#include "addToRunTimeSelectionTable.H"
#include "foamVersion.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnElasticModes.H"
#include "OSspecific.H"

// * * * * * * * * * * * * * * Static Data Members * * * * * * * * * * * * * //

namespace Foam
{
namespace functionObjects
{
    defineTypeNameAndDebug(m4gnHarvest, 0);
    addToRunTimeSelectionTable(functionObject, m4gnHarvest, dictionary);
}
}

//- Modes of an elastic body that are recorded, twice as many as segments take
//  by default
static const Foam::label defaultModes = 12;


// * * * * * * * * * * * * * Private Member Functions  * * * * * * * * * * * //

void Foam::functionObjects::m4gnHarvest::start()
{
    m4gn::checkAbi();

    nodes_ = m4gnNodes::New(mesh_, dict_);

    // The recorder keeps what it needs of them
    autoPtr<m4gnElasticModes> modes;
    const label nModes = dict_.getOrDefault<label>("modes", defaultModes);
    if
    (
        nModes > 0
     && !nodes_->atPoints()
     && m4gnElasticModes::wanted(mesh_, dict_)
    )
    {
        modes.reset(new m4gnElasticModes(mesh_, dict_, nModes));
        nodes_->setModes(modes->eigenvalues(), modes->cells());
    }
    fields_.reset(new m4gnFieldSet(mesh_, fieldNames_));
    fields_->gather(*nodes_);

    std::vector<m4gn_recorder_field> recorded(fields_->size());
    for (label i = 0; i < fields_->size(); ++i)
    {
        recorded[i].name = fields_->name(i).c_str();
        recorded[i].components = fields_->components(i);
        std::copy
        (
            fields_->dimensions(i).begin(),
            fields_->dimensions(i).end(),
            recorded[i].dimensions
        );
    }

    path_ = file_;
    if (path_.empty())
    {
        path_ = m4gn::outputDir(name(), mesh_)/"trajectory.h5";
    }
    path_.expand();
    if (!path_.isAbsolute())
    {
        path_ = time_.globalPath()/path_;
    }
    if (Pstream::master())
    {
        mkDir(path_.path());
    }

    const std::string about(provenance());

    m4gn_recorder_options options = {};
    options.path = path_.c_str();
    options.n_fields = recorded.size();
    options.fields = recorded.data();
    options.provenance = about.c_str();
    options.split = split_.c_str();
    options.overwrite = overwrite_;

    m4gn::check
    (
        m4gn_recorder_new
        (
            m4gn::communicator(),
            &nodes_->data(),
            &options,
            &recorder_
        ),
        "m4gnHarvest cannot record"
    );
    nodes_->clearModes();

    Log << type() << ' ' << name() << ": recording " << m4gn::join(fieldNames_)
        << " to " << path_ << endl;
}


void Foam::functionObjects::m4gnHarvest::finish()
{
    if (!recorder_ || finished_)
    {
        return;
    }

    const label nFrames = m4gn_recorder_n_frames(recorder_);

    m4gn::check(m4gn_recorder_finish(recorder_), "m4gnHarvest cannot finish");
    finished_ = true;

    Log << type() << ' ' << name() << ": " << nFrames << " frames in "
        << path_ << nl << endl;
}


std::string Foam::functionObjects::m4gnHarvest::provenance() const
{
    dictionary about;
    about.add("application", string(time_.controlDict().getOrDefault<word>("application", "unknown")));
    about.add("case", string(time_.globalCaseName()));
    about.add("openfoam", label(OPENFOAM));
    about.add("m4gn", string(m4gn_version()));
    about.add("ranks", Pstream::nProcs());
    about.add("deltaT", time_.deltaTValue());
    about.merge(dict_.subOrEmptyDict("provenance"));

    return m4gn::json(about);
}


bool Foam::functionObjects::m4gnHarvest::runComplete() const
{
    // In post-processing, end() is called after the last time, or an error
    // came before it
    return
        !postProcess
     && time_.value() >= time_.endTime().value() - 0.5*time_.deltaTValue();
}


// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::functionObjects::m4gnHarvest::m4gnHarvest
(
    const word& name,
    const Time& runTime,
    const dictionary& dict
)
:
    fvMeshFunctionObject(name, runTime, dict),
    overwrite_(false),
    recorder_(nullptr),
    lastTime_(-VGREAT),
    finished_(false)
{
    read(dict);
}


// * * * * * * * * * * * * * * * * Destructor  * * * * * * * * * * * * * * * //

Foam::functionObjects::m4gnHarvest::~m4gnHarvest()
{
    if (recorder_)
    {
        if (runComplete())
        {
            finish();
        }
        m4gn_recorder_free(recorder_);
    }
}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

bool Foam::functionObjects::m4gnHarvest::read(const dictionary& dict)
{
    if (recorder_)
    {
        // A change of controlDict while recording
        Log << type() << ' ' << name() << ": recording goes on as it was"
            << " begun; changes to the dictionary take effect in the next run"
            << endl;
        return true;
    }

    fvMeshFunctionObject::read(dict);

    wordList valid
    ({
        "fields", "file", "overwrite", "split", "provenance", "nodeTypes",
        "location", "U", "p", "D", "modes"
    });
    valid.append(m4gnElasticModes::keys());
    m4gn::checkKeys(dict, valid, true);
    m4gnElasticModes::checkDictionary(dict);
    m4gn::checkAtLeast
    (
        dict, "modes", dict.getOrDefault<label>("modes", defaultModes), 0
    );

    dict_ = dict;
    fieldNames_ = dict.getOrDefault<wordList>("fields", wordList({"U", "p"}));
    file_ = dict.getOrDefault<fileName>("file", fileName());
    overwrite_ = dict.getOrDefault<bool>("overwrite", false);
    split_ = dict.getOrDefault<word>("split", "train");

    m4gnNodes::atPoints(dict);

    if (fieldNames_.empty())
    {
        FatalIOErrorInFunction(dict)
            << "Entry fields is empty; expected names such as (U p)"
            << exit(FatalIOError);
    }

    if (split_ != "train" && split_ != "valid" && split_ != "test")
    {
        FatalIOErrorInFunction(dict)
            << "Entry split is " << split_
            << "; expected train, valid or test"
            << exit(FatalIOError);
    }

    return true;
}


bool Foam::functionObjects::m4gnHarvest::execute()
{
    return true;
}


bool Foam::functionObjects::m4gnHarvest::write()
{
    // The last time is executed twice if the run stops there (Time::run)
    if (finished_ || time_.value() <= lastTime_)
    {
        return true;
    }

    if (recorder_)
    {
        fields_->gather(*nodes_);
    }
    else
    {
        start();
    }

    m4gn::check
    (
        m4gn_recorder_append
        (
            recorder_,
            time_.value(),
            fields_->view().data(),
            fields_->size()
        ),
        "m4gnHarvest cannot record a frame"
    );

    lastTime_ = time_.value();

    return true;
}


bool Foam::functionObjects::m4gnHarvest::end()
{
    finish();

    return true;
}


void Foam::functionObjects::m4gnHarvest::updateMesh(const mapPolyMesh&)
{
    FatalErrorInFunction
        << "The mesh has changed, and a trajectory has one mesh"
        << exit(FatalError);
}


void Foam::functionObjects::m4gnHarvest::movePoints(const polyMesh&)
{
    FatalErrorInFunction
        << "The mesh has moved, and a trajectory has one mesh"
        << exit(FatalError);
}


// ************************************************************************* //
