// SPDX-License-Identifier: GPL-3.0-or-later
// A function object of another library that stretches the mesh of a solver whose mesh stands still.

#include "addToRunTimeSelectionTable.H"
#include "fvMesh.H"
#include "fvMeshFunctionObject.H"

namespace Foam
{
namespace functionObjects
{

class moveMesh : public fvMeshFunctionObject
{
public:
    TypeName("moveMesh");

    moveMesh(const word& name, const Time& runTime, const dictionary& dict)
        : fvMeshFunctionObject(name, runTime, dict)
    {}

    virtual bool execute()
    {
        fvMesh& mesh = const_cast<fvMesh&>(mesh_);
        mesh.movePoints(1.001 * mesh.points());
        return true;
    }

    virtual bool write() { return true; }
};

defineTypeNameAndDebug(moveMesh, 0);
addToRunTimeSelectionTable(functionObject, moveMesh, dictionary);

}
}
