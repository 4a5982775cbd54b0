// The surrogate through the C ABI: a step, every kind of refusal, and the host's floating-point traps.

#include "mesh.hpp"

#include <cfenv>
#include <cstring>
#include <fstream>
#include <iterator>

namespace
{

const std::string model = std::string(M4GN_TEST_DATA) + "/small.safetensors";

void steps()
{
    Channel mesh(6, 4);
    m4gn::Session session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model));

    REQUIRE(session.stride() == 0.01);
    REQUIRE(session.nSegments() == 4);
    const auto fields = session.fields();
    REQUIRE(fields.size() == 2);
    REQUIRE(!std::strcmp(fields[0].name, "U") && fields[0].components == 3 && fields[0].dimensions[1] == 1);
    REQUIRE(!std::strcmp(fields[1].name, "p") && fields[1].components == 1 && fields[1].dimensions[2] == -2);
    REQUIRE(fields[0].is_input && fields[0].is_output);
    m4gn_field_info info;
    REQUIRE(m4gn_session_field(session.get(), 2, &info) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_session_field(session.get(), -1, &info) == M4GN_ERROR_INPUT);

    const auto segments = session.segments(mesh.nCells());
    std::vector<int> sizes(4);
    for (int32_t s : segments) {
        REQUIRE(s >= 0 && s < 4);
        ++sizes[s];
    }
    for (int size : sizes) {
        REQUIRE(size > 0);
    }

    Fields fields1(mesh);
    const Fields before(mesh);
    session.step(fields1.cells(), fields1.boundary(), fields1.next());
    double change = 0;
    for (int c = 0; c < mesh.nCells(); ++c) {
        REQUIRE(std::isfinite(fields1.U[3 * c]) && std::isfinite(fields1.p[c]));
        REQUIRE(fields1.U[3 * c + 2] == 5);
        change += std::abs(fields1.U[3 * c] - before.U[3 * c]);
    }
    REQUIRE(change > 1e-3);

    // Separate arrays, and segments handed in, give the same.
    m4gn::Session again(
        M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model), settings(R"("n_threads": 2)"),
        segments.data());
    Fields fields2(mesh);
    again.step(before.cells(), before.boundary(), fields2.next());
    REQUIRE(fields2.U == fields1.U && fields2.p == fields1.p);
}

// A run is of the model that it began with: the file is another one, and then gone, while sessions are made.
void readsTheModelOnce()
{
    Channel mesh(6, 4);
    const std::string path = "replaced.safetensors";
    std::ofstream(path, std::ios::binary) << std::ifstream(model, std::ios::binary).rdbuf();
    const m4gn::Model opened(M4GN_NO_MPI, path);
    const auto step = [&] {
        m4gn::Session session(M4GN_NO_MPI, mesh.data, opened);
        Fields fields(mesh);
        session.step(fields.cells(), fields.boundary(), fields.next());
        return fields.U;
    };
    const auto before = step();
    std::ofstream(path, std::ios::binary) << "another file";
    REQUIRE(step() == before);
    m4gn::Session session(M4GN_NO_MPI, mesh.data, opened);
    std::remove(path.c_str());
    REQUIRE(step() == before);
    REQUIRE(opened.elasticModes() == 0);
}

void refusesModels()
{
    std::string message;
    const auto open = [&](const std::string& path) {
        return failure(message, [&] { m4gn::Model(M4GN_NO_MPI, path); });
    };
    REQUIRE(open("/no/such/model.safetensors") == M4GN_ERROR_FILE);
    REQUIRE(contains(message, "/no/such/model.safetensors") && contains(message, "No such file"));

    std::ifstream file(model, std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
    const std::string damaged = "damaged-" + std::to_string(bytes.size()) + ".safetensors";
    for (const std::string& content : {bytes.substr(0, bytes.size() - 7), bytes.substr(0, 20), std::string()})
    {
        std::ofstream(damaged, std::ios::binary) << content;
        REQUIRE(open(damaged) == M4GN_ERROR_FILE);
        REQUIRE(contains(message, damaged) && contains(message, "truncated"));
    }
    std::remove(damaged.c_str());

    REQUIRE(open("") == M4GN_ERROR_FILE);
    REQUIRE(open("/") == M4GN_ERROR_FILE);
    REQUIRE(contains(message, "a folder"));
    Channel mesh(6, 4);
    m4gn_session* session = nullptr;
    REQUIRE(m4gn_session_new(M4GN_NO_MPI, &mesh.data, nullptr, "{}", nullptr, &session) == M4GN_ERROR_INPUT);
    REQUIRE(!session && contains(m4gn_last_error(), "model"));
}

void refusesOptions()
{
    Channel mesh(6, 4);
    std::string message;
    const auto with = [&](const std::string& more) {
        return failure(message, [&] {
            m4gn::Session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model), settings(more));
        });
    };
    const auto segments = [&](const std::string& entries) { return with("\"segments\": {" + entries + "}"); };
    REQUIRE(segments(R"("count": 25)") == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "25") && contains(message, "24"));
    REQUIRE(segments(R"("count": -1)") == M4GN_ERROR_INPUT);
    REQUIRE(
        contains(message, "segments.count: expected a whole number that is not negative, found integer -1"));
    REQUIRE(with(R"("nThreads": -1)") == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "nThreads: expected"));
    REQUIRE(with(R"("precision": "fp16")") == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "precision: expected one of model, auto, fp32, bf16, found fp16"));
    REQUIRE(segments(R"("tau": -0.5)") == M4GN_ERROR_INPUT);
    REQUIRE(with(R"("backend": "abacus")") == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "abacus"));
    REQUIRE(segments(R"("method": "scissors")") == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "scissors"));
    REQUIRE(contains(message, "slic-mdode"));
    REQUIRE(segments(R"("connected": 2)") == M4GN_ERROR_INPUT);
    REQUIRE(segments(R"("distance_scale": -1)") == M4GN_ERROR_INPUT);
    REQUIRE(segments(R"("distanceScale": -1)") == M4GN_ERROR_INPUT);
    REQUIRE(segments(R"("modal_solver": "abacus")") == M4GN_ERROR_INPUT);
    REQUIRE(segments(R"("method": "slic-mdodl", "obstacles": ["ball", "stick"])") == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "ball, stick: expected some of the patches"));
    REQUIRE(with(R"("model": "another")") == M4GN_ERROR_INPUT);
    REQUIRE(with("nothing") == M4GN_ERROR_INPUT);
    const std::vector<int32_t> labels(24, 9);
    const auto given = [&] {
        m4gn::Session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model), "{}", labels.data());
    };
    REQUIRE(failure(message, given) == M4GN_ERROR_INPUT);

    // The same without a session.
    m4gn::checkOptions("session", settings(R"("segments": {"count": 9})"));
    REQUIRE(
        failure(message, [&] { m4gn::checkOptions("session", R"({"bakcend": "a"})"); }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "bakcend: unknown entry") && contains(message, "is backend meant?"));
}

void refusesMeshes()
{
    std::string message;
    const auto with = [&](void (*change)(Channel&)) {
        Channel mesh(6, 4);
        change(mesh);
        return failure(
            message, [&] { m4gn::Session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model)); });
    };
    REQUIRE(with([](Channel& m) { m.data.n_cells = -1; }) == M4GN_ERROR_INPUT);
    REQUIRE(with([](Channel& m) { m.data.cell_centres = nullptr; }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "cell_centres"));
    REQUIRE(with([](Channel& m) { m.data.n_directions = 1; }) == M4GN_ERROR_INPUT);
    REQUIRE(
        with([](Channel& m) {
            m.data.n_directions = 3;
            m.data.directions[2] = 2;
        })
        == M4GN_ERROR_MODEL);
    REQUIRE(contains(message, "2 dimensions"));
    REQUIRE(with([](Channel& m) { m.faceOwner[3] = 24; }) == M4GN_ERROR_MESH);
    REQUIRE(contains(message, "face_owner[3]"));
    REQUIRE(with([](Channel& m) { m.boundaryOwner[0] = -1; }) == M4GN_ERROR_MESH);
    REQUIRE(with([](Channel& m) { m.boundaryType[2] = 17; }) == M4GN_ERROR_MESH);
    REQUIRE(contains(message, "boundary_type[2]"));
    REQUIRE(with([](Channel& m) { m.boundaryType[0] = M4GN_SYMMETRY; }) == M4GN_ERROR_MODEL);
    REQUIRE(contains(message, "patch 'inlet' is symmetry"));
    REQUIRE(with([](Channel& m) { m.boundaryPatch[1] = 3; }) == M4GN_ERROR_MESH);
    REQUIRE(with([](Channel& m) { m.cellGlobal[1] = 0; }) == M4GN_ERROR_MESH);
    REQUIRE(with([](Channel& m) { m.cellVolumes[0] = 0; }) == M4GN_ERROR_MESH);
    REQUIRE(with([](Channel& m) { m.cellCentres[4] = INFINITY; }) == M4GN_ERROR_MESH);
    REQUIRE(with([](Channel& m) { m.patches[1] = nullptr; }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "patch_names[1]"));
    // A communicator where there is no MPI.
    Channel mesh(6, 4);
    REQUIRE(
        failure(message, [&] { m4gn::Session(0, mesh.data, m4gn::Model(M4GN_NO_MPI, model)); })
        == M4GN_ERROR_INPUT);
}

void refusesFields()
{
    Channel mesh(6, 4);
    m4gn::Session session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model));
    std::string message;
    using List = std::vector<const double*>;
    const auto with = [&](void (*change)(List&, List&, std::vector<double*>&)) {
        Fields fields(mesh);
        const auto before = fields;
        auto cells = fields.cells(), boundary = fields.boundary();
        auto next = fields.next();
        change(cells, boundary, next);
        const int32_t status = failure(message, [&] { session.step(cells, boundary, next); });
        REQUIRE(fields.U == before.U && fields.p == before.p);
        return status;
    };
    using Next = std::vector<double*>;
    REQUIRE(with([](List& cells, List&, Next&) { cells.pop_back(); }) == M4GN_ERROR_INPUT);
    REQUIRE(with([](List& cells, List&, Next&) { cells[1] = nullptr; }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "p"));
    REQUIRE(with([](List&, List& boundary, Next&) { boundary[0] = nullptr; }) == M4GN_ERROR_INPUT);
    REQUIRE(contains(message, "U"));
    REQUIRE(with([](List&, List&, Next& next) { next[1] = nullptr; }) == M4GN_ERROR_INPUT);
    static std::vector<double> bad(24, NAN), infinite(20, INFINITY);
    REQUIRE(with([](List& cells, List&, Next&) { cells[1] = bad.data(); }) == M4GN_ERROR_NUMERICAL);
    REQUIRE(
        with([](List&, List& boundary, Next&) { boundary[1] = infinite.data(); }) == M4GN_ERROR_NUMERICAL);
    static std::vector<double> huge(24, 1e300);
    REQUIRE(with([](List& cells, List&, Next&) { cells[1] = huge.data(); }) == M4GN_ERROR_NUMERICAL);
    Fields lists(mesh);
    const auto cells = lists.cells(), boundary = lists.boundary();
    const auto next = lists.next();
    const auto step = [&](const double* const* c, const double* const* b, double* const* n) {
        return m4gn_session_step(session.get(), c, b, n);
    };
    REQUIRE(step(nullptr, boundary.data(), next.data()) == M4GN_ERROR_INPUT);
    REQUIRE(step(cells.data(), nullptr, next.data()) == M4GN_ERROR_INPUT);
    REQUIRE(step(cells.data(), boundary.data(), nullptr) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_session_step(nullptr, cells.data(), boundary.data(), next.data()) == M4GN_ERROR_INPUT);
    // Still usable.
    Fields fields(mesh);
    session.step(fields.cells(), fields.boundary(), fields.next());
}

} // namespace

int main()
{
    // As OpenFOAM's FOAM_SIGFPE does: a division by zero in here would kill this program.
    const int traps = FE_DIVBYZERO | FE_INVALID | FE_OVERFLOW;
    feenableexcept(traps);
    steps();
    REQUIRE(fegetexcept() == traps);
    readsTheModelOnce();
    refusesModels();
    refusesOptions();
    refusesMeshes();
    REQUIRE(fegetexcept() == traps);
    refusesFields();
    REQUIRE(fegetexcept() == traps);
    REQUIRE(std::fetestexcept(FE_DIVBYZERO | FE_INVALID) == 0);
    std::puts("session: ok");
    return 0;
}
