// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "m4gnElasticBody.H"
#include "m4gnMechanicalProperties.H"
#include "m4gnNodes.H"
#include "m4gnOwnFields.H"
#include "functionObject.H"
#include "volFields.H"

using testing::caseFolder;
using testing::dict;

namespace
{
const wordList sixPatches(6, "patch");
} // End anonymous namespace

// A cube that is held at the left and cannot leave the plane of the bottom
TEST(heldPointsOfAnElasticBody)
{
    caseFolder run;
    const autoPtr<fvMesh> mesh(
        run.block({1, 1, 1}, {1, 1, 1}, {"patch", "patch", "symmetryPlane", "patch", "patch", "patch"}));
    labelList types(6, M4GN_FREE);
    types[0] = M4GN_HANDLE;
    types[2] = M4GN_SYMMETRY;
    const m4gnElasticBody body(*mesh, dict("material { E 2e6; nu 0.3; rho 1000; }"), types);
    const m4gn_solid& data = body.data();

    EXPECT(data.n_points == 8 && data.n_cells == 1 && data.n_faces == 6 && data.n_directions == 3);
    EXPECT(data.n_fixed == 6);
    for (label i = 0; i < data.n_fixed; ++i) {
        // All components at x = 0, the one along y elsewhere
        const double x = data.points[3 * data.fixed_point[i]];
        EXPECT(data.fixed_components[i] == (x == 0 ? 7 : 2));
    }

    EXPECT_REFUSED(m4gnElasticBody(*mesh, dict("material { E 2e6; nu 0.3; }"), types), "not known");
}

// A law that wraps another one has its history
TEST(lawsWithHistory)
{
    caseFolder run;
    run.write(
        "constant/mechanicalProperties",
        "mechanical ( soil { type poroMechanicalLaw; biotCoeff 1; effectiveStressMechanicalLaw"
        " { type linearElasticMohrCoulombPlastic; E { type uniform; } } } clay { type linearElastic; } );");
    const autoPtr<fvMesh> mesh(run.block({1, 1, 1}, {1, 1, 1}, sixPatches));
    const m4gnMechanicalProperties properties(*mesh);
    EXPECT(properties.laws().size() == 3);
    EXPECT(properties.lawsWithHistory() == wordList({"linearElasticMohrCoulombPlastic"}));
}

TEST(fieldsThatNoSolverRegisters)
{
    caseFolder run;
    run.write("constant/transportProperties", "nu 0.25;");
    // Cells of 1 x 2 x 1
    const autoPtr<fvMesh> mesh(run.block({2, 2, 1}, {2, 4, 1}, sixPatches));
    const IOdictionary transport(IOobject(
        "transportProperties", run.time().constant(), *mesh, IOobject::MUST_READ, IOobject::NO_WRITE));
    volVectorField D(
        IOobject("D", run.time().timeName(), *mesh), *mesh,
        dimensionedVector("D", dimLength, vector(1, 2, 3)), wordList(6, "zeroGradient"));
    D.oldTime();
    ++run.time();
    D.storeOldTimes();
    D.primitiveFieldRef()[3] = vector(1.5, 2, 2);
    // As controlDict that is edited has it: of the next time step
    run.time().setDeltaT(0.4, false);

    const m4gnNodes nodes(*mesh, labelList(6, M4GN_FREE));
    const auto cells = [&](const word& name) {
        m4gnNodes::values values;
        m4gnOwnFields::provide(*mesh, name);
        EXPECT(nodes.gather(name, values));
        return values.cells;
    };

    // Each cell has neighbours at 1 m and at 2 m
    EXPECT_NEAR(cells("cellSize")[0], 1.5, 1e-12);
    EXPECT_NEAR(cells("deltaT")[3], 0.4, 1e-15);
    EXPECT_NEAR(cells("nu")[1], 0.25, 0);
    // Over a time step of 0.1 s
    EXPECT_NEAR(cells("ddt(D)")[9], 5, 1e-12);
    EXPECT_NEAR(cells("ddt(D)")[11], -10, 1e-12);
    EXPECT_NEAR(cells("ddt(D)")[0], 0, 0);

    // Over stored times: the level before is stored, or the rate is not known
    volScalarField p(
        IOobject("p", run.time().timeName(), *mesh), *mesh, dimensionedScalar("p", dimless, 1),
        wordList(6, "zeroGradient"));
    functionObject::postProcess = true;
    EXPECT_NEAR(cells("ddt(D)")[9], 5, 1e-12);
    EXPECT_REFUSED(m4gnOwnFields::provide(*mesh, "ddt(p)"), "needs the level before, p_0");
    functionObject::postProcess = false;
}
