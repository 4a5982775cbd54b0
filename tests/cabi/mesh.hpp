// A channel of nx x ny rectangles on [0, nx] x [0, ny] as a host describes it.

#ifndef M4GN_TEST_MESH_HPP
#define M4GN_TEST_MESH_HPP

#include "m4gn.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <initializer_list>
#include <string>
#include <vector>

// Unlike assert, there in every build.
#define REQUIRE(condition)                                                                                   \
    do {                                                                                                     \
        if (!(condition)) {                                                                                  \
            std::fprintf(                                                                                    \
                stderr, "%s:%d: %s\n  last error: %s\n", __FILE__, __LINE__, #condition, m4gn_last_error()); \
            std::exit(1);                                                                                    \
        }                                                                                                    \
    } while (false)

// Settings with these entries.
inline std::string settings(const std::string& entries) { return "{" + entries + "}"; }

class Channel
{
public:
    std::vector<int64_t> cellGlobal, boundaryGlobal;
    std::vector<double> cellCentres, cellVolumes, faceCoeff, boundaryCentres, boundaryArea, boundaryCoeff;
    std::vector<int32_t> faceOwner, faceNeighbour, boundaryOwner, boundaryType, boundaryPatch;
    std::vector<const char*> patches{"inlet", "outlet", "walls"};
    m4gn_mesh_data data{};

    Channel(int nx, int ny) : nx_(nx)
    {
        for (int j = 0; j < ny; ++j) {
            for (int i = 0; i < nx; ++i) {
                cellGlobal.push_back(cell(i, j));
                append(cellCentres, i + 0.5, j + 0.5);
                cellVolumes.push_back(1);
                if (i + 1 < nx) {
                    face(cell(i, j), cell(i + 1, j));
                }
                if (j + 1 < ny) {
                    face(cell(i, j), cell(i, j + 1));
                }
            }
        }
        // Numbered inlet, outlet, lower wall, upper wall.
        for (int j = 0; j < ny; ++j) {
            boundary(cell(0, j), j, 0, j + 0.5, -1, 0, M4GN_INLET, 0);
            boundary(cell(nx - 1, j), ny + j, nx, j + 0.5, 1, 0, M4GN_OUTLET, 1);
        }
        for (int i = 0; i < nx; ++i) {
            boundary(cell(i, 0), 2 * ny + i, i + 0.5, 0, 0, -1, M4GN_WALL, 2);
            boundary(cell(i, ny - 1), 2 * ny + nx + i, i + 0.5, ny, 0, 1, M4GN_WALL, 2);
        }
        describe();
    }

    Channel(const Channel&) = delete;

    int nCells() const { return data.n_cells; }
    int nBoundary() const { return data.n_boundary; }

private:
    int nx_;

    int cell(int i, int j) const { return j * nx_ + i; }

    static void append(std::vector<double>& list, double x, double y)
    {
        list.push_back(x);
        list.push_back(y);
        list.push_back(0.5);
    }

    void face(int a, int b)
    {
        faceOwner.push_back(a);
        faceNeighbour.push_back(b);
        faceCoeff.push_back(1);
    }

    void boundary(int own, int global, double x, double y, double ax, double ay, int type, int patch)
    {
        boundaryOwner.push_back(own);
        boundaryGlobal.push_back(global);
        append(boundaryCentres, x, y);
        boundaryArea.insert(boundaryArea.end(), {ax, ay, 0});
        boundaryCoeff.push_back(2);
        boundaryType.push_back(type);
        boundaryPatch.push_back(patch);
    }

    void describe()
    {
        data.n_directions = 2;
        data.directions[0] = 0;
        data.directions[1] = 1;
        data.n_cells = static_cast<int32_t>(cellGlobal.size());
        data.cell_global = cellGlobal.data();
        data.cell_centres = cellCentres.data();
        data.cell_volumes = cellVolumes.data();
        data.n_faces = static_cast<int32_t>(faceOwner.size());
        data.face_owner = faceOwner.data();
        data.face_neighbour = faceNeighbour.data();
        data.face_coeff = faceCoeff.data();
        data.n_boundary = static_cast<int32_t>(boundaryOwner.size());
        data.boundary_owner = boundaryOwner.data();
        data.boundary_global = boundaryGlobal.data();
        data.boundary_centres = boundaryCentres.data();
        data.boundary_area = boundaryArea.data();
        data.boundary_coeff = boundaryCoeff.data();
        data.boundary_type = boundaryType.data();
        data.boundary_patch = boundaryPatch.data();
        data.n_patches = static_cast<int32_t>(patches.size());
        data.patch_names = patches.data();
    }
};

// Fields that are functions of the numbers of cells and faces.
struct Fields
{
    std::vector<double> U, UBoundary, p, pBoundary;

    explicit Fields(const Channel& mesh)
    {
        for (int64_t g : mesh.cellGlobal) {
            U.insert(U.end(), {std::sin(0.3 * g), std::cos(0.7 * g), 5});
            p.push_back(std::sin(1.1 * g));
        }
        for (int64_t g : mesh.boundaryGlobal) {
            UBoundary.insert(UBoundary.end(), {0.1 * std::sin(0.2 * g), 0, 5});
            pBoundary.push_back(0.5 * std::cos(0.4 * g));
        }
    }

    std::vector<const double*> cells() const { return {U.data(), p.data()}; }

    std::vector<const double*> boundary() const { return {UBoundary.data(), pBoundary.data()}; }

    std::vector<double*> next() { return {U.data(), p.data()}; }

    // The same as the state of a ride on this mesh.
    m4gn::State state(const Channel& mesh)
    {
        m4gn::State state;
        state.add("U", M4GN_CELLS, M4GN_SOLVED, 3, U, mesh.cellVolumes.data(), 2);
        state.add("p", M4GN_CELLS, M4GN_FOLLOWS, 1, p);
        state.add("U", M4GN_BOUNDARY, M4GN_CARRIED, 3, UBoundary);
        state.add("p", M4GN_BOUNDARY, M4GN_CARRIED, 1, pBoundary);
        return state;
    }
};

// The model's stride is 0.01 s, five of these.
constexpr double dt = 0.002;

// Where a host of a ride is after so many steps of its solver.
inline m4gn_ride_step at(int64_t index)
{
    m4gn_ride_step step{};
    step.time = step.output_time = dt * static_cast<double>(index);
    step.delta_t = dt;
    step.end_time = HUGE_VAL;
    step.index = index;
    step.correctors = step.most_correctors = -1;
    return step;
}

inline bool contains(const std::string& text, const std::string& part)
{
    if (text.find(part) == std::string::npos) {
        std::fprintf(stderr, "\"%s\" is not in \"%s\"\n", part.c_str(), text.c_str());
        return false;
    }
    return true;
}

// Runs an action that must throw; returns its status, and its message in `message`.
template <class Action> int32_t failure(std::string& message, const Action& action)
{
    try {
        action();
    } catch (const m4gn::Error& error) {
        message = error.what();
        return error.status();
    }
    message.clear();
    return M4GN_OK;
}

// Whether an action throws this status, with all of these in its message.
using Texts = std::initializer_list<const char*>;

template <class Action> bool fails(int32_t status, Texts texts, const Action& action)
{
    std::string message;
    bool all = failure(message, action) == status;
    for (const char* text : texts) {
        all = all && contains(message, text);
    }
    return all;
}

#endif
