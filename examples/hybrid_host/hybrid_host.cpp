// SPDX-License-Identifier: GPL-3.0-or-later
//
// A solver of your own as the host of a hybrid run, without OpenFOAM: a scalar p is carried and spread by a steady velocity U through a
// channel of nx x ny square cells, explicit in time. What comes in swings. Surrogates take the solver's place for jumps.
//
//     hybrid_host MODEL OPTIONS END [STATE AT [resume]]
//
// OPTIONS are the settings of m4gn_ride_new. MODEL is the file of a network of U and p in two dimensions; one that was not trained on
// this flow is kept from jumping by control. With "-" there is none, and the surrogate is a fit of the run's own states:
//
//     hybrid_host - '{"mode": "replace", "surrogates": ["dmd"]}' 20
//
// At the time AT, at which a step of the solver or a stride of a jump has to end, the run's state goes to STATE (the ride's) and
// STATE.fields (the host's); with `resume` a run goes on from there. The last line is a checksum of p at the end.

#include "m4gn.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <numeric>

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

    Channel()
    {
        for (int c = 0; c < nCells; ++c) {
            const int i = c % nx, j = c / nx;
            global.push_back(c);
            centres.insert(centres.end(), {(i + 0.5) * h, (j + 0.5) * h, 0.5 * h});
            volumes.push_back(h * h * h);
            for (const int other : {i + 1 < nx ? c + 1 : -1, j + 1 < ny ? c + nx : -1}) {
                if (other >= 0) {
                    owner.push_back(c);
                    neighbour.push_back(other);
                    faceCoeff.push_back(h);
                }
            }
        }
        for (int j = 0; j < ny; ++j) {
            boundary(j * nx, -1, 0, M4GN_INLET, 0);
        }
        for (int j = 0; j < ny; ++j) {
            boundary(j * nx + nx - 1, 1, 0, M4GN_OUTLET, 1);
        }
        for (int i = 0; i < nx; ++i) {
            boundary(i, 0, -1, M4GN_WALL, 2);
            boundary(nCells - nx + i, 0, 1, M4GN_WALL, 2);
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

    // A face of this cell with an outward normal.
    void boundary(int cell, double x, double y, int type, int patch)
    {
        boundaryGlobal.push_back(static_cast<int64_t>(boundaryOwner.size()));
        boundaryOwner.push_back(cell);
        const double* centre = &centres[3 * cell];
        boundaryCentres.insert(
            boundaryCentres.end(), {centre[0] + 0.5 * h * x, centre[1] + 0.5 * h * y, centre[2]});
        boundaryArea.insert(boundaryArea.end(), {x * h * h, y * h * h, 0});
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
    std::vector<double> U, UBoundary, p, pBoundary, held;

    explicit Solver(const Channel& m)
        : mesh(m), U(3 * nCells), UBoundary(3 * m.boundaryOwner.size()), p(nCells),
          pBoundary(m.boundaryOwner.size())
    {
        for (std::size_t f = 0; f < pBoundary.size(); ++f) {
            const bool wall = mesh.boundaryType[f] == M4GN_WALL;
            UBoundary[3 * f] = wall ? 0 : profile(mesh.boundaryCentres[3 * f + 1]);
            held.push_back(mesh.boundaryType[f] == M4GN_INLET);
        }
        complete();
    }

    static double profile(double y) { return 6 * speed * y * (ny * h - y) / ((ny * h) * (ny * h)); }

    // p of the inlet's face j.
    static double inlet(double time, int j) { return std::sin(6 * time) * std::sin(M_PI * (j + 0.5) / ny); }

    // What follows from time and p: the velocity is the host's own, and p does not change across outlet and walls.
    void complete()
    {
        for (int c = 0; c < nCells; ++c) {
            U[3 * c] = profile(mesh.centres[3 * c + 1]);
            U[3 * c + 1] = 0;
        }
        for (std::size_t f = 0; f < pBoundary.size(); ++f) {
            pBoundary[f] = held[f] ? inlet(time, static_cast<int>(f)) : p[mesh.boundaryOwner[f]];
        }
    }

    void step()
    {
        const std::vector<double> old(p);
        for (int c = 0; c < nCells; ++c) {
            const int i = c % nx, j = c / nx;
            const double here = old[c], west = i ? old[c - 1] : pBoundary[j],
                         east = i + 1 < nx ? old[c + 1] : here;
            const double south = j ? old[c - nx] : here, north = j + 1 < ny ? old[c + nx] : here;
            const double spread = diffusivity * (west + east + south + north - 4 * here) / (h * h);
            p[c] += dt * (spread - U[3 * c] * (here - west) / h);
        }
        advance(dt);
    }

    // p is that of a later time.
    void advance(double by)
    {
        time += by;
        complete();
    }
};

class Host
{
public:
    // saveAt: the time at which the state goes to the path; below 0: never.
    Host(
        const std::string& model, const std::string& options, double end, const std::string& path,
        double saveAt)
        : end_(end), saveAt_(saveAt), path_(path), solver_(mesh_)
    {
        m4gn::Host host{};
        host.state.add("p", M4GN_CELLS, M4GN_SOLVED, 1, solver_.p, mesh_.volumes.data());
        // The inlet's faces come first.
        host.state.add(
            {"inlet", M4GN_FACES, M4GN_PRESCRIBED, 1, 0, ny, -HUGE_VAL, nullptr}, solver_.pBoundary.data());
        host.ahead = [this](double later, const std::vector<double*>& places) {
            for (int j = 0; j < ny; ++j) {
                places[1][j] = Solver::inlet(solver_.time + later, j);
            }
        };
        if (model != "-") {
            session_.reset(new m4gn::Session(M4GN_NO_MPI, mesh_.data, m4gn::Model(M4GN_NO_MPI, model)));
            host.session = session_.get();
            host.mesh = &mesh_.data;
            // What a network reads and a fit need not know.
            host.state.add("U", M4GN_CELLS, M4GN_SOLVED, 3, solver_.U, mesh_.volumes.data(), 2)
                .add("U", M4GN_BOUNDARY, M4GN_CARRIED, 3, solver_.UBoundary)
                .add("p", M4GN_BOUNDARY, M4GN_CARRIED, 1, solver_.pBoundary)
                .add("p", M4GN_BOUNDARY, M4GN_HELD, 1, solver_.held);
        }
        ride_.reset(new m4gn::Ride(M4GN_NO_MPI, host, options, now()));
    }

    void resume()
    {
        std::ifstream file(path_ + ".fields", std::ios::binary);
        if (!file.read(reinterpret_cast<char*>(&solver_.time), sizeof(double))
                 .read(reinterpret_cast<char*>(solver_.p.data()), nCells * sizeof(double)))
        {
            throw std::runtime_error("cannot read " + path_ + ".fields");
        }
        solver_.complete();
        follow(ride_->load(path_, now()));
    }

    void run()
    {
        while (solver_.time < end_ - 0.5 * dt) {
            solver_.step();
            follow(ride_->solved(now()));
        }
        const std::string summary = ride_->text(M4GN_RIDE_SUMMARY);
        listen();
        const double sum = std::inner_product(solver_.p.begin(), solver_.p.end(), solver_.p.begin(), 0.0);
        std::printf(
            "%send: time %.6f, steps %ld, sum of squares %.17g\n", summary.c_str(), solver_.time, steps(),
            sum);
        if (saveAt_ >= 0) {
            throw std::runtime_error("no state was written: no step of the solver and no stride ended at AT");
        }
    }

private:
    double end_, saveAt_;
    std::string path_;
    Channel mesh_;
    Solver solver_;
    std::unique_ptr<m4gn::Session> session_;
    std::unique_ptr<m4gn::Ride> ride_;

    long steps() const { return std::lround(solver_.time / dt); }

    m4gn_ride_step now() const { return {solver_.time, dt, end_, solver_.time, steps(), nullptr, -1, -1, 0}; }

    void save()
    {
        if (std::abs(solver_.time - saveAt_) < 0.5 * dt) {
            ride_->save(path_);
            std::ofstream file(path_ + ".fields", std::ios::binary);
            if (!file.write(reinterpret_cast<const char*>(&solver_.time), sizeof(double))
                     .write(reinterpret_cast<const char*>(solver_.p.data()), nCells * sizeof(double))
                     .flush())
            {
                throw std::runtime_error("cannot write " + path_ + ".fields");
            }
            saveAt_ = -1;
        }
    }

    void listen()
    {
        for (const int32_t kind : {M4GN_RIDE_LOG, M4GN_RIDE_JUMPS, M4GN_RIDE_STRIDES, M4GN_RIDE_ERRORS}) {
            std::fputs(ride_->text(kind).c_str(), stdout);
        }
        for (std::string w = ride_->text(M4GN_RIDE_WARNING); !w.empty(); w = ride_->text(M4GN_RIDE_WARNING)) {
            std::fprintf(stderr, "warning: %s\n", w.c_str());
        }
    }

    // Does what the ride says until the solver is to work again.
    void follow(m4gn_ride_answer answer)
    {
        save();
        while (answer.action != M4GN_RIDE_SOLVE) {
            if (answer.action == M4GN_RIDE_STRIDE) {
                answer = ride_->stride();
            } else if (answer.action == M4GN_RIDE_ADVANCE) {
                solver_.advance(answer.duration);
                answer = ride_->advanced(now());
                save();
            } else {
                answer = ride_->handedBack(now());
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
        Host host(
            argv[1], argv[2], std::atof(argv[3]), argc > 4 ? argv[4] : "",
            argc == 6 ? std::atof(argv[5]) : -1);
        if (argc == 7) {
            host.resume();
        }
        host.run();
    } catch (const std::exception& e) {
        std::fprintf(stderr, "hybrid_host: %s\n", e.what());
        return 1;
    }
    return 0;
}
