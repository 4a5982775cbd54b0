// The model of deforming beams as a host rides it: an obstacle goes down on a beam that several ranks share, with contact
// projection, and the answer is the one of a single rank. So it is of two beams, the upper of which is pressed on the lower.

#include "mesh.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <mpi.h>

namespace
{

const std::string model = std::string(M4GN_TEST_DATA) + "/../../models/deforming-beam.safetensors";

using Point = std::array<double, 3>;

// A beam of 24 x 4 x 4 hexahedra, 0.1 m x 0.016 m x 0.016 m, held at x = 0, under an octahedron, or two of them, the second 0.5 mm
// below the first; a rank has the points in planes of its own and the elements whose first point it has.
class Beam
{
public:
    static constexpr int nx = 24, ny = 4, nz = 4;

    std::vector<int64_t> global, elementPoints;
    std::vector<double> positions, material, obstacle;
    std::vector<int32_t> types, kinds, triangles;
    m4gn_mesh_data data{};

    Beam(int rank, int size, int beams = 1)
    {
        for (int plane = 0; plane < beams*(nx + 1); ++plane)
        {
            // In turns, so that a rank's points are no single stretch of the numbering.
            if (plane % size != rank)
            {
                continue;
            }
            const int i = plane % (nx + 1);
            for (int k = 0; k <= nz; ++k)
            {
                for (int j = 0; j <= ny; ++j)
                {
                    global.push_back(point(plane, j, k));
                    Point x = at(i, j, k);
                    x[2] -= plane > nx ? 0.0165 : 0;
                    positions.insert(positions.end(), x.begin(), x.end());
                    types.push_back(i == 0 ? M4GN_HANDLE : M4GN_BODY);
                    if (i < nx && j < ny && k < nz)
                    {
                        element(plane, j, k);
                    }
                }
            }
        }
        // Its lowest corner is above one of the beam's points.
        const Point centre{0.1*17/nx, 0.008, 0.016 + 0.001 + radius};
        for (int axis = 0; axis < 3; ++axis)
        {
            for (const double side : {radius, -radius})
            {
                Point corner = centre;
                corner[axis] += side;
                obstacle.insert(obstacle.end(), corner.begin(), corner.end());
            }
        }
        for (const int x : {0, 1})
        {
            for (const int y : {2, 3})
            {
                for (const int z : {4, 5})
                {
                    // Normals outward: an odd number of negative corners turns the triangle round.
                    const bool odd = ((x + y + z) % 2) != 0;
                    triangles.push_back(x);
                    triangles.push_back(odd ? z : y);
                    triangles.push_back(odd ? y : z);
                }
            }
        }
        data.n_directions = 3;
        data.directions[1] = 1;
        data.directions[2] = 2;
        data.n_cells = static_cast<int32_t>(global.size());
        data.cell_global = global.data();
        data.cell_centres = positions.data();
        data.cell_type = types.data();
        data.n_elements = static_cast<int32_t>(kinds.size());
        data.element_kind = kinds.data();
        data.element_points = elementPoints.data();
        data.element_material = material.data();
        data.n_obstacle = 6;
        data.obstacle_positions = obstacle.data();
        data.n_obstacle_triangles = 8;
        data.obstacle_triangles = triangles.data();
    }

    std::size_t n() const { return global.size(); }

private:
    static constexpr double radius = 0.012;

    static int64_t point(int i, int j, int k) { return j + (ny + 1)*(k + (nz + 1)*static_cast<int64_t>(i)); }

    static Point at(int i, int j, int k) { return {0.1*i/nx, 0.016*j/ny, 0.016*k/nz}; }

    void element(int i, int j, int k)
    {
        kinds.push_back(12);
        for (const int up : {0, 1})
        {
            elementPoints.push_back(point(i, j, k + up));
            elementPoints.push_back(point(i + 1, j, k + up));
            elementPoints.push_back(point(i + 1, j + 1, k + up));
            elementPoints.push_back(point(i, j + 1, k + up));
        }
        for (const double value : {1e6, 0.4, 1000.0})
        {
            material.push_back(value);
        }
    }
};

// How far the obstacle is down after so many steps: it touches in the third.
std::vector<double> motion(int step)
{
    std::vector<double> u(18, 0);
    for (std::size_t i = 2; i < u.size(); i += 3)
    {
        u[i] = -0.0004*step;
    }
    return u;
}

// The displacement after ten steps, and the smallest gap that was left: to the obstacle, and between two beams.
std::vector<double> run(m4gn::Session& session, std::size_t n, double& gap, double& between)
{
    std::vector<double> D(3*n + 1, 0);
    gap = between = HUGE_VAL;
    for (int step = 0; step < 10; ++step)
    {
        session.setObstacle(motion(step), motion(step + 1));
        session.step({m4gn_field{"D", 3, D.data(), nullptr}}, {m4gn_field_out{"D", 3, D.data()}});
        const auto report = session.projection();
        gap = std::min(gap, report.gap_after);
        between = std::min(between, report.parts_after);
        REQUIRE(report.gap_after >= report.gap_before - 1e-9);
    }
    D.pop_back();
    return D;
}

// The model learns a beam that bends otherwise than its own would, shown by the host; where it was, where it then goes in a step,
// what the adaptation said, and its errors before and after.
struct Learned
{
    std::vector<double> before, after;
    std::string note;
    double errorBefore = 0, errorAfter = 0;
};

// The value of an entry of a summary
double entry(const std::string& summary, const std::string& name)
{
    const auto at = summary.find('"' + name + "\": ");
    REQUIRE(at != std::string::npos);
    return std::atof(summary.c_str() + at + name.size() + 4);
}

Learned learn(int32_t comm, const Beam& beam)
{
    // The model's stride is 0.04 s, two of these steps.
    constexpr double step = 0.02;
    const auto bent = [&](int at)
    {
        std::vector<double> D(3*beam.n() + 1, 0);
        for (std::size_t p = 0; p < beam.n(); ++p)
        {
            D[3*p + 2] = 0.0001*at*std::pow(beam.positions[3*p]/0.1, 2);
        }
        return D;
    };
    // Away from the beam.
    const std::vector<double> still(18, 0);
    m4gn::Session session(comm, beam.data, m4gn::Model(comm, model));
    const auto ahead = [&]
    {
        auto D = bent(20);
        auto before = bent(18);
        before.pop_back();
        session.setObstacle(still, still);
        session.setBefore(before, still);
        session.step({m4gn_field{"D", 3, D.data(), nullptr}}, {m4gn_field_out{"D", 3, D.data()}});
        D.pop_back();
        return D;
    };
    Learned learned;
    learned.before = ahead();
    const auto at = [&](int index)
    {
        m4gn_ride_step now{};
        now.time = now.shown = step*index;
        now.delta_t = step;
        now.end_time = HUGE_VAL;
        now.index = index;
        now.correctors = now.most_correctors = -1;
        return now;
    };
    // Frames from the first step on, and a round before the jump that would begin at the last one.
    m4gn::Ride ride
    (
        session,
        beam.data,
        R"({"mode": "replace", "solver_steps": 1, "surrogate_steps": 2, "time_start": 0.78,
            "adapt": {"start": 0, "precision": "fp32", "steps": 40, "threads": 1}})",
        at(-1)
    );
    for (int index = 0; index < 40; ++index)
    {
        const auto D = bent(index);
        ride.solved(at(index));
        const auto answer = ride.decide({m4gn_field{"D", 3, D.data(), still.data()}});
        REQUIRE(answer.action == (index < 39 ? M4GN_RIDE_SOLVE : M4GN_RIDE_STRIDE));
    }
    learned.note = ride.text(M4GN_RIDE_LOG);
    const std::string summary = ride.text(M4GN_RIDE_SUMMARY);
    learned.errorBefore = entry(summary, "adapt_error_before");
    learned.errorAfter = entry(summary, "adapt_error_after");
    learned.after = ahead();
    return learned;
}

} // namespace

int main(int argc, char** argv)
{
    MPI_Init(&argc, &argv);
    int rank = 0, size = 1;
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    const int32_t comm = MPI_Comm_c2f(MPI_COMM_WORLD);

    const auto options = settings(R"("projection": {})");
    const m4gn::Model opened(comm, model);
    for (const int beams : {1, 2})
    {
        double gapSerial = 0, gap = 0, betweenSerial = 0, between = 0;
        Beam whole(0, 1, beams), part(rank, size, beams);
        m4gn::Session serial(M4GN_NO_MPI, whole.data, opened, options);
        m4gn::Session session(comm, part.data, opened, options);
        REQUIRE(serial.nSegments() == 24 && session.nSegments() == 24);
        const auto all = serial.segments(whole.n()), mine = session.segments(part.n());
        const auto expected = run(serial, whole.n(), gapSerial, betweenSerial);
        const auto found = run(session, part.n(), gap, between);
        std::vector<std::size_t> place(whole.n());
        for (std::size_t i = 0; i < whole.n(); ++i)
        {
            place[static_cast<std::size_t>(whole.global[i])] = i;
        }
        double largest = 0, difference = 0;
        for (const double u : expected)
        {
            largest = std::max(largest, std::abs(u));
        }
        for (std::size_t p = 0; p < part.n(); ++p)
        {
            const std::size_t w = place[static_cast<std::size_t>(part.global[p])];
            REQUIRE(mine[p] == all[w]);
            for (std::size_t i = 0; i < 3; ++i)
            {
                difference = std::max(difference, std::abs(found[3*p + i] - expected[3*w + i]));
                REQUIRE(part.types[p] == M4GN_BODY || found[3*p + i] == 0);
            }
        }
        std::printf("rank %d of %d: largest displacement %.3e m, difference from serial %.1e of it, gap %.4f mean edges",
            rank, size, largest, difference/largest, gap);
        std::printf(", between the beams %.4f\n", between);
        // The obstacle's corner is 3 mm deep where the beam had a point: the nearest face is 1 mm away in each direction.
        REQUIRE(largest > 1e-3 && largest < 0.05);
        REQUIRE(difference < 1e-5*largest);
        REQUIRE(gap > -0.02 && std::abs(gap - gapSerial) < 1e-4);
        if (beams == 1)
        {
            REQUIRE(between == HUGE_VAL);
            continue;
        }
        // They touch, and the lower one, which no obstacle reaches, was moved.
        REQUIRE(between > -0.02 && between < 0.05 && std::abs(between - betweenSerial) < 1e-4);
        double lower = 0;
        for (std::size_t i = 3*whole.n()/2; i < expected.size(); ++i)
        {
            lower = std::max(lower, std::abs(expected[i]));
        }
        REQUIRE(lower > 1e-4);
    }

    {
        const Beam whole(0, 1), part(rank, size);
        const auto expected = learn(M4GN_NO_MPI, whole);
        const auto found = learn(comm, part);
        if (rank == 0)
        {
            std::printf("%s\n", found.note.c_str());
        }
        REQUIRE(found.errorAfter < 0.7*found.errorBefore);
        REQUIRE(std::abs(found.errorAfter/expected.errorAfter - 1) < 1e-2);
        double moved = 0, difference = 0;
        for (std::size_t p = 0; p < part.n(); ++p)
        {
            const auto at = std::find(whole.global.begin(), whole.global.end(), part.global[p]) - whole.global.begin();
            for (std::size_t i = 0; i < 3; ++i)
            {
                const double after = found.after[3*p + i];
                moved = std::max(moved, std::abs(after - found.before[3*p + i]));
                difference = std::max(difference, std::abs(after - expected.after[3*static_cast<std::size_t>(at) + i]));
            }
        }
        std::printf("rank %d of %d: adapted, a step differs from serial by %.1e m of %.1e m\n", rank, size, difference, moved);
        MPI_Allreduce(MPI_IN_PLACE, &moved, 1, MPI_DOUBLE, MPI_MAX, MPI_COMM_WORLD);
        REQUIRE(difference < 1e-2*moved);
    }

    // What a host may get wrong.
    std::string message;
    Beam part(rank, size);
    m4gn::Session session(comm, part.data, opened, options);
    std::vector<double> D(3*part.n() + 1, 0);
    const auto step = [&]
    {
        session.step({m4gn_field{"D", 3, D.data(), nullptr}}, {m4gn_field_out{"D", 3, D.data()}});
    };
    REQUIRE(failure(message, step) > 0 && contains(message, "m4gn_session_set_obstacle"));
    auto shorter = motion(0);
    shorter.resize(15);
    REQUIRE(failure(message, [&] { session.setObstacle(shorter, shorter); }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "expected 6 points, found 5"));
    session.setObstacle(motion(0), motion(1));
    step();
    std::vector<double> before(3*part.n(), 0);
    REQUIRE(failure(message, [&] { session.setBefore(before, shorter); }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "one stride before: expected 6 points, found 5"));
    before.resize(before.size() + 3);
    REQUIRE(failure(message, [&] { session.setBefore(before, motion(0)); }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "displacement of the body one stride before"));
    before.resize(before.size() - 3);
    before[0] = rank == size - 1 ? std::nan("") : 0;
    REQUIRE(failure(message, [&] { session.setBefore(before, motion(0)); }) > 0);
    before[0] = 0;
    session.setBefore(before, motion(0));
    session.setObstacle(motion(1), motion(2));
    step();

    const auto refused = [&](m4gn_mesh_data data, const std::string& projection, const std::string& words)
    {
        const auto other = settings("\"projection\": " + projection);
        REQUIRE(failure(message, [&] { m4gn::Session(comm, data, opened, other); }) > 0);
        if (!contains(message, words))
        {
            std::fprintf(stderr, "expected '%s' in '%s'\n", words.c_str(), message.c_str());
            std::exit(1);
        }
    };
    auto data = part.data;
    data.n_faces = 1;
    refused(data, "null", "n_faces is 1: expected 0 for a body");
    data = part.data;
    data.cell_type = nullptr;
    refused(data, "null", "cell_type");
    refused(part.data, "{\"clearnce\": 1}", "projection.clearnce: unknown entry");
    refused(part.data, "{\"clearnce\": 1}", "is clearance meant?");
    refused(part.data, "{\"tolerance\": 7}", "tolerance 7");
    // Over the beam, within the reach of no tolerance.
    for (std::size_t i = 2; i < part.obstacle.size(); i += 3)
    {
        part.obstacle[i] -= 0.01;
    }
    refused(part.data, "{}", "overlaps the body at the start");

    MPI_Finalize();
    return 0;
}
