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
    const auto refused = [&](const std::string& path, Texts texts) {
        return fails(M4GN_ERROR_FILE, texts, [&] { m4gn::Model(M4GN_NO_MPI, path); });
    };
    REQUIRE(refused("/no/such/model.safetensors", {"/no/such/model.safetensors", "No such file"}));

    std::ifstream file(model, std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
    const std::string damaged = "damaged-" + std::to_string(bytes.size()) + ".safetensors";
    for (const std::string& content : {bytes.substr(0, bytes.size() - 7), bytes.substr(0, 20), std::string()})
    {
        std::ofstream(damaged, std::ios::binary) << content;
        REQUIRE(refused(damaged, {damaged.c_str(), "truncated"}));
    }
    std::remove(damaged.c_str());

    REQUIRE(refused("", {}));
    REQUIRE(refused("/", {"a folder"}));
    Channel mesh(6, 4);
    m4gn_session* session = nullptr;
    REQUIRE(m4gn_session_new(M4GN_NO_MPI, &mesh.data, nullptr, "{}", nullptr, &session) == M4GN_ERROR_INPUT);
    REQUIRE(!session && contains(m4gn_last_error(), "model"));
}

void refusesOptions()
{
    Channel mesh(6, 4);
    const auto refused = [&](const std::string& entries, Texts texts = {}) {
        return fails(M4GN_ERROR_INPUT, texts, [&] {
            m4gn::Session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model), settings(entries));
        });
    };
    const auto segments = [&](const std::string& entries, Texts texts = {}) {
        return refused("\"segments\": {" + entries + "}", texts);
    };
    REQUIRE(segments(R"("count": 25)", {"25", "24"}));
    REQUIRE(segments(
        R"("count": -1)",
        {"segments.count: expected a whole number that is not negative, found integer -1"}));
    REQUIRE(refused(R"("nThreads": -1)", {"nThreads: expected"}));
    REQUIRE(refused(
        R"("precision": "fp16")", {"precision: expected one of model, auto, fp32, bf16, found fp16"}));
    REQUIRE(segments(R"("method": "scissors")", {"scissors", "slic-mdode"}));
    REQUIRE(segments(R"("connected": 2)"));
    REQUIRE(segments(R"("distanceScale": -1)"));
    REQUIRE(segments(R"("modal_solver": "abacus")"));
    REQUIRE(segments(
        R"("method": "slic-mdodl", "obstacles": ["ball", "stick"])",
        {"ball, stick: expected some of the patches"}));
    REQUIRE(refused(R"("model": "another")"));
    REQUIRE(refused("nothing"));
    const std::vector<int32_t> labels(24, 9);
    REQUIRE(fails(M4GN_ERROR_INPUT, {}, [&] {
        m4gn::Session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model), "{}", labels.data());
    }));

    // The same without a session.
    m4gn::checkOptions("session", settings(R"("segments": {"count": 9})"));
    REQUIRE(fails(M4GN_ERROR_INPUT, {"bakcend: unknown entry", "is backend meant?"}, [&] {
        m4gn::checkOptions("session", R"({"bakcend": "a"})");
    }));
}

void refusesMeshes()
{
    const auto refused = [&](int32_t status, void (*change)(Channel&), Texts texts = {}) {
        Channel mesh(6, 4);
        change(mesh);
        return fails(
            status, texts, [&] { m4gn::Session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model)); });
    };
    // A few of each class; src/mesh has the others
    const auto input = M4GN_ERROR_INPUT, wrong = M4GN_ERROR_MESH;
    REQUIRE(refused(input, [](Channel& m) { m.data.cell_centres = nullptr; }, {"cell_centres"}));
    REQUIRE(refused(input, [](Channel& m) { m.data.n_directions = 1; }));
    const auto spatial = [](Channel& m) {
        m.data.n_directions = 3;
        m.data.directions[2] = 2;
    };
    REQUIRE(refused(M4GN_ERROR_MODEL, spatial, {"2 dimensions"}));
    REQUIRE(refused(wrong, [](Channel& m) { m.faceOwner[3] = 24; }, {"face_owner[3]"}));
    REQUIRE(refused(wrong, [](Channel& m) { m.boundaryType[2] = 17; }, {"boundary_type[2]"}));
    const auto symmetry = [](Channel& m) { m.boundaryType[0] = M4GN_SYMMETRY; };
    REQUIRE(refused(M4GN_ERROR_MODEL, symmetry, {"patch 'inlet' is symmetry"}));
    REQUIRE(refused(wrong, [](Channel& m) { m.cellCentres[4] = INFINITY; }));
    REQUIRE(refused(input, [](Channel& m) { m.patches[1] = nullptr; }, {"patch_names[1]"}));
    // A communicator where there is no MPI.
    Channel mesh(6, 4);
    REQUIRE(fails(input, {}, [&] { m4gn::Session(0, mesh.data, m4gn::Model(M4GN_NO_MPI, model)); }));
}

// Nothing is written. What may be missing is tried on each rank of several by tests/odds.
void refusesFields()
{
    Channel mesh(6, 4);
    m4gn::Session session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model));
    Fields fields(mesh);
    const Fields before(mesh);
    const auto step = [&] { session.step(fields.cells(), fields.boundary(), fields.next()); };
    for (const double wrong : {double(NAN), 1e300}) {
        fields.p[3] = wrong;
        REQUIRE(fails(M4GN_ERROR_NUMERICAL, {}, step) && fields.U == before.U && fields.p[4] == before.p[4]);
    }
    fields.p = before.p;
    step();
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
