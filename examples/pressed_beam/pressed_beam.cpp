// SPDX-License-Identifier: GPL-3.0-or-later
//
// A program of your own as the host of m4gn, without OpenFOAM: a rigid cylinder presses a beam down, 100 steps of the model of
// deforming beams with contact projection.
//
//     pressed_beam MODEL [FOLDER]
//
// prints a table; where a folder is named, it writes its states for ParaView (FOLDER/state-000.vtk, ...). One rank; on several
// each hands in its own points and elements, as tests/cabi/mpi_body.cpp does.

#include "m4gn.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>

namespace
{

using Point = std::array<double, 3>;

// Lengths, m, and numbers of cells: along x, upwards (y), across (z).
constexpr double length = 0.1, height = 0.018, width = 0.016;
constexpr int nx = 38, ny = 7, nz = 4;

// Across, the cylinder is longer than the beam is wide; its rims are round.
constexpr double radius = 0.012, rim = 0.2 * radius, half = 0.75 * width + rim;
constexpr double size = length / nx;
const Point start{0.8 * length, 0.5 * height + radius + 0.1 * size, 0};

// Steps of the model, and how far the cylinder goes down in each, m.
constexpr int steps = 100;
constexpr double push = 0.4 * length / steps;

// A beam of wedges, held at x = 0.
struct Beam
{
    std::vector<double> points, material;
    std::vector<int64_t> global, elementPoints;
    std::vector<int32_t> types, kinds;

    static int64_t point(int i, int j, int k)
    {
        return i + (nx + 1) * (j + (ny + 1) * static_cast<int64_t>(k));
    }

    Beam()
    {
        for (int k = 0; k <= nz; ++k) {
            for (int j = 0; j <= ny; ++j) {
                for (int i = 0; i <= nx; ++i) {
                    points.insert(
                        points.end(),
                        {length * i / nx, height * (1.0 * j / ny - 0.5), width * (1.0 * k / nz - 0.5)});
                    global.push_back(point(i, j, k));
                    types.push_back(i == 0 ? M4GN_HANDLE : M4GN_BODY);
                }
            }
        }
        for (int k = 0; k < nz; ++k) {
            for (int j = 0; j < ny; ++j) {
                for (int i = 0; i < nx; ++i) {
                    // One diagonal and the other by turns, so that the mesh prefers no direction.
                    const int64_t a = point(i, j, k), b = a + 1, d = point(i, j + 1, k), c = d + 1;
                    const bool turn = (i + j) % 2 != 0;
                    wedge(a, b, turn ? d : c);
                    wedge(turn ? b : a, c, d);
                }
            }
        }
    }

    // Over a triangle, anticlockwise seen from above (z), up to the next layer.
    void wedge(int64_t a, int64_t b, int64_t c)
    {
        const int64_t layer = point(0, 0, 1);
        elementPoints.insert(elementPoints.end(), {a, b, c, a + layer, b + layer, c + layer});
        kinds.push_back(13);
        // Young's modulus Pa, Poisson's ratio, density kg/m^3.
        material.insert(material.end(), {1e6, 0.4, 1000});
    }
};

// The closed surface of the cylinder where it starts: rings of points from one end of the axis to the other.
struct Cylinder
{
    std::vector<double> points;
    std::vector<int32_t> triangles;

    Cylinder()
    {
        const double pi = std::acos(-1.0);
        const int around = static_cast<int>(std::lround(2 * pi * radius / size));
        std::vector<std::array<double, 2>> rings;
        const auto line = [&](int n, double r0, double z0, double r1, double z1) {
            for (int s = 1; s <= n; ++s) {
                rings.push_back({r0 + (r1 - r0) * s / n, z0 + (z1 - z0) * s / n});
            }
        };
        const auto parts = [](double l) { return std::max(1, static_cast<int>(std::lround(l / size))); };
        const double cap = radius - rim, side = half - rim, slant = rim * std::sqrt(0.5);
        line(parts(cap), 0, -half, cap, -half);
        rings.push_back({cap + slant, -side - slant});
        rings.push_back({radius, -side});
        line(parts(2 * side), radius, -side, radius, side);
        rings.push_back({cap + slant, side + slant});
        rings.push_back({cap, half});
        line(parts(cap), cap, half, 0, half);
        rings.pop_back();

        const auto add = [&](double x, double y, double z) {
            points.insert(points.end(), {start[0] + x, start[1] + y, start[2] + z});
        };
        add(0, 0, -half);
        for (const auto& ring : rings) {
            for (int s = 0; s < around; ++s) {
                add(ring[0] * std::sin(2 * pi * s / around), -ring[0] * std::cos(2 * pi * s / around),
                    ring[1]);
            }
        }
        add(0, 0, half);
        const auto last = static_cast<int32_t>(points.size() / 3) - 1;
        const auto at = [&](std::size_t ring, int s) {
            return static_cast<int32_t>(1 + ring * around + s % around);
        };
        for (int s = 0; s < around; ++s) {
            triangles.insert(triangles.end(), {0, at(0, s + 1), at(0, s)});
            for (std::size_t r = 0; r + 1 < rings.size(); ++r) {
                triangles.insert(triangles.end(), {at(r, s), at(r, s + 1), at(r + 1, s)});
                triangles.insert(triangles.end(), {at(r, s + 1), at(r + 1, s + 1), at(r + 1, s)});
            }
            triangles.insert(triangles.end(), {at(rings.size() - 1, s), at(rings.size() - 1, s + 1), last});
        }
    }

    // Displacement of its points after so many steps.
    std::vector<double> displacement(int step) const
    {
        std::vector<double> u(points.size(), 0);
        for (std::size_t i = 1; i < u.size(); i += 3) {
            u[i] = -push * step;
        }
        return u;
    }
};

// The beam where it is now, and its displacement, as a legacy VTK file.
void write(const std::string& folder, int step, const Beam& beam, const std::vector<double>& D)
{
    char name[32];
    std::snprintf(name, sizeof name, "/state-%03d.vtk", step);
    std::ofstream file(folder + name);
    file.precision(9);
    const std::size_t n = beam.types.size(), cells = beam.kinds.size();
    file << "# vtk DataFile Version 3.0\npressed beam\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS " << n
         << " double\n";
    for (std::size_t i = 0; i < 3 * n; ++i) {
        file << beam.points[i] + D[i] << (i % 3 == 2 ? '\n' : ' ');
    }
    file << "CELLS " << cells << ' ' << 7 * cells << '\n';
    for (std::size_t i = 0; i < 6 * cells; ++i) {
        file << (i % 6 == 0 ? "6 " : "") << beam.elementPoints[i] << (i % 6 == 5 ? '\n' : ' ');
    }
    file << "CELL_TYPES " << cells << '\n';
    for (const int32_t kind : beam.kinds) {
        file << kind << '\n';
    }
    file << "POINT_DATA " << n << "\nVECTORS D double\n";
    for (std::size_t i = 0; i < 3 * n; ++i) {
        file << D[i] << (i % 3 == 2 ? '\n' : ' ');
    }
    if (!file.flush()) {
        throw std::runtime_error(
            "cannot write " + folder + name + ": is there a folder " + folder + ", and room in it?");
    }
}

void run(const std::string& model, const std::string& folder)
{
    const Beam beam;
    const Cylinder cylinder;

    m4gn_mesh_data mesh{};
    mesh.n_directions = 3;
    mesh.directions[1] = 1;
    mesh.directions[2] = 2;
    mesh.n_cells = static_cast<int32_t>(beam.types.size());
    mesh.cell_global = beam.global.data();
    mesh.cell_centres = beam.points.data();
    mesh.cell_type = beam.types.data();
    mesh.n_elements = static_cast<int32_t>(beam.kinds.size());
    mesh.element_kind = beam.kinds.data();
    mesh.element_points = beam.elementPoints.data();
    mesh.element_material = beam.material.data();
    mesh.n_obstacle = static_cast<int32_t>(cylinder.points.size() / 3);
    mesh.obstacle_positions = cylinder.points.data();
    mesh.n_obstacle_triangles = static_cast<int32_t>(cylinder.triangles.size() / 3);
    mesh.obstacle_triangles = cylinder.triangles.data();

    const m4gn::Model opened(M4GN_NO_MPI, model);
    m4gn::Session session(M4GN_NO_MPI, mesh, opened, "{\"projection\": {}}");

    // The displacement, which each step replaces by the one after it; the first point of the tip is the last of the first row.
    std::vector<double> D(3 * beam.types.size(), 0);
    const std::size_t tip = 3 * static_cast<std::size_t>(Beam::point(nx, 0, 0));
    std::printf(
        "%zu points, %zu wedges, %d points of the cylinder, %d segments\n", beam.types.size(),
        beam.kinds.size(), static_cast<int>(mesh.n_obstacle), static_cast<int>(session.nSegments()));
    std::printf("step  cylinder (mm)  tip (mm)  gap before projection, after (cells)\n");
    double wall = 0;
    for (int step = 0; step <= steps; ++step) {
        if (step > 0) {
            const auto began = std::chrono::steady_clock::now();
            session.setObstacle(cylinder.displacement(step - 1), cylinder.displacement(step));
            session.step({m4gn_field{"D", 3, D.data(), nullptr}}, {m4gn_field_out{"D", 3, D.data()}});
            wall += std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
        }
        if (step % 10 != 0) {
            continue;
        }
        std::printf("%4d %13.1f %9.2f", step, -1e3 * push * step, 1e3 * D[tip + 1]);
        if (step > 0) {
            const auto report = session.projection();
            std::printf(" %12.3f %8.3f", report.gap_before, report.gap_after);
        }
        std::printf("\n");
        if (!folder.empty()) {
            write(folder, step, beam, D);
        }
    }
    std::printf("%.1f ms a step\n", 1e3 * wall / steps);
}

} // namespace

int main(int argc, char** argv)
{
    if (argc < 2 || argc > 3) {
        std::fprintf(stderr, "usage: pressed_beam MODEL [FOLDER]\n");
        return 2;
    }
    try {
        run(argv[1], argc > 2 ? argv[2] : "");
    } catch (const std::exception& error) {
        std::fprintf(stderr, "pressed_beam: %s\n", error.what());
        return 1;
    }
    return 0;
}
