/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnAccelerate.H"
#include "m4gnSolveHistory.H"
#include "Time.H"

// * * * * * * * * * * * * * * * * Constructors  * * * * * * * * * * * * * * //

Foam::m4gnAccelerate::m4gnAccelerate(const fvMesh& mesh, m4gnSession& session)
:
    mesh_(mesh),
    session_(session),
    shadow_(mesh, session),
    forecast_(mesh)
{}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

void Foam::m4gnAccelerate::execute()
{
    if (shadow_.waiting() && !shadow_.arrived())
    {
        return;
    }

    shadow_.begin();
    forecast_.reset(mesh_.time().value() + session_.stride());

    if (!shadow_.finite())
    {
        return;
    }

    forAll(shadow_.predicted(), i)
    {
        forecast_.set
        (
            session_.outputs()[i],
            shadow_.predicted()[i],
            session_.outputComponents(i)
        );
    }
}


void Foam::m4gnAccelerate::stop()
{
    forecast_.reset(-VGREAT);
}


void Foam::m4gnAccelerate::end() const
{
    m4gnSolveHistory::report(mesh_);
    Info<< endl;
}


// ************************************************************************* //
