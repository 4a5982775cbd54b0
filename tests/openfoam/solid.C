// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "m4gnElasticBody.H"
#include "m4gnFieldSet.H"
#include "m4gnMeshAdapter.H"
#include "m4gnObstacles.H"
#include "volFields.H"

using testing::caseFolder;
using testing::dict;

namespace
{
const wordList sixPatches(6, "patch");
} // End anonymous namespace

// A sphere of radius 0.5 above the block, which moves down by 1 m within 1 s
TEST(gapsToAnObstacle)
{
    caseFolder run;
    const autoPtr<fvMesh> mesh(run.block({1, 1, 1}, {1, 1, 1}, sixPatches));
    run.write(
        "constant/obstacles", "range 0.5; ahead 0.1;"
                              " ball { type searchableSphere; centre (0.5 2 0.5); radius 0.5; motion table "
                              "((0 (0 0 0)) (1 (0 -1 0))); }");
    const m4gnObstacles& obstacles = m4gnObstacles::of(*mesh);
    EXPECT_NEAR(obstacles.range(), 0.5, 0);
    EXPECT(&obstacles == &m4gnObstacles::of(*mesh));

    const pointField points({point(0.5, 0.8, 0.5), point(0.5, -5, 0.5)});
    scalarField gap;
    vectorField outward;
    obstacles.gaps(points, 0, 3, gap, outward);
    EXPECT_NEAR(gap[0], 0.7, 1e-12);
    EXPECT_NEAR(outward[0], vector(0, -1, 0), 1e-12);
    // Further away than the limit
    EXPECT_NEAR(gap[1], 3, 0);
    EXPECT_NEAR(outward[1], vector(0, 0, 0), 0);

    // Half way down it touches 1 m above the ground; at the end the first point is inside by 0.3 m
    obstacles.gaps(points, 0.5, 3, gap, outward);
    EXPECT_NEAR(gap[0], 0.2, 1e-12);
    obstacles.gaps(points, 1, 3, gap, outward);
    EXPECT_NEAR(gap[0], -0.3, 1e-12);
    EXPECT_NEAR(outward[0], vector(0, -1, 0), 1e-12);
}

TEST(obstaclesThatAreNotValid)
{
    caseFolder run;
    const autoPtr<fvMesh> mesh(run.block({1, 1, 1}, {1, 1, 1}, sixPatches));
    EXPECT_REFUSED(m4gnObstacles::of(*mesh), "There is no file");
    run.write("constant/obstacles", "range 0.5; ahead 0.1;");
    EXPECT_REFUSED(m4gnObstacles::of(*mesh), "There is no obstacle in this file");
    run.write("constant/obstacles", "range 0; ahead 0.1;");
    EXPECT_REFUSED(m4gnObstacles::of(*mesh), "expected numbers above 0");
    run.write(
        "constant/obstacles",
        "range 0.5; ahead 0.1; ball { type searchableSphere; centre (0 0 0); radius 1; }");
    EXPECT_REFUSED(m4gnObstacles::of(*mesh), "The obstacle ball has no entry motion");
}

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

    const m4gnMeshAdapter nodes(*mesh, labelList(6, M4GN_FREE));
    m4gnFieldSet fields(*mesh, {"cellSize", "deltaT", "nu", "ddt(D)"});
    fields.gather(nodes);
    const std::vector<const double*> values(fields.cells());

    // Each cell has neighbours at 1 m and at 2 m
    EXPECT_NEAR(values[0][0], 1.5, 1e-12);
    EXPECT_NEAR(values[1][3], 0.1, 1e-15);
    EXPECT_NEAR(values[2][1], 0.25, 0);
    // Over a time step of 0.1 s
    EXPECT_NEAR(values[3][9], 5, 1e-12);
    EXPECT_NEAR(values[3][11], -10, 1e-12);
    EXPECT_NEAR(values[3][0], 0, 0);

    EXPECT_REFUSED(m4gnFieldSet(*mesh, {"missing"}).gather(nodes), "Field missing is neither registered");
}
