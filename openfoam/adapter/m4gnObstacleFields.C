// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnObstacleFields.H"
#include "calculatedFvPatchFields.H"
#include "m4gnObstacles.H"
#include "m4gnOwnField.H"
#include "OStringStream.H"
#include "Time.H"
#include "volFields.H"

namespace Foam
{
namespace m4gnObstacleFields
{
static const word nowName("obstacle");

static const word aheadName("obstacleAhead");

//- In the header's note: whose field it is
static const char* const mark = "nearness of obstacles, by m4gn";

//- The values at these places
static tmp<vectorField> nearness
(
    const m4gnObstacles& obstacles,
    const pointField& places,
    const scalar time
)
{
    scalarField gap;
    vectorField direction;
    obstacles.gaps(places, time, obstacles.range(), gap, direction);

    return direction*max(1 - gap/obstacles.range(), scalar(0));
}

} // End namespace m4gnObstacleFields
} // End namespace Foam

void Foam::m4gnObstacleFields::provide(const fvMesh& mesh, const word& name)
{
    const bool ahead = name == aheadName;

    if ((!ahead && name != nowName) || !m4gnObstacles::present(mesh))
    {
        return;
    }

    const bool made = !mesh.foundObject<volVectorField>(name);
    auto* field = m4gnOwnField::get<vector>
    (
        mesh,
        name,
        dimless,
        mark,
        calculatedFvPatchVectorField::typeName
    );

    if (!field || (!made && field->timeIndex() == mesh.time().timeIndex()))
    {
        return;
    }

    const m4gnObstacles& obstacles = m4gnObstacles::of(mesh);
    const scalar time =
        mesh.time().value() + (ahead ? obstacles.ahead() : 0);

    field->timeIndex() = mesh.time().timeIndex();
    field->primitiveFieldRef() = nearness(obstacles, mesh.C(), time);

    auto& boundary = field->boundaryFieldRef();
    forAll(boundary, patchi)
    {
        if (boundary[patchi].size() && !boundary[patchi].coupled())
        {
            boundary[patchi] == nearness(obstacles, mesh.boundary()[patchi].Cf(), time);
        }
    }
    field->correctBoundaryConditions();
}

Foam::string Foam::m4gnObstacleFields::misfit
(
    const fvMesh& mesh,
    const wordList& inputs,
    const scalar stride
)
{
    const bool reads = inputs.found(nowName) || inputs.found(aheadName);

    if
    (
        mesh.foundObject<volVectorField>(nowName)
     && mesh.lookupObject<volVectorField>(nowName).note() != mark
    )
    {
        // Somebody else makes these fields
        return string();
    }

    const bool present = m4gnObstacles::present(mesh);
    OStringStream os;

    if (reads && !present)
    {
        os  << "The model reads where the obstacles are, and this case has no"
            << " file constant/" << m4gnObstacles::fileNameOf << nl
            << "    Describe them there (docs/contact.md), or use a model"
            << " without obstacles";
    }
    else if (!reads && present)
    {
        os  << "The case has obstacles (constant/"
            << m4gnObstacles::fileNameOf << "), and the model does not read "
            << nowName << " or " << aheadName << ": it cannot know where they"
            << " are" << nl
            << "    Record these fields, and train a model that reads them;"
            << " outOfRange ignore goes on without";
    }
    else if (inputs.found(aheadName))
    {
        const scalar ahead = m4gnObstacles::of(mesh).ahead();

        if (mag(ahead - stride) > 1e-6*stride)
        {
            os  << "The entry ahead of constant/" << m4gnObstacles::fileNameOf
                << " is " << ahead << " s, and the stride of the model is "
                << stride << " s; expected the stride of the model";
        }
    }

    return os.str();
}
