// SPDX-License-Identifier: GPL-3.0-or-later
//
// A solver of your own as the host of a hybrid run, without OpenFOAM: a scalar p is carried and spread by a steady velocity U through a
// channel of nx x ny square cells, explicit in time, and the model of a session takes its place for jumps.
//
//     hybrid_host MODEL OPTIONS END [STATE AT [resume]]
//
// OPTIONS are the settings of m4gn_ride_new. At the time AT the state goes to STATE (the ride's) and STATE.fields (the host's);
// with `resume` the run goes on from there. The last line is a checksum of p at the end. Any model with inputs U and p of two
// dimensions will do; one that was not trained on this flow is kept from jumping by control.

#include "m4gn.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <stdexcept>

namespace
{

constexpr int nx = 24, ny = 12, nCells = nx * ny;
constexpr double h = 0.05, dt = 0.002, diffusivity = 2e-3, speed = 1;

// The channel as m4gn sees it: cells, faces with the coefficients of a Laplacian, boundary faces.
struct Channel
{
    std::vector<int64_t> global, boundaryGlobal;
    std::vector<double> centres, volumes, faceCoeff, boundaryCentres, boundaryArea, boundaryCoeff;
    std::vector<int32_t> owner, neighbour, boundaryOwner, boundaryType, boundaryPatch;
    std::vector<const char*> patches{"inlet", "outlet", "walls"};
    m4gn_mesh_data data{};

    static int cell(int i, int j) { return j * nx + i; }

    Channel()
    {
        for (int j = 0; j < ny; ++j) {
            for (int i = 0; i < nx; ++i) {
                global.push_back(cell(i, j));
                centres.insert(centres.end(), {(i + 0.5) * h, (j + 0.5) * h, 0.5 * h});
                volumes.push_back(h * h * h);
                if (i + 1 < nx) {
                    face(cell(i, j), cell(i + 1, j));
                }
                if (j + 1 < ny) {
                    face(cell(i, j), cell(i, j + 1));
                }
            }
        }
        for (int j = 0; j < ny; ++j) {
            boundary(cell(0, j), 0, (j + 0.5) * h, -1, 0, M4GN_INLET, 0);
        }
        for (int j = 0; j < ny; ++j) {
            boundary(cell(nx - 1, j), nx * h, (j + 0.5) * h, 1, 0, M4GN_OUTLET, 1);
        }
        for (int i = 0; i < nx; ++i) {
            boundary(cell(i, 0), (i + 0.5) * h, 0, 0, -1, M4GN_WALL, 2);
        }
        for (int i = 0; i < nx; ++i) {
            boundary(cell(i, ny - 1), (i + 0.5) * h, ny * h, 0, 1, M4GN_WALL, 2);
        }

        data.n_directions = 2;
        data.directions[1] = 1;
        data.n_cells = nCells;
        data.cell_global = global.data();
        data.cell_centres = centres.data();
        data.cell_volumes = volumes.data();
        data.n_faces = static_cast<int32_t>(owner.size());
        data.face_owner = owner.data();
        data.face_neighbour = neighbour.data();
        data.face_coeff = faceCoeff.data();
        data.n_boundary = static_cast<int32_t>(boundaryOwner.size());
        data.boundary_owner = boundaryOwner.data();
        data.boundary_global = boundaryGlobal.data();
        data.boundary_centres = boundaryCentres.data();
        data.boundary_area = boundaryArea.data();
        data.boundary_coeff = boundaryCoeff.data();
        data.boundary_type = boundaryType.data();
        data.boundary_patch = boundaryPatch.data();
        data.n_patches = 3;
        data.patch_names = patches.data();
    }

    void face(int a, int b)
    {
        owner.push_back(a);
        neighbour.push_back(b);
        faceCoeff.push_back(h);
    }

    void boundary(int cell, double x, double y, double ax, double ay, int type, int patch)
    {
        boundaryGlobal.push_back(static_cast<int64_t>(boundaryOwner.size()));
        boundaryOwner.push_back(cell);
        boundaryCentres.insert(boundaryCentres.end(), {x, y, 0.5 * h});
        boundaryArea.insert(boundaryArea.end(), {ax * h * h, ay * h * h, 0});
        boundaryCoeff.push_back(2 * h);
        boundaryType.push_back(type);
        boundaryPatch.push_back(patch);
    }
};

// The host's solver: p(t) in the cells, U a parabola over the channel.
struct Solver
{
    const Channel& mesh;
    double time = 0;
    int64_t index = 0;
    std::vector<double> U, UBoundary, p, pBoundary;
    std::vector<int32_t> held;

    explicit Solver(const Channel& m)
        : mesh(m), U(3 * nCells), UBoundary(3 * m.boundaryOwner.size()), p(nCells),
          pBoundary(m.boundaryOwner.size())
    {
        for (int c = 0; c < nCells; ++c) {
            U[3 * c] = profile(mesh.centres[3 * c + 1]);
        }
        for (std::size_t f = 0; f < mesh.boundaryOwner.size(); ++f) {
            const bool wall = mesh.boundaryType[f] == M4GN_WALL;
            UBoundary[3 * f] = wall ? 0 : profile(mesh.boundaryCentres[3 * f + 1]);
            held.push_back(mesh.boundaryType[f] == M4GN_INLET);
        }
        setBoundary();
    }

    static double profile(double y) { return 6 * speed * y * (ny * h - y) / ((ny * h) * (ny * h)); }

    // What comes in swings; elsewhere p does not change across the boundary.
    void setBoundary()
    {
        for (std::size_t f = 0; f < pBoundary.size(); ++f) {
            const double y = mesh.boundaryCentres[3 * f + 1];
            pBoundary[f] =
                held[f] ? std::sin(6 * time) * std::sin(M_PI * y / (ny * h)) : p[mesh.boundaryOwner[f]];
        }
    }

    void step()
    {
        std::vector<double> next(p);
        for (int j = 0; j < ny; ++j) {
            for (int i = 0; i < nx; ++i) {
                const int c = Channel::cell(i, j);
                const double here = p[c], west = i ? p[c - 1] : pBoundary[j],
                             east = i + 1 < nx ? p[c + 1] : here;
                const double south = j ? p[c - nx] : here, north = j + 1 < ny ? p[c + nx] : here;
                const double spread = diffusivity * (west + east + south + north - 4 * here) / (h * h);
                next[c] += dt * (spread - U[3 * c] * (here - west) / h);
            }
        }
        p = next;
        time += dt;
        ++index;
        setBoundary();
    }
};

class Host
{
public:
    Host(const std::string& model, const std::string& options, double end)
        : end_(end), solver_(mesh_), session_(M4GN_NO_MPI, mesh_.data, m4gn::Model(M4GN_NO_MPI, model)),
          ride_(session_, mesh_.data, options, now())
    {}

    void saveAt(const std::string& path, double at)
    {
        path_ = path;
        saveTime_ = at;
    }

    void resume(const std::string& path)
    {
        std::ifstream file(path + ".fields", std::ios::binary);
        file.read(reinterpret_cast<char*>(&solver_.time), sizeof(double));
        file.read(reinterpret_cast<char*>(&solver_.index), sizeof(int64_t));
        file.read(reinterpret_cast<char*>(solver_.p.data()), nCells * sizeof(double));
        if (!file) {
            throw std::runtime_error("cannot read " + path + ".fields");
        }
        solver_.setBoundary();
        follow(ride_.load(path, now()));
    }

    void run()
    {
        while (solver_.time < end_ - 0.5 * dt) {
            solver_.step();
            const m4gn_ride_answer answer = ride_.solved(now());
            save();
            follow(answer);
        }
        const std::string summary = ride_.text(M4GN_RIDE_SUMMARY);
        listen();
        double sum = 0;
        for (const double value : solver_.p) {
            sum += value * value;
        }
        std::printf(
            "%send: time %.6f, steps %lld, sum of squares %.17g\n", summary.c_str(), solver_.time,
            static_cast<long long>(solver_.index), sum);
    }

private:
    double end_, saveTime_ = -1;
    std::string path_;
    Channel mesh_;
    Solver solver_;
    m4gn::Session session_;
    m4gn::Ride ride_;

    m4gn_ride_step now() const
    {
        return {solver_.time, dt, end_, solver_.time, 0, solver_.index, nullptr, -1, -1};
    }

    std::vector<m4gn_field> fields() const
    {
        return {
            {"U", 3, solver_.U.data(), solver_.UBoundary.data()},
            {"p", 1, solver_.p.data(), solver_.pBoundary.data()}};
    }

    void save()
    {
        if (std::abs(solver_.time - saveTime_) > 0.5 * dt) {
            return;
        }
        ride_.save(path_);
        std::ofstream file(path_ + ".fields", std::ios::binary);
        file.write(reinterpret_cast<const char*>(&solver_.time), sizeof(double));
        file.write(reinterpret_cast<const char*>(&solver_.index), sizeof(int64_t));
        file.write(reinterpret_cast<const char*>(solver_.p.data()), nCells * sizeof(double));
    }

    void listen()
    {
        for (const int32_t kind : {M4GN_RIDE_LOG, M4GN_RIDE_JUMPS, M4GN_RIDE_STRIDES, M4GN_RIDE_ERRORS}) {
            std::fputs(ride_.text(kind).c_str(), stdout);
        }
        for (std::string w = ride_.text(M4GN_RIDE_WARNING); !w.empty(); w = ride_.text(M4GN_RIDE_WARNING)) {
            std::fprintf(stderr, "warning: %s\n", w.c_str());
        }
    }

    // Does what the ride says until the solver is to work again.
    void follow(m4gn_ride_answer answer)
    {
        std::vector<double> U(solver_.U), p(nCells);
        const std::vector<const int32_t*> held(2, solver_.held.data());
        while (answer.action != M4GN_RIDE_SOLVE) {
            switch (answer.action) {
            case M4GN_RIDE_DECIDE:
                answer = ride_.decide(fields(), held.data());
                break;
            case M4GN_RIDE_STRIDE:
                answer = ride_.stride(fields(), {{"U", 3, U.data()}, {"p", 1, p.data()}});
                break;
            case M4GN_RIDE_ADVANCE:
                // The velocity is the host's own and stays.
                solver_.p = p;
                solver_.time += answer.duration;
                solver_.index += answer.solver_steps;
                solver_.setBoundary();
                answer = ride_.advanced(now());
                save();
                break;
            default:
                answer = ride_.handedBack(now(), fields());
            }
        }
        listen();
    }
};

} // namespace

int main(int argc, char** argv)
{
    if (argc != 4 && argc != 6 && !(argc == 7 && !std::strcmp(argv[6], "resume"))) {
        std::fprintf(stderr, "usage: hybrid_host MODEL OPTIONS END [STATE AT [resume]]\n");
        return 2;
    }
    try {
        Host host(argv[1], argv[2], std::atof(argv[3]));
        if (argc == 6) {
            host.saveAt(argv[4], std::atof(argv[5]));
        }
        if (argc == 7) {
            host.resume(argv[4]);
        }
        host.run();
    } catch (const std::exception& e) {
        std::fprintf(stderr, "hybrid_host: %s\n", e.what());
        return 1;
    }
    return 0;
}
