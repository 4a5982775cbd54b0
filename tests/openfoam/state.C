// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "m4gnNodes.H"
#include "m4gnState.H"
#include "surfaceFields.H"
#include "volFields.H"

using testing::caseFolder;
using testing::dict;

namespace
{
//- Two cells of 1 x 1 x 2 m
struct fixture
{
    caseFolder run;
    autoPtr<fvMesh> mesh;
    autoPtr<volVectorField> U;
    autoPtr<volScalarField> p, T;
    autoPtr<surfaceScalarField> phi;

    fixture() : mesh(run.block({2, 1, 1}, {2, 1, 2}, {"patch", "patch", "wall", "wall", "empty", "empty"}))
    {
        const wordList types({"fixedValue", "zeroGradient", "zeroGradient", "fixedValue", "empty", "empty"});
        U.reset(new volVectorField(io("U"), *mesh, dimensionedVector(dimVelocity, Zero), types));
        p.reset(new volScalarField(io("p"), *mesh, dimensionedScalar(sqr(dimVelocity), Zero), types));
        T.reset(new volScalarField(io("T"), *mesh, dimensionedScalar(dimTemperature, Zero), types));
        phi.reset(new surfaceScalarField(io("phi"), *mesh, dimensionedScalar(dimVolume / dimTime, Zero)));
        U->primitiveFieldRef()[1] = vector(1, 2, 3);
        U->boundaryFieldRef()[3] == vectorField({vector(4, 5, 6), vector(7, 8, 9)});
        phi->primitiveFieldRef()[0] = 0.5;
        phi->boundaryFieldRef()[1] = 2;
    }

    IOobject io(const word& name) const
    {
        return IOobject(
            name, mesh->time().timeName(), *mesh, IOobject::READ_IF_PRESENT, IOobject::AUTO_WRITE);
    }
};

//- The array of this name and place
label find(const m4gnState& state, const word& name, const label place, const label role = -1)
{
    for (size_t i = 0; i < state.arrays().size(); ++i) {
        const m4gn_array& array = state.arrays()[i];
        if (array.name == name && array.place == place && (role < 0 || array.role == role)) {
            return i;
        }
    }
    testing::failed(__FILE__, __LINE__, "no array " + name);
}
} // End anonymous namespace

TEST(rolesOfAWholeState)
{
    fixture f;
    const m4gnState state(*f.mesh, wordHashSet(), true, false);
    const m4gn_array& U = state.arrays()[find(state, "U", M4GN_CELLS)];
    EXPECT(state.arrays().size() == 8);
    EXPECT(U.role == M4GN_SOLVED && U.components == 3 && U.solved == 2 && U.n == 2);
    EXPECT_NEAR(U.weights[1], 2, 1e-14);
    EXPECT(U.floor == -HUGE_VAL);
    // An incompressible pressure
    EXPECT(state.arrays()[find(state, "p", M4GN_CELLS)].role == M4GN_FOLLOWS);
    EXPECT(state.arrays()[find(state, "phi", M4GN_FACES)].role == M4GN_CARRIED);
    EXPECT(state.arrays()[find(state, "U", M4GN_BOUNDARY)].role == M4GN_CARRIED);
    EXPECT(state.arrays()[find(state, "U", M4GN_BOUNDARY)].n == 6);
    EXPECT(state.arrays()[find(state, "T", M4GN_CELLS)].floor == 0);
    // Two cells, a face between them, and six at the boundary
    EXPECT_NEAR(state.size(), 2 * 5 + 1 + 6 * 6, 0);
}

// kkLOmega takes the root of kt, and kOmegaSSTLM that of gammaInt; a scalar that is transported may have any sign
TEST(whatModelsTakeRootsOfStaysPositive)
{
    fixture f;
    const volScalarField kt(f.io("kt"), f.T()), gammaInt(f.io("gammaInt"), f.T()), s(f.io("s"), f.T());
    const m4gnState state(*f.mesh, wordHashSet(), true, false);
    for (const word name : {"kt", "gammaInt"}) {
        EXPECT(state.arrays()[find(state, name, M4GN_CELLS)].floor == 0);
        EXPECT(state.arrays()[find(state, name, M4GN_BOUNDARY)].floor == 0);
    }
    EXPECT(state.arrays()[find(state, "s", M4GN_CELLS)].floor == -HUGE_VAL);
}

// Laws of solids4foam's unstructured models go on from strains of faces
TEST(stressesOfFacesAreHandedOver)
{
    fixture f;
    const surfaceSymmTensorField sigmaf(f.io("sigmaf"), *f.mesh, dimensioned<symmTensor>(dimPressure, Zero));
    const m4gnState state(*f.mesh, wordHashSet(), true, false);
    const m4gn_array& array = state.arrays()[find(state, "sigmaf", M4GN_FACES)];
    EXPECT(array.role == M4GN_CARRIED && array.components == 6 && array.n == 1);
}

TEST(rolesOfANetworksState)
{
    fixture f;
    const m4gnNodes nodes(*f.mesh, labelList(6, M4GN_WALL));
    const m4gnState state(*f.mesh, wordHashSet(), false, true, &nodes, {"U", "T", "cellSize"}, {"U"});
    EXPECT_TEXT(state.fields().first(), "T");
    EXPECT(state.arrays()[find(state, "U", M4GN_CELLS)].role == M4GN_SOLVED);
    EXPECT(!state.arrays()[find(state, "U", M4GN_CELLS)].weights);
    EXPECT(state.arrays()[find(state, "T", M4GN_CELLS)].role == M4GN_CARRIED);
    EXPECT(state.arrays()[find(state, "cellSize", M4GN_CELLS)].role == M4GN_CARRIED);
    EXPECT(state.arrays()[find(state, "U", M4GN_BOUNDARY)].n == nodes.nBoundary());
}

// A step that the solver adjusts is nothing that drives the flow, and no error is measured by it
TEST(theTimeStepIsNoInputOfAFit)
{
    fixture f;
    const m4gnNodes nodes(*f.mesh, labelList(6, M4GN_WALL));
    m4gnState state(*f.mesh, wordHashSet(), true, false, &nodes, {"U", "deltaT"}, {"U"});
    const label deltaT = find(state, "deltaT", M4GN_CELLS);
    EXPECT(state.arrays()[deltaT].role == M4GN_CARRIED);
    f.run.time().setDeltaT(0.25, false);
    EXPECT_NEAR(state.gather()[deltaT][1], 0.25, 0);
}

TEST(facesThatHoldTheirValues)
{
    fixture f;
    const m4gnNodes nodes(*f.mesh, labelList(6, M4GN_WALL));
    m4gnState state(*f.mesh, wordHashSet(), false, true, &nodes, {"U"}, {"U"});
    const double* held = state.gather()[find(state, "U", M4GN_BOUNDARY, M4GN_HELD)];
    // One face at the left and at the right, two below and above
    const scalar expected[] = {1, 0, 0, 0, 1, 1};
    for (label facei = 0; facei < 6; ++facei) {
        EXPECT_NEAR(held[facei], expected[facei], 0);
    }
}

TEST(aStateIsGatheredAndPut)
{
    fixture f;
    m4gnState state(*f.mesh, wordHashSet(), true, false);
    const label U = find(state, "U", M4GN_CELLS), ofU = find(state, "U", M4GN_BOUNDARY);
    const label phi = find(state, "phi", M4GN_FACES), ofPhi = find(state, "phi", M4GN_BOUNDARY);
    const std::vector<const double*> now(state.gather());
    EXPECT_NEAR(now[U][4], 2, 0);
    EXPECT_NEAR(now[ofU][3 * 5], 7, 0);
    EXPECT_NEAR(now[phi][0], 0.5, 0);
    EXPECT_NEAR(now[ofPhi][1], 2, 0);

    // Twice as much, a step later
    f.U->oldTime();
    const std::vector<double*> places(state.places());
    for (size_t i = 0; i < places.size(); ++i) {
        const m4gn_array& array = state.arrays()[i];
        for (label j = 0; j < array.n * array.components; ++j) {
            places[i][j] = 2 * now[i][j];
        }
    }
    ++f.run.time();
    state.put();
    EXPECT_NEAR(f.U()[1], vector(2, 4, 6), 0);
    EXPECT_NEAR(f.U->boundaryField()[3][1], vector(14, 16, 18), 0);
    EXPECT_NEAR(f.U->oldTime()[1], vector(1, 2, 3), 0);
    EXPECT_NEAR(f.phi()[0], 1, 0);
    EXPECT_NEAR(f.phi->boundaryField()[1][0], 4, 0);

    places[U][3] = 9;
    state.put(1);
    EXPECT_NEAR(f.U->oldTime()[1].x(), 9, 0);
    EXPECT_NEAR(f.U()[1].x(), 2, 0);
}

// The network reads the first values of the boundary alone
TEST(patchesThatCarryValuesComeFirst)
{
    caseFolder run;
    const autoPtr<fvMesh> mesh(
        run.block({2, 1, 1}, {2, 1, 1}, {"cyclic", "cyclic", "patch", "patch", "empty", "empty"}));
    volScalarField T(
        IOobject("T", run.time().timeName(), *mesh, IOobject::READ_IF_PRESENT, IOobject::AUTO_WRITE), *mesh,
        dimensionedScalar(dimTemperature, Zero),
        wordList({"cyclic", "cyclic", "calculated", "calculated", "empty", "empty"}));
    T.boundaryFieldRef()[0] = 1;
    T.boundaryFieldRef()[2] = 2;
    T.boundaryFieldRef()[3] = 3;
    m4gnState state(*mesh, wordHashSet(), true, false);
    const label ofT = find(state, "T", M4GN_BOUNDARY);
    const double* values = state.gather()[ofT];
    EXPECT(state.arrays()[ofT].n == 6);
    EXPECT_NEAR(values[0], 2, 0);
    EXPECT_NEAR(values[3], 3, 0);
    EXPECT_NEAR(values[4], 1, 0);
}

TEST(whatANetworkPredictsIsImposed)
{
    fixture f;
    const m4gnNodes nodes(*f.mesh, labelList(6, M4GN_WALL));
    m4gnState state(*f.mesh, wordHashSet(), false, false, &nodes, {"U", "T"}, {"U"});
    const label U = find(state, "U", M4GN_CELLS);
    for (label i = 0; i < 6; ++i) {
        state.places()[U][i] = i;
    }
    state.impose();
    EXPECT_NEAR(f.U()[1], vector(3, 4, 5), 0);
    EXPECT_NEAR(f.T()[1], 0, 0);
}

// A table at the left
TEST(whatIsPrescribedIsKnownBeforehand)
{
    fixture f;
    f.U.clear();
    f.run.write(
        "0/T", "dimensions [0 0 0 1 0 0 0]; internalField uniform 1; boundaryField {"
               " left { type uniformFixedValue; uniformValue table ((0 1) (1 3)); }"
               " \"(right|bottom|top)\" { type zeroGradient; } \"(back|front)\" { type empty; } }");
    f.T.clear();
    f.T.reset(new volScalarField(
        IOobject("T", f.run.time().timeName(), *f.mesh, IOobject::MUST_READ, IOobject::AUTO_WRITE), *f.mesh));
    const m4gnNodes nodes(*f.mesh, labelList(6, M4GN_WALL));
    m4gnState state(*f.mesh, wordHashSet(), true, false, &nodes, {}, {"p"});
    const label table = find(state, "T at left", M4GN_FACES);
    EXPECT(state.arrays()[table].role == M4GN_PRESCRIBED && !state.places()[table]);
    EXPECT_NEAR(state.gather()[table][0], 1, 1e-12);

    scalarField later(state.arrays()[table].n * state.arrays()[table].components);
    std::vector<double*> rooms(state.arrays().size(), nullptr);
    rooms[table] = later.data();
    EXPECT(m4gnState::ahead(&state, 0.5, rooms.data()) == M4GN_OK);
    EXPECT_NEAR(later[0], 2, 1e-12);
}

// The path of rigidCylinderContact, and a condition's own entries
TEST(aTableOfSolids4FoamIsToldByItsEnd)
{
    EXPECT(m4gnPrescribed::hasFunction(dict("cylinderCentre { file centre; outOfBounds clamp; }")));
    EXPECT(!m4gnPrescribed::hasFunction(dict("triSurfaces { file centre; }")));
}

// As solids4foam has it: a table of the displacement, of which a step makes its increment
TEST(anIncrementIsPrescribedByWhatItLeadsTo)
{
    fixture f;
    f.run.write(
        "0/DD", "dimensions [0 1 0 0 0 0 0]; internalField uniform (0 0 0); boundaryField {"
                " left { type uniformFixedValue; uniformValue table ((0 (1 0 0)) (1 (3 0 0))); }"
                " \"(right|bottom|top)\" { type zeroGradient; } \"(back|front)\" { type empty; } }");
    const volVectorField DD(f.io("DD"), *f.mesh);
    volVectorField D(f.io("D"), *f.mesh, dimensionedVector(dimLength, Zero), f.U->boundaryField().types());
    D.boundaryFieldRef()[0] == vector(4, 0, 0);
    D.oldTime();
    D.boundaryFieldRef()[0] == vector(7, 0, 0);

    m4gnPrescribed prescribed(*f.mesh, {"DD"});
    EXPECT_NEAR(prescribed.values()[0][0], 7, 1e-12);
    prescribed.say(0.5);
    EXPECT_NEAR(prescribed.values()[0][0], 2 + 4, 1e-12);
}
