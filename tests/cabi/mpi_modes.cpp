// Modes of a program's own matrices through the C ABI, on any number of ranks, against eigenvalues on paper.

#include "mesh.hpp"

#include <algorithm>
#include <mpi.h>

namespace
{

const double pi = 3.14159265358979323846;

// This rank's rows of a matrix whose bands are constant: entries of block i - 1, i, i + 1, times `weight` of the
// unknown.
struct Bands
{
    std::vector<int64_t> row{0}, column;
    std::vector<double> value;
    m4gn_csr csr;

    Bands
    (
        int rank,
        int size,
        int points,
        std::vector<double> bands,
        std::vector<double> weight = {1}
    )
    {
        const int block = static_cast<int>(weight.size());
        const int begin = points*rank/size, end = points*(rank + 1)/size;
        for (int i = begin; i < end; ++i)
        {
            for (int c = 0; c < block; ++c)
            {
                // Descending, and the diagonal in two parts: any order will do, and parts add up.
                for (int j = i + 1; j >= i - 1; --j)
                {
                    const double entry = bands[static_cast<std::size_t>(j - i + 1)]*weight[static_cast<std::size_t>(c)];
                    if (j < 0 || j >= points || entry == 0)
                    {
                        continue;
                    }
                    const int parts = i == j ? 2 : 1;
                    for (int part = 0; part < parts; ++part)
                    {
                        column.push_back(int64_t(j)*block + c);
                        value.push_back(entry/parts);
                    }
                }
                row.push_back(static_cast<int64_t>(column.size()));
            }
        }
        csr.n_rows = static_cast<int32_t>(row.size()) - 1;
        csr.row = row.data();
        csr.column = column.data();
        csr.value = value.data();
    }
};

bool near(double a, double b, double relative = 1e-8)
{
    return std::abs(a - b) <= relative*std::abs(b);
}

// A finite-element bar: K = (-1, 2, -1)/h, M = h (1, 4, 1)/6; both sides of the switch to sparse solvers.
void bar(int rank, int size, int32_t comm, int n)
{
    const double h = 1.0/(n + 1);
    const Bands k(rank, size, n, {-1/h, 2/h, -1/h}), m(rank, size, n, {h/6, 4*h/6, h/6});
    const m4gn::Modes modes(comm, k.csr, &m.csr);
    REQUIRE(modes.size() == 6);
    const auto values = modes.eigenvalues();
    for (int i = 0; i < 6; ++i)
    {
        const double c = std::cos((i + 1)*pi*h);
        REQUIRE(near(values[static_cast<std::size_t>(i)], 6/(h*h)*(1 - c)/(2 + c)));
    }
    // The first mode is a sine of one sign, its mean square over the bar 1.
    double sum = 0;
    const auto first = modes.vector(0);
    const int begin = n*rank/size;
    for (std::size_t i = 0; i < first.size(); ++i)
    {
        REQUIRE(first[i]*first[0] > 0);
        const double sine = std::sin((begin + double(i) + 1)*pi*h);
        sum += std::abs(first[i])/sine;
        REQUIRE(near(std::abs(first[i])/sine, std::abs(first[0])/std::sin((begin + 1)*pi*h), 1e-6));
    }
    MPI_Allreduce(MPI_IN_PLACE, &sum, 1, MPI_DOUBLE, MPI_SUM, comm == M4GN_NO_MPI ? MPI_COMM_SELF : MPI_COMM_WORLD);
    REQUIRE(near(sum/n, std::sqrt(2.0), 2e-2));
}

// Not symmetric: (-1 - c, 2, -1 + c) has the eigenvalues 2 - 2 sqrt(1 - c^2) cos(k pi/(n + 1)).
void convection(int rank, int size, int32_t comm, int n)
{
    const double c = 0.01;
    const Bands k(rank, size, n, {-1 - c, 2, -1 + c});
    const auto values =
        m4gn::Modes(comm, k.csr, nullptr, R"({"symmetric": false, "modes": 4})").eigenvalues();
    REQUIRE(values.size() == 4);
    for (int i = 0; i < 4; ++i)
    {
        const double exact = 2 - 2*std::sqrt(1 - c*c)*std::cos((i + 1)*pi/(n + 1));
        REQUIRE(near(values[static_cast<std::size_t>(i)], exact, 1e-7));
    }
}

// Two unknowns a point, one ten times as stiff; by factorisation and by multigrid, with options of PETSc.
void block(int rank, int size, int32_t comm)
{
    const int n = 200;
    const Bands k(rank, size, n, {-1, 2, -1}, {1, 10});
    const double root[] = {1, 2, 3, std::sqrt(10.0), 4};
    for (const char* solver : {"direct", "iterative"})
    {
        const auto options =
            R"({"block": 2, "modes": 5, "petsc_options": "-m4gn_eps_ncv 30", "modal_solver": )" + m4gn::quoted(solver) + "}";
        const auto values = m4gn::Modes(comm, k.csr, nullptr, options).eigenvalues();
        REQUIRE(values.size() == 5);
        for (std::size_t i = 0; i < 5; ++i)
        {
            const double weight = i == 3 ? 10 : 1, wave = i == 3 ? 1 : root[i];
            REQUIRE(near(values[i], weight*(2 - 2*std::cos(wave*pi/(n + 1)))));
        }
    }
    // sum of 1/lambda of (1, 2, 3, sqrt 10, 4)^2 is near 1.52: the first mode holds 0.66, two 0.82.
    REQUIRE(m4gn::Modes(comm, k.csr, nullptr, R"({"block": 2, "modes": 5, "energy": 0.8})").size() == 2);
}

// What is wrong is said, on the rank where it is wrong; the others hear of it; and the next call works.
void refusals(int rank, int size, int32_t comm)
{
    const int n = 150;
    std::string message;
    const int culprit = size - 1;
    const bool mine = rank == culprit;
    const std::string options = "{}";
    const auto expect = [&](const Bands& k, const std::string& o, bool all, const char* word)
    {
        const int32_t status = failure(message, [&] { m4gn::Modes(comm, k.csr, nullptr, o); });
        REQUIRE(status == (all || mine ? M4GN_ERROR_INPUT : M4GN_ERROR_OTHER_RANK));
        REQUIRE(contains(message, word));
    };

    Bands k(rank, size, n, {-1, 2, -1});
    if (mine) { k.value[3] = NAN; }
    expect(k, options, false, "finite");
    if (mine) { k.value[3] = 1; k.column[1] = n; }
    expect(k, options, false, "column");
    if (mine) { k.column[1] = 1; k.csr.value = nullptr; }
    expect(k, options, false, "null");
    if (mine) { k.csr.value = k.value.data(); k.row[1] = -1; }
    expect(k, options, false, "row");
    if (mine) { k.row[1] = k.row[2] + 1; }
    expect(k, options, false, "row");

    const Bands good(rank, size, n, {-1, 2, -1});
    expect(good, R"({"modes": 150})", true, "at most 149");
    expect(good, R"({"modal_solver": "fast"})", true, "modal_solver: expected one of auto, direct");
    expect(good, R"({"petsc_options": "-eps_tol 1"})", true, "-m4gn_");
    expect(good, R"({"petsc_options": "-m4gn_no_such_option 1"})", true, "not used");
    expect(good, R"({"energy": 2})", true, "share");
    expect(good, R"({"block": 0})", true, "points");
    expect(good, R"({"simetric": true})", true, "is symmetric meant?");
    expect(good, mine && size > 1 ? R"({"modes": 5})" : R"({"modes": 150})", true, size > 1 ? "differ" : "at most");

    const std::string wrong = R"({"petsc_options": "-m4gn_eps_type no_such_type"})";
    REQUIRE(failure(message, [&] { m4gn::Modes(comm, good.csr, nullptr, wrong); }) > 0);
    REQUIRE(contains(message, "no_such_type"));
    REQUIRE(m4gn::Modes(comm, good.csr, nullptr, options).size() == 6);

    double value = 0;
    REQUIRE(m4gn_modes_count(nullptr) == -1);
    REQUIRE(m4gn_modes_vector(nullptr, 0, &value) == M4GN_ERROR_INPUT);
    m4gn_modes_free(nullptr);
}

} // namespace

int main(int argc, char** argv)
{
    MPI_Init(&argc, &argv);
    int rank = 0, size = 1;
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    const int32_t comm = MPI_Comm_c2f(MPI_COMM_WORLD);

    for (int n : {40, 250})
    {
        bar(rank, size, comm, n);
        convection(rank, size, comm, n);
        // A rank by itself, without MPI.
        bar(0, 1, M4GN_NO_MPI, n);
    }
    block(rank, size, comm);
    refusals(rank, size, comm);
    MPI_Barrier(MPI_COMM_WORLD);
    MPI_Finalize();
    return 0;
}
