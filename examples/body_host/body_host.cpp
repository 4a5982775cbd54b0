// SPDX-License-Identifier: GPL-3.0-or-later
//
// A program of your own as the host of a body, without OpenFOAM: a rigid cylinder presses a beam down, 100 steps of the model of
// deforming beams. The motion of the cylinder is prescribed.
//
//     body_host models/deforming-beam.safetensors
//
// prints where the tip of the beam is. One rank; on several each hands in its own points and elements, and the whole obstacle.

#include "m4gn.hpp"

#include <cmath>
#include <cstdio>

namespace
{

// Lengths, m, and numbers of cells: along x, upwards (y), across (z).
constexpr double length = 0.1, height = 0.018, width = 0.016;
constexpr int nx = 38, ny = 7, nz = 4;

// The cylinder is above the beam at the start, and goes down in each step, m.
constexpr double radius = 0.012, size = length / nx;
constexpr double axisX = 0.8 * length, axisY = 0.5 * height + radius + 0.1 * size;
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
                    const double y = height * (1.0 * j / ny - 0.5), z = width * (1.0 * k / nz - 0.5);
                    points.insert(points.end(), {length * i / nx, y, z});
                    global.push_back(point(i, j, k));
                    types.push_back(i == 0 ? M4GN_HANDLE : M4GN_BODY);
                    if (i < nx && j < ny && k < nz) {
                        // One diagonal and the other by turns, so that the mesh prefers no direction
                        const int64_t a = point(i, j, k), b = a + 1, d = point(i, j + 1, k), c = d + 1;
                        const bool turn = (i + j) % 2 != 0;
                        wedge(a, b, turn ? d : c);
                        wedge(turn ? b : a, c, d);
                    }
                }
            }
        }
    }

    // Over a triangle, anticlockwise seen from above (z), up to the next layer
    void wedge(int64_t a, int64_t b, int64_t c)
    {
        const int64_t layer = point(0, 0, 1);
        elementPoints.insert(elementPoints.end(), {a, b, c, a + layer, b + layer, c + layer});
        kinds.push_back(13);
        // Young's modulus Pa, Poisson's ratio, density kg/m^3
        material.insert(material.end(), {1e6, 0.4, 1000});
    }
};

// The closed surface of the cylinder where it starts: rings of points along the axis, longer than the beam is wide, and the middles
// of both ends.
struct Cylinder
{
    std::vector<double> points;
    std::vector<int32_t> triangles;

    Cylinder()
    {
        const double pi = std::acos(-1.0), half = width;
        const int around = static_cast<int>(std::lround(2 * pi * radius / size));
        const int along = static_cast<int>(std::lround(2 * half / size));
        points = {axisX, axisY, -half};
        for (int r = 0; r <= along; ++r) {
            for (int s = 0; s < around; ++s) {
                const double angle = 2 * pi * s / around, z = half * (2.0 * r / along - 1);
                points.insert(
                    points.end(), {axisX + radius * std::sin(angle), axisY - radius * std::cos(angle), z});
            }
        }
        points.insert(points.end(), {axisX, axisY, half});
        const int32_t last = 1 + (along + 1) * around;
        const auto at = [&](int r, int s) { return 1 + r * around + s % around; };
        for (int s = 0; s < around; ++s) {
            triangles.insert(triangles.end(), {0, at(0, s + 1), at(0, s)});
            for (int r = 0; r < along; ++r) {
                triangles.insert(triangles.end(), {at(r, s), at(r, s + 1), at(r + 1, s)});
                triangles.insert(triangles.end(), {at(r, s + 1), at(r + 1, s + 1), at(r + 1, s)});
            }
            triangles.insert(triangles.end(), {at(along, s), at(along, s + 1), last});
        }
    }

    // Displacement of its points after so many steps
    std::vector<double> displacement(int step) const
    {
        std::vector<double> u(points.size(), 0);
        for (std::size_t i = 1; i < u.size(); i += 3) {
            u[i] = -push * step;
        }
        return u;
    }
};

void run(const std::string& model)
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
    m4gn::Session session(M4GN_NO_MPI, mesh, opened, "{}");

    // The displacement, which each step replaces by the one after it
    std::vector<double> D(3 * beam.types.size(), 0);
    const auto tip = 3 * static_cast<std::size_t>(Beam::point(nx, 0, 0));
    std::printf("step  cylinder (mm)  tip (mm)\n");
    for (int step = 1; step <= steps; ++step) {
        // Where the obstacle is at the start and at the end of the step
        std::vector<double> motion(cylinder.displacement(step - 1));
        const std::vector<double> after(cylinder.displacement(step));
        motion.insert(motion.end(), after.begin(), after.end());
        session.step({D.data()}, {motion.data()}, {D.data()});
        if (step % 10 == 0) {
            std::printf("%4d %13.1f %9.2f\n", step, -1e3 * push * step, 1e3 * D[tip + 1]);
        }
    }
}

} // namespace

int main(int argc, char** argv)
{
    if (argc != 2) {
        std::fprintf(stderr, "usage: body_host MODEL\n");
        return 2;
    }
    try {
        run(argv[1]);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "body_host: %s\n", error.what());
        return 1;
    }
    return 0;
}
