// What ranks are told through the C ABI, on any number of them: modes on paper, segments' way to ranks, and what is wrong on one rank.
// That parts give what the whole gives is tested in tests/mpi_core, mpi_fem and mpi_engine; that all ranks are told of whatever else is wrong
// on one of them, and go on, in tests/odds.

#include "mesh.hpp"

#include <algorithm>
#include <mpi.h>

namespace
{

const double pi = 3.14159265358979323846;
const std::string model = std::string(M4GN_TEST_DATA) + "/small.safetensors";

// This rank's rows of a matrix whose bands are constant: entries i - 1, i, i + 1
struct Bands
{
    std::vector<int64_t> row{0}, column;
    std::vector<double> value;
    m4gn_csr csr;

    Bands(int rank, int size, int points, const std::vector<double>& bands)
    {
        const int begin = points * rank / size, end = points * (rank + 1) / size;
        for (int i = begin; i < end; ++i) {
            // Descending, and the diagonal in two parts: any order will do, and parts add up.
            for (int j = i + 1; j >= i - 1; --j) {
                const int parts = j < 0 || j >= points ? 0 : i == j ? 2 : 1;
                for (int part = 0; part < parts; ++part) {
                    column.push_back(j);
                    value.push_back(bands[static_cast<std::size_t>(j - i + 1)] / parts);
                }
            }
            row.push_back(static_cast<int64_t>(column.size()));
        }
        csr.n_rows = static_cast<int32_t>(row.size()) - 1;
        csr.row = row.data();
        csr.column = column.data();
        csr.value = value.data();
    }
};

bool near(double a, double b, double relative = 1e-8) { return std::abs(a - b) <= relative * std::abs(b); }

// A finite-element bar: K = (-1, 2, -1)/h, M = h (1, 4, 1)/6; both sides of the switch to sparse solvers.
void bar(int rank, int size, int32_t comm, int n)
{
    const double h = 1.0 / (n + 1);
    const Bands k(rank, size, n, {-1 / h, 2 / h, -1 / h}), m(rank, size, n, {h / 6, 4 * h / 6, h / 6});
    const m4gn::Modes modes(comm, k.csr, &m.csr);
    REQUIRE(modes.size() == 6);
    const auto values = modes.eigenvalues();
    for (int i = 0; i < 6; ++i) {
        const double c = std::cos((i + 1) * pi * h);
        REQUIRE(near(values[static_cast<std::size_t>(i)], 6 / (h * h) * (1 - c) / (2 + c)));
    }
    // The first mode is a sine of one sign, its mean square over the bar 1.
    double sum = 0;
    const auto first = modes.vector(0);
    const int begin = n * rank / size;
    for (std::size_t i = 0; i < first.size(); ++i) {
        REQUIRE(first[i] * first[0] > 0);
        const double sine = std::sin((begin + double(i) + 1) * pi * h);
        sum += std::abs(first[i]) / sine;
        REQUIRE(near(std::abs(first[i]) / sine, std::abs(first[0]) / std::sin((begin + 1) * pi * h), 1e-6));
    }
    MPI_Allreduce(
        MPI_IN_PLACE, &sum, 1, MPI_DOUBLE, MPI_SUM, comm == M4GN_NO_MPI ? MPI_COMM_SELF : MPI_COMM_WORLD);
    REQUIRE(near(sum / n, std::sqrt(2.0), 2e-2));
}

// What is wrong is said, on the rank where it is wrong; the others hear of it; and the next call works.
void wrongMatrices(int rank, int size, int32_t comm)
{
    const int n = 150;
    std::string message;
    const int culprit = size - 1;
    const bool mine = rank == culprit;
    const std::string none = "{}";
    const auto expect = [&](const Bands& k, const std::string& o, bool all, const char* word) {
        const int32_t status = failure(message, [&] { m4gn::Modes(comm, k.csr, nullptr, o); });
        REQUIRE(status == (all || mine ? M4GN_ERROR_INPUT : M4GN_ERROR_OTHER_RANK));
        REQUIRE(contains(message, word));
    };

    Bands k(rank, size, n, {-1, 2, -1});
    if (mine) {
        k.value[3] = NAN;
    }
    expect(k, none, false, "finite");
    if (mine) {
        k.value[3] = 1;
        k.row[1] = -1;
    }
    expect(k, none, false, "row");

    const Bands good(rank, size, n, {-1, 2, -1});
    expect(good, R"({"modes": 150})", true, "at most 149");
    expect(good, R"({"modal_solver": "fast"})", true, "modal_solver: expected one of auto, direct");
    expect(good, R"({"block": 0})", true, "points");
    expect(good, R"({"blok": 2})", true, "is block meant?");
    expect(
        good, mine && size > 1 ? R"({"modes": 5})" : R"({"modes": 150})", true,
        size > 1 ? "differ" : "at most");

    REQUIRE(m4gn::Modes(comm, good.csr, nullptr, none).size() == 6);

    double value = 0;
    REQUIRE(m4gn_modes_n_modes(nullptr) == -1);
    REQUIRE(m4gn_modes_vector(nullptr, 0, &value) == M4GN_ERROR_INPUT);
    m4gn_modes_free(nullptr);
}

std::string options(const std::string& segments, bool withModes)
{
    return "{\"segments\": " + segments + ", \"with_modes\": " + (withModes ? "true}" : "false}");
}

void toRanks(int32_t comm, const Channel& part)
{
    const m4gn::Segments found(comm, part.data, options("{\"count\": 12, \"modes\": 4}", false));
    std::vector<double> sizes, adjacency;
    found.graph(sizes, adjacency);
    double nodes = 0;
    for (double s : sizes) {
        nodes += s;
    }
    // 24 x 8 cells and 64 faces around them
    REQUIRE(nodes == 24 * 8 + 64);

    m4gn_rank_report report;
    const auto rank = m4gn::Segments::ranks(sizes, adjacency, 3, {}, &report);
    for (int r = 0; r < 3; ++r) {
        REQUIRE(std::count(rank.begin(), rank.end(), r) > 0);
    }
    REQUIRE(report.imbalance >= 1 && report.imbalance < 1.4 && report.cut > 0);

    std::string message;
    REQUIRE(failure(message, [&] { m4gn::Segments::ranks(sizes, adjacency, 13); }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "raise segments"));
    REQUIRE(
        failure(
            message,
            [&] {
                m4gn::Segments::ranks(sizes, adjacency, 3, {1.0, 1.0});
            })
        == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "a weight of each rank"));
}

void wrongSegments(int rank, int size, int32_t comm, const Channel& part)
{
    std::string message;
    for (const char* spec : {"{\"cuont\": 3}", "[]", "{\"count\": \"x\"}", "{\"count\": 100000}", "{"}) {
        REQUIRE(
            failure(message, [&] { m4gn::Segments(comm, part.data, options(spec, false)); })
            == M4GN_ERROR_INPUT);
    }
    // One rank alone asks for something else: all are told what differs.
    const int32_t status = failure(message, [&] {
        m4gn::Segments(comm, part.data, options(rank == size - 1 ? "{\"cuont\": 3}" : "{}", false));
    });
    REQUIRE(status == (rank == size - 1 ? M4GN_ERROR_INPUT : M4GN_ERROR_OTHER_RANK));
    REQUIRE(contains(message, "segments.cuont: unknown entry") && contains(message, "is count meant?"));
    const int32_t differing = failure(message, [&] {
        m4gn::Segments(
            comm, part.data, options(rank == size - 1 ? "{\"count\": 3}" : "{\"count\": 4}", false));
    });
    REQUIRE(differing == (size > 1 ? M4GN_ERROR_INPUT : M4GN_OK));
    REQUIRE(size == 1 || (contains(message, "segments.count 3") && contains(message, "segments.count 4")));
    REQUIRE(m4gn_segments_n_segments(nullptr) == -1);
    m4gn_segments_free(nullptr);
}

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
    for (int n : {40, 250}) {
        bar(rank, size, comm, n);
        // A rank by itself, without MPI.
        bar(0, 1, M4GN_NO_MPI, n);
    }
    wrongMatrices(rank, size, comm);
    {
        const Channel part(24, 8, rank, size);
        toRanks(comm, part);
        wrongSegments(rank, size, comm, part);
    }
    wrongFields(rank, size, comm);
    // A guest leaves MPI as it found it.
    int finalised = 0;
    MPI_Finalized(&finalised);
    REQUIRE(!finalised);
    MPI_Finalize();
    return 0;
}
