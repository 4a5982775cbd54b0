// SPDX-License-Identifier: GPL-3.0-or-later

// Only C of MPI is wanted
#define OMPI_SKIP_MPICXX
#define MPICH_SKIP_MPICXX
#include <mpi.h>

#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "Time.H"
#include "objectRegistry.H"
#include "regIOobject.H"

namespace
{
//- Ends MPI when the registry of Time lets go of it
struct lifetime : public Foam::regIOobject
{
    explicit lifetime(const Foam::IOobject& io) : Foam::regIOobject(io) {}

    virtual ~lifetime() { m4gn_finalize(); }

    virtual bool writeData(Foam::Ostream&) const { return true; }
};

} // End anonymous namespace

int32_t Foam::m4gn::communicator()
{
    if (!UPstream::parRun()) {
        return M4GN_NO_MPI;
    }

    int started = 0;
    MPI_Comm_size(MPI_COMM_WORLD, &started);
    if (started != UPstream::nProcs()) {
        FatalErrorInFunction << "This run has " << UPstream::nProcs() << " of the " << started
                             << " ranks that mpirun has started (-world, or several programs)" << nl
                             << "    Expected all of them: m4gn does not go on in step with other worlds"
                             << exit(FatalError);
    }

    return int32_t(MPI_Comm_c2f(MPI_COMM_WORLD));
}

void Foam::m4gn::endWith(const Time& time)
{
    const word name("m4gnLifetime");

    if (!UPstream::parRun() && !time.foundObject<regIOobject>(name)) {
        regIOobject::store(
            new lifetime(IOobject(name, time.constant(), time, IOobject::NO_READ, IOobject::NO_WRITE)));
    }
}

void Foam::m4gn::checkAbi()
{
    if (m4gn_abi_version() != M4GN_ABI_VERSION) {
        FatalErrorInFunction << "libm4gnFoam.so was compiled for interface " << label(M4GN_ABI_VERSION)
                             << " of libm4gn.so, but the libm4gn.so"
                             << " that was loaded (version " << m4gn_version() << ") has interface "
                             << label(m4gn_abi_version()) << nl
                             << "    Build both from the same checkout (./Allrun does)." << exit(FatalError);
    }
}

void Foam::m4gn::check(const int32_t status, const char* what)
{
    if (status != M4GN_OK) {
        FatalErrorInFunction << what << ": " << m4gn_last_error() << exit(FatalError);
    }
}

void Foam::m4gn::checkOptions(
    const dictionary& dict, const char* kind, const std::string& options, const wordList& own)
{
    std::string names;
    for (const word& name : own) {
        names += (names.empty() ? "" : ", ") + quoted(name);
    }
    std::string all(options.substr(0, options.rfind('}')));
    all += (all.find(':') == std::string::npos ? "" : ", ") + ("\"others\": [" + names + "]}");
    if (m4gn_options_check(kind, all.c_str()) != M4GN_OK) {
        FatalIOErrorInFunction(dict) << "Dictionary " << dict.dictName()
                                     << " is not valid: " << m4gn_last_error() << nl
                                     << "    Other entries that it may have: " << join(own)
                                     << exit(FatalIOError);
    }
}

Foam::m4gnModel::m4gnModel(const fileName& file) : file_(file), model_(nullptr)
{
    m4gn::check(m4gn_model_open(m4gn::communicator(), file_.c_str(), &model_), "The model cannot be read");
}

Foam::m4gnModel::~m4gnModel() { m4gn_model_free(model_); }

Foam::label Foam::m4gnModel::elasticModes() const
{
    const int32_t count = m4gn_model_n_elastic_modes(model_);
    if (count < 0) {
        m4gn::check(M4GN_ERROR_MODEL, "The model cannot be used");
    }
    return count;
}
