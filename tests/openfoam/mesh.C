// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "m4gnNodes.H"
#include "m4gnNodeTypes.H"
#include "surfaceFields.H"
#include "volFields.H"

using testing::caseFolder;
using testing::dict;

namespace
{
const wordList allPatches(6, "patch");

//- A registered field with these conditions at left, right, bottom and top
template <class Type>
autoPtr<GeometricField<Type, fvPatchField, volMesh>> field(
    const fvMesh& mesh, const word& name, const wordList& conditions)
{
    wordList types(conditions);
    for (label i = conditions.size(); i < 6; ++i) {
        types.append(mesh.boundary()[i].type());
    }
    typedef GeometricField<Type, fvPatchField, volMesh> made;
    return autoPtr<made>(new made(
        IOobject(name, mesh.time().timeName(), mesh), mesh, dimensioned<Type>(dimless, Zero), types));
}

//- The node types of the patches that carry values
std::string types(const fvMesh& mesh, const dictionary& entries = dictionary())
{
    std::string all;
    const m4gnNodeTypes found(mesh, entries);
    for (const label type : found.types()) {
        all += type < 0 ? "" : m4gnNodeTypes::names[type] + ' ';
    }
    return all;
}

//- Four squares of 1 m between patches of these types, in two dimensions
struct squares
{
    caseFolder run;
    const autoPtr<fvMesh> mesh;

    explicit squares(const wordList& sides = {"patch", "patch", "wall", "wall"})
        : mesh(run.block({2, 2, 1}, {2, 2, 1}, {sides[0], sides[1], sides[2], sides[3], "empty", "empty"}))
    {}
};
} // End anonymous namespace

TEST(cellsOfABlock)
{
    caseFolder run;
    // Cells of 0.5 x 1 x 2
    const autoPtr<fvMesh> mesh(run.block({2, 1, 1}, {1, 1, 2}, allPatches));
    const m4gnNodes nodes(*mesh, labelList(6, M4GN_WALL));
    const m4gn_mesh_data& data = nodes.data();

    EXPECT(data.n_directions == 3 && data.n_cells == 2 && data.n_faces == 1);
    EXPECT(data.face_owner[0] == 0 && data.face_neighbour[0] == 1);
    EXPECT(data.n_boundary == 10 && data.n_coupled == 0 && data.n_patches == 6);
    EXPECT_NEAR(data.cell_volumes[1], 1, 1e-14);
    EXPECT_NEAR(data.cell_centres[3], 0.75, 1e-14);
    // Area over distance: 2/0.5 between the cells, 2/0.25 at the left
    EXPECT_NEAR(data.face_coeff[0], 4, 1e-12);
    EXPECT(data.boundary_owner[0] == 0 && data.boundary_patch[0] == 0);
    EXPECT_NEAR(data.boundary_coeff[0], 8, 1e-12);
    EXPECT_NEAR(data.boundary_area[0], -2, 1e-14);
}

TEST(emptyPatchesHaveNoNodes)
{
    caseFolder run;
    const autoPtr<fvMesh> mesh(
        run.block({3, 2, 1}, {3, 2, 1}, {"patch", "patch", "wall", "wall", "empty", "empty"}));
    const m4gnNodes nodes(*mesh, labelList(6, M4GN_WALL));
    const m4gn_mesh_data& data = nodes.data();

    EXPECT(data.n_directions == 2 && data.directions[0] == 0 && data.directions[1] == 1);
    EXPECT(data.n_patches == 4 && data.n_boundary == 10);
    EXPECT_TEXT(data.patch_names[3], "top");
}

TEST(aFieldOfCellsIsGatheredAndImposed)
{
    caseFolder run;
    const autoPtr<fvMesh> mesh(run.block({2, 1, 1}, {2, 1, 1}, allPatches));
    const m4gnNodes nodes(*mesh, labelList(6, M4GN_WALL));
    auto U = field<vector>(*mesh, "U", wordList(6, "calculated"));
    U->primitiveFieldRef()[1] = vector(1, 2, 3);
    U->boundaryFieldRef()[1] = vector(4, 5, 6);

    m4gnNodes::values values;
    EXPECT(nodes.gather("U", values) && values.components == 3);
    EXPECT_NEAR(values.cells[4], 2, 0);
    // The one face of the right patch stands behind that of the left
    EXPECT_NEAR(values.boundary[5], 6, 0);
    EXPECT(!nodes.gather("missing", values));

    nodes.impose("U", 3, scalarField({7, 8, 9, 10, 11, 12}));
    EXPECT_NEAR(U()[1], vector(10, 11, 12), 0);
}

TEST(aFoldedCellIsRefused)
{
    caseFolder run;
    autoPtr<fvMesh> mesh(run.block({2, 1, 1}, {2, 1, 1}, allPatches));
    pointField points(mesh->points());
    for (point& p : points) {
        // The face between the cells, behind the end of the second one
        p.x() = p.x() == 1 ? 2.5 : p.x();
    }
    mesh->movePoints(points);
    EXPECT_REFUSED(m4gnNodes(*mesh, labelList(6, M4GN_WALL)), "inverted");
}

TEST(walls)
{
    squares s;
    auto U = field<vector>(*s.mesh, "U", {"fixedValue", "zeroGradient", "fixedValue", "slip"});
    U->boundaryFieldRef()[0] == vector(1, 0, 0);
    const auto p =
        field<scalar>(*s.mesh, "p", {"zeroGradient", "fixedValue", "zeroGradient", "zeroGradient"});
    EXPECT_TEXT(types(*s.mesh), "inlet outlet wall wall ");
}

TEST(patchesByTheirConditions)
{
    squares s({"patch", "patch", "patch", "symmetryPlane"});
    auto U = field<vector>(*s.mesh, "U", {"noSlip", "slip", "inletOutlet", "symmetryPlane"});
    const auto p =
        field<scalar>(*s.mesh, "p", {"zeroGradient", "zeroGradient", "zeroGradient", "symmetryPlane"});

    // Nothing flows yet
    EXPECT_TEXT(types(*s.mesh), "wall symmetry outlet symmetry ");
    // The bottom's normal is -y
    U->boundaryFieldRef()[2] == vector(0, 1, 0);
    EXPECT_TEXT(types(*s.mesh), "wall symmetry inlet symmetry ");
    U->boundaryFieldRef()[2] == vector(0, -1, 0);
    EXPECT_TEXT(types(*s.mesh), "wall symmetry outlet symmetry ");
}

// Mesh converters give every patch the type patch
TEST(aFixedVelocityOfZeroIsAWall)
{
    squares s({"patch", "patch", "patch", "patch"});
    auto U = field<vector>(*s.mesh, "U", {"fixedValue", "zeroGradient", "fixedValue", "uniformFixedValue"});
    const auto p =
        field<scalar>(*s.mesh, "p", {"zeroGradient", "fixedValue", "zeroGradient", "zeroGradient"});
    U->boundaryFieldRef()[0][1] = vector(1, 0, 0);
    // The last one rests now, but its value is one of time
    EXPECT_TEXT(types(*s.mesh), "inlet outlet wall inlet ");
}

TEST(aDisplacementMakesASolid)
{
    squares s;
    const auto D = field<vector>(*s.mesh, "D", {"fixedValue", "zeroGradient", "fixedGradient", "fixedValue"});
    EXPECT_TEXT(types(*s.mesh), "handle free free handle ");
}

TEST(nodeTypesThatAreGiven)
{
    squares s;
    // A name goes before a pattern; nothing else tells what left and right are
    EXPECT_TEXT(
        types(*s.mesh, dict("nodeTypes { \".*t\" outlet; left inlet; top obstacle; }")),
        "inlet outlet wall obstacle ");

    EXPECT_REFUSED(types(*s.mesh), "what is patch left");
    EXPECT_REFUSED(types(*s.mesh, dict("nodeTypes { left inlt; right outlet; }")), "the type inlt");
    EXPECT_REFUSED(types(*s.mesh, dict("nodeTypes { left inlet; right outlet; lid wall; }")), "fit no patch");
}
