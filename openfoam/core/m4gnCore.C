/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

// Only C of MPI is wanted
#define OMPI_SKIP_MPICXX
#define MPICH_SKIP_MPICXX
#include <mpi.h>

#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "OSspecific.H"
#include "Time.H"
#include "functionObject.H"
#include "fvMesh.H"

// * * * * * * * * * * * * * * * Local Functions * * * * * * * * * * * * * * //

namespace
{

//- Ends MPI when the registry of Time lets go of it
struct lifetime
:
    public Foam::regIOobject
{
    explicit lifetime(const Foam::IOobject& io)
    :
        Foam::regIOobject(io)
    {}

    virtual ~lifetime()
    {
        m4gn_finalize();
    }

    virtual bool writeData(Foam::Ostream&) const
    {
        return true;
    }
};

//- In v1912 the mesh has the dictionary itself ...
template<class Mesh>
auto performance(const Mesh& mesh, const int)
    -> decltype(mesh.solverPerformanceDict())
{
    return mesh.solverPerformanceDict();
}


//- ... and in v2506 its state
template<class Mesh>
auto performance(const Mesh& mesh, const long)
    -> decltype(mesh.data().solverPerformanceDict())
{
    return mesh.data().solverPerformanceDict();
}

} // End anonymous namespace


// * * * * * * * * * * * * * * * * Functions * * * * * * * * * * * * * * * * //

int32_t Foam::m4gn::communicator()
{
    if (!UPstream::parRun())
    {
        return M4GN_NO_MPI;
    }

    return int32_t(MPI_Comm_c2f(MPI_COMM_WORLD));
}


void Foam::m4gn::endWith(const Time& time)
{
    const word name("m4gnLifetime");

    if (!UPstream::parRun() && !time.foundObject<regIOobject>(name))
    {
        regIOobject::store
        (
            new lifetime
            (
                IOobject
                (
                    name,
                    time.constant(),
                    time,
                    IOobject::NO_READ,
                    IOobject::NO_WRITE
                )
            )
        );
    }
}


void Foam::m4gn::checkAbi()
{
    if (m4gn_abi_version() != M4GN_ABI_VERSION)
    {
        FatalErrorInFunction
            << "libm4gnFoam.so was compiled for interface "
            << label(M4GN_ABI_VERSION) << " of libm4gn.so, but the libm4gn.so"
            << " that was loaded (version " << m4gn_version()
            << ") has interface " << label(m4gn_abi_version()) << nl
            << "    Build both from the same checkout (./Allrun does)."
            << exit(FatalError);
    }
}


void Foam::m4gn::check(const int32_t status, const char* what)
{
    if (status != M4GN_OK)
    {
        FatalErrorInFunction
            << what << ": " << m4gn_last_error()
            << exit(FatalError);
    }
}


void Foam::m4gn::checkOptions
(
    const dictionary& dict,
    const char* kind,
    const std::string& options,
    const wordList& own
)
{
    if (m4gn_options_check(kind, options.c_str()) != M4GN_OK)
    {
        FatalIOErrorInFunction(dict)
            << "Dictionary " << dict.dictName() << " is not valid: "
            << m4gn_last_error() << nl
            << "    Other entries that it may have: " << join(own)
            << exit(FatalIOError);
    }
}


Foam::fileName Foam::m4gn::resolve
(
    const fileName& path,
    const fileName& casePath
)
{
    fileName expanded(path);
    expanded.expand();

    if (expanded.isAbsolute())
    {
        return expanded;
    }

    const fileName inCase(casePath/expanded);
    const fileName home(getEnv("M4GN_HOME"));

    if (isFile(inCase, false) || home.empty())
    {
        return inCase;
    }

    if (isFile(home/"models"/expanded, false))
    {
        return home/"models"/expanded;
    }

    if (isFile(home/expanded, false))
    {
        return home/expanded;
    }

    return inCase;
}


void Foam::m4gn::checkStatic(const polyMesh& mesh, const dictionary& dict)
{
    // dynamicMotionSolverFvMesh, dynamicRefineFvMesh, solidBodyMotionFvMesh,
    // movingConeTopoFvMesh ...: their base class is in a library of its own
    const word& type = mesh.type();

    if
    (
        type.starts_with("dynamic")
     || type.find("Motion") != std::string::npos
     || type.find("Topo") != std::string::npos
    )
    {
        FatalIOErrorInFunction(dict)
            << "The mesh is a " << type << ", which moves or changes;"
            << " recordings and surrogates have one mesh" << nl
            << "    Remove the function object " << dict.dictName()
            << ", or run on a static mesh" << exit(FatalIOError);
    }
}


void Foam::m4gn::checkSolver(const functionObject& object)
{
    if (functionObject::postProcess)
    {
        FatalErrorInFunction
            << "Function object " << object.name() << " of type "
            << object.type()
            << " needs a running solver; it cannot work on stored times."
            << exit(FatalError);
    }
}


void Foam::m4gn::checkLast
(
    const functionObject& object,
    const Time& time,
    const char* what
)
{
    const functionObjectList& all = time.functionObjects();
    const label own = all.findObjectID(object.name());

    if (own < all.size() - 1)
    {
        FatalErrorInFunction
            << "Function object " << all[own + 1].name() << " comes after "
            << object.name() << " of type " << object.type()
            << ", and would look at " << what << nl << "    Have "
            << object.name() << " as the last one in functions"
            << exit(FatalError);
    }
}


const Foam::dictionary& Foam::m4gn::solverPerformance(const fvMesh& mesh)
{
    return performance(mesh, 0);
}


Foam::fileName Foam::m4gn::outputDir(const word& name, const polyMesh& mesh)
{
    const Time& time = mesh.time();

    fileName dir(time.globalPath()/functionObject::outputPrefix);

    if (mesh.name() != polyMesh::defaultRegion)
    {
        dir /= mesh.name();
    }

    return dir/name/Time::timeName(time.startTime().value());
}


// ************************************************************************* //
