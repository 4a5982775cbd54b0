// Segments without a model on any number of ranks: the same as in serial, and their way to ranks.

#include "mesh.hpp"

#include <algorithm>
#include <mpi.h>

namespace
{

std::string options(const std::string& segments, bool withModes)
{
    return "{\"segments\": " + segments + ", \"with_modes\": " + (withModes ? "true}" : "false}");
}

void sameAsSerial(int rank, int size, int32_t comm)
{
    const int nx = 24, ny = 8;
    Channel whole(nx, ny);
    Channel part(nx, ny, rank, size);

    for (const char* spec : {"{\"count\": 6, \"modes\": 4}", "{\"count\": 7, \"method\": \"metis\", \"modes\": 4}"})
    {
        const m4gn::Segments serial(M4GN_NO_MPI, whole.data, options(spec, true));
        const m4gn::Segments found(comm, part.data, options(spec, true));
        REQUIRE(found.count() == serial.count());

        const auto expected = serial.cells(whole.nCells());
        const auto mine = found.cells(part.nCells());
        for (int c = 0; c < part.nCells(); ++c)
        {
            REQUIRE(mine[c] == expected[static_cast<std::size_t>(part.cellGlobal[c])]);
        }

        REQUIRE(found.nModes() == serial.nModes() && serial.nModes() >= 4);
        for (int i = 0; i < serial.nModes(); ++i)
        {
            std::vector<double> a, b;
            const double exact = serial.mode(i, whole.nCells(), a);
            const double value = found.mode(i, part.nCells(), b);
            REQUIRE(std::abs(value - exact) <= 1e-8*exact);
            for (int c = 0; c < part.nCells(); ++c)
            {
                REQUIRE(std::abs(b[c] - a[static_cast<std::size_t>(part.cellGlobal[c])]) < 1e-5);
            }
        }

        // Segments handed in come out again, and nothing is solved for
        const m4gn::Segments again(comm, part.data, options(spec, false), mine.data());
        REQUIRE(again.cells(part.nCells()) == mine && again.nModes() == 0);
    }
}

void toRanks(int32_t comm, const Channel& part)
{
    const m4gn::Segments found(comm, part.data, options("{\"count\": 12, \"modes\": 4}", false));
    std::vector<double> sizes, adjacency;
    found.graph(sizes, adjacency);
    double nodes = 0;
    for (double s : sizes)
    {
        nodes += s;
    }
    // 24 x 8 cells and 64 faces around them
    REQUIRE(nodes == 24*8 + 64);

    m4gn_rank_report report;
    const auto rank = m4gn::Segments::ranks(sizes, adjacency, 3, {}, {}, &report);
    for (int r = 0; r < 3; ++r)
    {
        REQUIRE(std::count(rank.begin(), rank.end(), r) > 0);
    }
    REQUIRE(report.imbalance >= 1 && report.imbalance < 1.4 && report.cut > 0);

    std::vector<int32_t> fixed(12, -1);
    fixed[3] = 2;
    REQUIRE(m4gn::Segments::ranks(sizes, adjacency, 3, {2, 1, 1}, fixed)[3] == 2);

    std::string message;
    REQUIRE(failure(message, [&] { m4gn::Segments::ranks(sizes, adjacency, 13); }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "raise segments"));
}

void badInput(int rank, int size, int32_t comm, const Channel& part)
{
    std::string message;
    for (const char* spec : {"{\"cuont\": 3}", "[]", "{\"count\": \"x\"}", "{\"count\": 100000}", "{"})
    {
        REQUIRE(failure(message, [&] { m4gn::Segments(comm, part.data, options(spec, false)); }) == M4GN_ERROR_INPUT);
    }
    // One rank alone asks for something else: all are told what differs.
    const int32_t status = failure(message, [&] {
        m4gn::Segments(comm, part.data, options(rank == size - 1 ? "{\"cuont\": 3}" : "{}", false));
    });
    REQUIRE(status == (rank == size - 1 ? M4GN_ERROR_INPUT : M4GN_ERROR_OTHER_RANK));
    REQUIRE(contains(message, "segments.cuont: unknown entry") && contains(message, "is count meant?"));
    const int32_t differing = failure(message, [&] {
        m4gn::Segments(comm, part.data, options(rank == size - 1 ? "{\"count\": 3}" : "{\"count\": 4}", false));
    });
    REQUIRE(differing == (size > 1 ? M4GN_ERROR_INPUT : M4GN_OK));
    REQUIRE(size == 1 || (contains(message, "segments.count 3") && contains(message, "segments.count 4")));
    REQUIRE(m4gn_segments_count(nullptr) == -1);
    m4gn_segments_free(nullptr);
}

} // namespace

int main(int argc, char** argv)
{
    MPI_Init(&argc, &argv);
    int rank, size;
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    const int32_t comm = static_cast<int32_t>(MPI_Comm_c2f(MPI_COMM_WORLD));
    {
        const Channel part(24, 8, rank, size);
        sameAsSerial(rank, size, comm);
        toRanks(comm, part);
        badInput(rank, size, comm, part);
    }
    MPI_Finalize();
    return 0;
}
