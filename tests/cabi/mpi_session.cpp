// The surrogate on any number of ranks: the same step as in serial, and errors that all ranks agree on.

#include "mesh.hpp"

#include <algorithm>
#include <mpi.h>

namespace
{

const std::string model = std::string(M4GN_TEST_DATA) + "/small.safetensors";

// Largest difference of the ranks' result from rank 0's own serial run, relative to the largest value.
double differenceFromSerial(int rank, int size, int32_t comm)
{
    const int nx = 9, ny = 5;

    Channel whole(nx, ny);
    Fields expected(whole);
    m4gn::Session serial(M4GN_NO_MPI, whole.data, m4gn::Model(M4GN_NO_MPI, model));
    serial.step(expected.in(), expected.out());
    const auto segments = serial.segments(whole.nCells());

    Channel part(nx, ny, rank, size);
    Fields found(part);
    m4gn::Session session(comm, part.data, m4gn::Model(comm, model));
    REQUIRE(session.nSegments() == serial.nSegments());
    session.step(found.in(), found.out());
    const auto mine = session.segments(part.nCells());

    double largest = 0, difference = 0;
    for (double u : expected.U)
    {
        largest = std::max(largest, std::abs(u));
    }
    for (int c = 0; c < part.nCells(); ++c)
    {
        const auto g = static_cast<std::size_t>(part.cellGlobal[c]);
        REQUIRE(mine[c] == segments[g]);
        for (int i = 0; i < 3; ++i)
        {
            difference = std::max(difference, std::abs(found.U[3*c + i] - expected.U[3*g + i]));
        }
        difference = std::max(difference, std::abs(found.p[c] - expected.p[g]));
    }
    return difference/largest;
}

// One rank has bad input: every rank gets an error of its own class, and the session lives on.
void ranksAgree(int rank, int size, int32_t comm)
{
    Channel part(9, 5, rank, size);
    Fields fields(part);
    const auto before = fields;
    std::string message;
    m4gn::Session session(comm, part.data, m4gn::Model(comm, model));
    const int culprit = size - 1;

    auto in = fields.in();
    if (rank == culprit)
    {
        in[0].cells = nullptr;
    }
    int32_t status = failure(message, [&] { session.step(in, fields.out()); });
    REQUIRE(status == (rank == culprit ? M4GN_ERROR_INPUT : M4GN_ERROR_OTHER_RANK));
    REQUIRE(contains(message, "U"));

    fields.p[0] = rank == culprit ? NAN : fields.p[0];
    status = failure(message, [&] { session.step(fields.in(), fields.out()); });
    REQUIRE(status == (rank == culprit ? M4GN_ERROR_NUMERICAL : M4GN_ERROR_OTHER_RANK));
    REQUIRE(fields.U == before.U);
    fields = before;
    session.step(fields.in(), fields.out());

    // The root alone reads the model.
    status = failure(message, [&] { m4gn::Model(comm, "/no/such/model"); });
    REQUIRE(status == (rank == 0 ? M4GN_ERROR_FILE : M4GN_ERROR_OTHER_RANK));
    REQUIRE(contains(message, "/no/such/model"));

    if (rank == culprit)
    {
        part.boundaryType[0] = 99;
    }
    status = failure(message, [&] { m4gn::Session(comm, part.data, m4gn::Model(comm, model)); });
    REQUIRE(status == (rank == culprit ? M4GN_ERROR_MESH : M4GN_ERROR_OTHER_RANK));
}

} // namespace

int main(int argc, char** argv)
{
    MPI_Init(&argc, &argv);
    int rank = 0, size = 1;
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    const int32_t comm = MPI_Comm_c2f(MPI_COMM_WORLD);

    const double difference = differenceFromSerial(rank, size, comm);
    REQUIRE(difference < 1e-5);
    ranksAgree(rank, size, comm);

    // A guest leaves MPI as it found it.
    int finalised = 0;
    MPI_Finalized(&finalised);
    REQUIRE(!finalised);
    MPI_Barrier(MPI_COMM_WORLD);
    std::printf("rank %d of %d: difference from serial %.1e\n", rank, size, difference);
    MPI_Finalize();
    return 0;
}
