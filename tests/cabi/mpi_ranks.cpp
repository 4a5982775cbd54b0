// A host that has started MPI itself, on any number of ranks: what is wrong on one of them, and MPI as it was. That parts give what the whole
// gives is tested in tests/mpi_core, mpi_fem and mpi_engine; that all ranks are told of whatever else is wrong on one of them, and go on, in
// tests/odds.

#include "mesh.hpp"

#include <mpi.h>

namespace
{

const std::string model = std::string(M4GN_TEST_DATA) + "/small.safetensors";

// One rank has bad input: every rank gets an error of its own class, and the session lives on.
void wrongFields(int rank, int size, int32_t comm)
{
    Channel part(9, 5, rank, size);
    Fields fields(part);
    const auto before = fields;
    std::string message;
    m4gn::Session session(comm, part.data, m4gn::Model(comm, model));
    const int culprit = size - 1;

    const auto step = [&] { session.step(fields.cells(), fields.boundary(), fields.next()); };
    fields.p[0] = rank == culprit ? NAN : fields.p[0];
    int32_t status = failure(message, step);
    REQUIRE(status == (rank == culprit ? M4GN_ERROR_NUMERICAL : M4GN_ERROR_OTHER_RANK));
    REQUIRE(fields.U == before.U);
    fields.p = before.p;
    step();

    // The root alone reads the model.
    status = failure(message, [&] { m4gn::Model(comm, "/no/such/model"); });
    REQUIRE(status == (rank == 0 ? M4GN_ERROR_FILE : M4GN_ERROR_OTHER_RANK));
    REQUIRE(contains(message, "/no/such/model"));
}

} // namespace

int main(int argc, char** argv)
{
    MPI_Init(&argc, &argv);
    int rank = 0, size = 1;
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    const int32_t comm = MPI_Comm_c2f(MPI_COMM_WORLD);
    wrongFields(rank, size, comm);
    // A guest leaves MPI as it found it.
    int finalised = 0;
    MPI_Finalized(&finalised);
    REQUIRE(!finalised);
    MPI_Finalize();
    return 0;
}
