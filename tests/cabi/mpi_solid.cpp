// Modes of an elastic body through the C ABI on any number of ranks: a clamped beam of bricks, cut across its length.

#include "mesh.hpp"

#include <algorithm>
#include <array>
#include <map>
#include <mpi.h>

namespace
{

using Corner = std::array<int, 3>;

// n[0] x n[1] x n[2] bricks on 0.6 x 0.06 x 0.06 m, held at x = 0; whole or one rank's slice.
class Beam
{
public:
    std::vector<int64_t> pointGlobal;
    std::vector<double> points, young, poisson, density;
    std::vector<int32_t> faceStart{0}, facePoints, faceOwner, faceNeighbour, fixed;
    m4gn_solid data{};

    explicit Beam(const Corner& n, int rank = 0, int size = 1)
    :
        n_(n)
    {
        const Corner low{{n[0]*rank/size, 0, 0}}, high{{n[0]*(rank + 1)/size, n[1], n[2]}};
        const auto cell = [&](const Corner& c)
        {
            return c[0] - low[0] + (high[0] - low[0])*(c[1] + n[1]*c[2]);
        };
        // Internal faces, then those of the boundary and of the cuts.
        for (const bool internal : {true, false})
        {
            Corner c;
            for (c[2] = 0; c[2] < n[2]; ++c[2])
            {
                for (c[1] = 0; c[1] < n[1]; ++c[1])
                {
                    for (c[0] = low[0]; c[0] < high[0]; ++c[0])
                    {
                        for (int d = 0; d < 3; ++d)
                        {
                            auto next = c;
                            ++next[d];
                            const bool last = next[d] == high[d];
                            if (internal && !last)
                            {
                                side(c, d, true, cell(c));
                                faceNeighbour.push_back(cell(next));
                            }
                            if (!internal && last)
                            {
                                side(c, d, true, cell(c));
                            }
                            if (!internal && c[d] == low[d])
                            {
                                side(c, d, false, cell(c));
                            }
                        }
                    }
                }
            }
        }
        const auto cells = static_cast<std::size_t>((high[0] - low[0])*n[1]*n[2]);
        young.assign(cells, 1e6);
        poisson.assign(cells, 0.3);
        density.assign(cells, 1000);
        data.n_directions = 3;
        data.directions[1] = 1;
        data.directions[2] = 2;
        data.n_points = static_cast<int32_t>(pointGlobal.size());
        data.point_global = pointGlobal.data();
        data.points = points.data();
        data.n_faces = static_cast<int32_t>(faceOwner.size());
        data.n_internal_faces = static_cast<int32_t>(faceNeighbour.size());
        data.face_start = faceStart.data();
        data.face_points = facePoints.data();
        data.face_owner = faceOwner.data();
        data.face_neighbour = faceNeighbour.data();
        data.n_cells = static_cast<int32_t>(cells);
        data.young = young.data();
        data.poisson = poisson.data();
        data.density = density.data();
        data.n_fixed = static_cast<int32_t>(fixed.size());
        data.fixed_point = fixed.data();
    }

private:
    Corner n_;
    std::map<int64_t, int32_t> local_;

    // The brick's side across direction d, turning outwards.
    void side(const Corner& brick, int d, bool upper, int owner)
    {
        const int e = (d + 1) % 3, f = (d + 2) % 3;
        std::array<Corner, 4> corners{{brick, brick, brick, brick}};
        for (auto& corner : corners)
        {
            corner[d] += upper;
        }
        ++corners[1][e];
        ++corners[2][e];
        ++corners[2][f];
        ++corners[3][f];
        if (!upper)
        {
            std::swap(corners[1], corners[3]);
        }
        for (const auto& corner : corners)
        {
            facePoints.push_back(point(corner));
        }
        faceStart.push_back(static_cast<int32_t>(facePoints.size()));
        faceOwner.push_back(owner);
    }

    int32_t point(const Corner& c)
    {
        const int64_t global = c[0] + (n_[0] + 1)*(c[1] + (n_[1] + 1)*c[2]);
        const auto found = local_.emplace(global, static_cast<int32_t>(pointGlobal.size()));
        if (found.second)
        {
            pointGlobal.push_back(global);
            points.insert(points.end(), {0.6*c[0]/n_[0], 0.06*c[1]/n_[1], 0.06*c[2]/n_[2]});
            if (c[0] == 0)
            {
                fixed.push_back(found.first->second);
            }
        }
        return found.first->second;
    }
};

std::string first(int n)
{
    return "{\"modes\": " + std::to_string(n) + "}";
}

void sameAsSerial(int rank, int size, int32_t comm)
{
    const Corner n{{24, 2, 3}};
    const Beam whole(n);
    const m4gn::Modes expected(M4GN_NO_MPI, whole.data, first(5));
    const Beam part(n, rank, size);
    const m4gn::Modes found(comm, part.data, first(5));
    const auto values = expected.eigenvalues(), mine = found.eigenvalues();
    REQUIRE(values.size() >= 5 && mine.size() == values.size());
    // 3.516^2 E I / (rho A L^4), less some 5 % in either direction at this size.
    const double bending = 3.516*3.516*1e6*0.06*0.06/12/1000/std::pow(0.6, 4);
    REQUIRE(std::abs(values[0]/bending - 1) < 0.05);
    std::map<int64_t, std::size_t> place;
    for (std::size_t p = 0; p < whole.pointGlobal.size(); ++p)
    {
        place[whole.pointGlobal[p]] = p;
    }
    for (std::size_t i = 0; i < values.size(); ++i)
    {
        REQUIRE(std::abs(mine[i]/values[i] - 1) < 1e-8);
        const auto mode = expected.vector(static_cast<int32_t>(i)), part_of = found.vector(static_cast<int32_t>(i));
        for (std::size_t p = 0; p < part.pointGlobal.size(); ++p)
        {
            for (std::size_t d = 0; d < 3; ++d)
            {
                REQUIRE(std::abs(part_of[3*p + d] - mode[3*place[part.pointGlobal[p]] + d]) < 1e-6);
            }
        }
    }
}

// One rank has bad input: every rank gets an error.
void ranksAgree(int rank, int size, int32_t comm)
{
    std::string message;
    const auto with = [&](void (*change)(Beam&))
    {
        Beam part({{8, 2, 2}}, rank, size);
        if (rank == size - 1)
        {
            change(part);
        }
        return failure(message, [&] { m4gn::Modes(comm, part.data, first(2)); });
    };
    REQUIRE(with([](Beam& b) { b.poisson[0] = 0.5; }) != M4GN_OK);
    REQUIRE(contains(message, "Poisson's ratio of cell 0 is 0.5"));
    REQUIRE(with([](Beam& b) { b.density[1] = 0; }) != M4GN_OK);
    REQUIRE(contains(message, "density of cell 1 is 0"));
    REQUIRE(with([](Beam& b) { std::swap(b.facePoints[0], b.facePoints[1]); }) != M4GN_OK);
    REQUIRE(with([](Beam& b) { b.points[7] = NAN; }) != M4GN_OK);
    REQUIRE(with([](Beam& b) { b.facePoints[5] = 10000; }) != M4GN_OK);
    REQUIRE(contains(message, "names point 10000"));
    REQUIRE(with([](Beam& b) { b.data.young = nullptr; }) != M4GN_OK);
    REQUIRE(with([](Beam& b) { b.data.n_faces = -1; }) != M4GN_OK);
    REQUIRE(with([](Beam& b) { b.pointGlobal[0] = 1 << 20; }) != M4GN_OK);
    REQUIRE(contains(message, "point_global"));

    Beam loose({{8, 2, 2}}, rank, size);
    loose.data.n_fixed = 0;
    REQUIRE(failure(message, [&] { m4gn::Modes(comm, loose.data, first(2)); }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "no displacement is held on any rank"));
    REQUIRE(failure(message, [&] { m4gn::Modes(comm, loose.data, "{\"block\": 3}"); }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "for matrices of the host"));
    loose.data.free_body = 1;
    const m4gn::Modes rigid(comm, loose.data, first(7));
    REQUIRE(std::abs(rigid.eigenvalues()[5]) < 1e-6*rigid.eigenvalues()[6]);
}

} // namespace

int main(int argc, char** argv)
{
    MPI_Init(&argc, &argv);
    int rank = 0, size = 1;
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    const int32_t comm = MPI_Comm_c2f(MPI_COMM_WORLD);
    sameAsSerial(rank, size, comm);
    ranksAgree(rank, size, comm);
    MPI_Finalize();
    return 0;
}
