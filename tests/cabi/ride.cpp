// A hybrid run through the C ABI: who calls what when, control, a state that is carried on, learning, every kind of refusal. What the
// decisions are is tested in src/ride, with surrogates that are known on paper; here a network of random weights is enough.

#include "mesh.hpp"

#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>

namespace
{

const std::string model = std::string(M4GN_TEST_DATA) + "/small.safetensors";

// The model's stride is 0.01 s, five of these.
constexpr double dt = 0.002;

// A host whose solver changes its fields by more than the network does.
struct Host
{
    Channel mesh{6, 4};
    m4gn::Session session;
    std::vector<double> U, UBoundary, p, pBoundary;
    int64_t index = 0;
    double time = 0;
    m4gn::Ride ride;
    std::vector<int32_t> actions;

    explicit Host(const std::string& options)
        : session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model)), U(3 * mesh.nCells(), 0.1),
          UBoundary(3 * mesh.nBoundary(), 0.1), p(mesh.nCells(), 0.2), pBoundary(mesh.nBoundary(), 0.2),
          ride(session, mesh.data, options, now())
    {}

    m4gn_ride_step now() const
    {
        m4gn_ride_step step{};
        step.time = step.shown = time;
        step.delta_t = dt;
        step.end_time = HUGE_VAL;
        step.index = index;
        step.correctors = step.most_correctors = -1;
        return step;
    }

    std::vector<m4gn_field> fields() const
    {
        return {{"U", 3, U.data(), UBoundary.data()}, {"p", 1, p.data(), pBoundary.data()}};
    }

    std::vector<m4gn_field_out> out() { return {{"U", 3, U.data()}, {"p", 1, p.data()}}; }

    m4gn_ride_answer solve()
    {
        for (std::size_t i = 0; i < U.size(); ++i) {
            U[i] += 2 * std::sin(300 * time + static_cast<double>(i));
        }
        for (std::size_t i = 0; i < p.size(); ++i) {
            p[i] += 2 * std::cos(300 * time + static_cast<double>(i));
        }
        time = dt * static_cast<double>(++index);
        return ride.solved(now());
    }

    void follow(m4gn_ride_answer answer)
    {
        while (answer.action != M4GN_RIDE_SOLVE) {
            actions.push_back(answer.action);
            switch (answer.action) {
            case M4GN_RIDE_DECIDE:
                answer = ride.decide(answer.fields ? fields() : m4gn::Ride::Fields());
                break;
            case M4GN_RIDE_STRIDE:
                answer = ride.stride(fields(), out());
                break;
            case M4GN_RIDE_ADVANCE:
                index += answer.solver_steps;
                time = dt * static_cast<double>(index);
                answer = ride.advanced(now());
                break;
            default:
                answer = ride.handedBack(now(), fields(), {{"energy", 0.5}});
            }
        }
    }

    void run(int steps)
    {
        for (int i = 0; i < steps; ++i) {
            follow(solve());
        }
    }
};

void takesTurns()
{
    Host host(R"({"mode": "replace", "solverSteps": 5, "surrogateSteps": 2, "setup_seconds": 1.5})");
    host.run(6);
    REQUIRE(host.index == 16);
    const std::vector<int32_t> jump{
        M4GN_RIDE_STRIDE, M4GN_RIDE_ADVANCE, M4GN_RIDE_STRIDE, M4GN_RIDE_ADVANCE, M4GN_RIDE_HAND_BACK};
    REQUIRE(std::vector<int32_t>(host.actions.begin() + 5, host.actions.begin() + 10) == jump);
    const std::string log = host.ride.text(M4GN_RIDE_LOG), rows = host.ride.text(M4GN_RIDE_JUMPS);
    REQUIRE(contains(log, "jumped 2 steps of 0.01 s to time 0.03") && contains(log, "; energy 0.5"));
    REQUIRE(contains(rows, "energy") && contains(rows, "\n0.03\t2\t"));
    REQUIRE(host.ride.text(M4GN_RIDE_JUMPS).empty());
    const std::string summary = host.ride.text(M4GN_RIDE_SUMMARY);
    REQUIRE(contains(summary, "\"jumps\": 1,") && contains(summary, "\"setup_seconds\": 1.5"));
}

void observes()
{
    Host host(R"({"mode": "observe", "rollout_steps": 2, "write_errors": true})");
    REQUIRE(m4gn_ride_difference(host.ride.get(), 0, 0, host.U.data()) == M4GN_ERROR_INPUT);
    host.run(11);
    std::istringstream rows(host.ride.text(M4GN_RIDE_ERRORS));
    std::string line;
    int n = 0;
    while (std::getline(rows, line)) {
        n += line[0] != '#';
    }
    REQUIRE(n == 2);
    REQUIRE(!host.ride.text(M4GN_RIDE_SEGMENT_ERRORS).empty());
    std::vector<double> off(host.U.size());
    m4gn::check(m4gn_ride_difference(host.ride.get(), 0, 0, off.data()));
    REQUIRE(m4gn_ride_difference(host.ride.get(), 0, 2, off.data()) == M4GN_ERROR_INPUT);
    REQUIRE(
        host.ride.text(M4GN_RIDE_SUMMARY).empty()
        && contains(host.ride.text(M4GN_RIDE_LOG), "mean rms errors"));
}

void controls()
{
    const std::string base = R"({"mode": "replace", "solver_steps": 5, "surrogate_steps": 2, "control": )";
    Host strict(base + R"({"tolerance": 1e-9}})");
    strict.run(12);
    REQUIRE(strict.index == 12 && contains(strict.ride.text(M4GN_RIDE_LOG), "m4gn: no jump at time"));
    REQUIRE(contains(strict.ride.text(M4GN_RIDE_STRIDES), "error(U)"));
    Host lenient(base + R"({"tolerance": 1e9, "relTol": 1e9}})");
    lenient.run(12);
    REQUIRE(lenient.index > 12);
    Host stops(base + R"({"tolerance": 1e-9, "onFailure": "stop", "patience": 1}})");
    std::string message;
    REQUIRE(
        failure(message, [&] { stops.run(12); }) == M4GN_ERROR_NUMERICAL
        && contains(message, "in 1 strides in a row"));
}

void carriesOn()
{
    const std::string options =
        R"({"mode": "replace", "solver_steps": 5, "surrogate_steps": 2, "name": "ride", "control": {"tolerance": 1e9, "relTol": 1e9},
            "adapt": {"mode": "during", "steps": 2, "stepsEach": 1, "batch": 1, "start": 0}})";
    Host whole(options);
    whole.run(7);
    const std::string path = "ride-test.state";
    const m4gn_ride_answer asked = whole.solve();
    whole.ride.save(path);
    Host next(options);
    next.U = whole.U;
    next.p = whole.p;
    next.index = whole.index;
    next.time = whole.time;
    next.follow(next.ride.load(path, next.now()));
    REQUIRE(contains(next.ride.text(M4GN_RIDE_LOG), "ride goes on from its state"));
    whole.follow(asked);
    whole.run(12);
    next.run(12);
    REQUIRE(whole.index == next.index && whole.U == next.U && whole.p == next.p);

    // Each byte that is another is found.
    std::ifstream in(path, std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
    for (const std::size_t at : {std::size_t(0), bytes.size() / 3, bytes.size() - 1}) {
        std::string damaged(bytes);
        damaged[at] = static_cast<char>(damaged[at] ^ 4);
        std::ofstream(path, std::ios::binary) << damaged;
        Host other(options);
        other.index = 18;
        other.time = dt * 18;
        std::string message;
        REQUIRE(
            failure(message, [&] { other.ride.load(path, other.now()); }) == M4GN_ERROR_FILE
            && contains(message, path));
    }
    std::remove(path.c_str());
}

// A surrogate of the host's own: p grows by 1 in a stride
int32_t grow(void* data, const m4gn_field* in, int32_t n, const m4gn_field_out* out, int32_t nOut)
{
    const int nCells = *static_cast<const int*>(data);
    REQUIRE(n == 2 && nOut == 1 && std::string(in[1].name) == "p" && std::string(out[0].name) == "p");
    for (int c = 0; c < nCells; ++c) {
        REQUIRE(out[0].cells[c] == in[1].cells[c]);
        out[0].cells[c] += 1;
    }
    return in[1].cells[0] > 100 ? M4GN_ERROR_NUMERICAL : M4GN_OK;
}

void ridesOnItsOwn()
{
    Host host(R"({"mode": "observe"})");
    int nCells = host.mesh.nCells();
    const char* names[] = {"p"};
    const int32_t components[] = {1};
    m4gn_surrogate own{"growth", 0.01, 1, names, components, grow, &nCells};
    const m4gn_ride_surrogates surrogates{nullptr, &own, nullptr, 0};
    const m4gn_ride_step start = host.now();
    const char* options = R"({"mode": "replace", "solver_steps": 1, "surrogate_steps": 3})";
    m4gn_ride* ride = nullptr;
    m4gn::check(m4gn_ride_new(M4GN_NO_MPI, &surrogates, &host.mesh.data, options, &start, &ride));
    m4gn_ride_answer answer{};
    host.time = dt * static_cast<double>(++host.index);
    m4gn_ride_step now = host.now();
    m4gn::check(m4gn_ride_solved(ride, &now, &answer));
    m4gn::check(m4gn_ride_decide(ride, nullptr, nullptr, 0, &answer));
    const auto fields = host.fields();
    const m4gn_field_out out{"p", 1, host.p.data()};
    const double before = host.p[0];
    m4gn::check(m4gn_ride_stride(ride, fields.data(), 2, &out, 1, &answer));
    REQUIRE(answer.action == M4GN_RIDE_ADVANCE && answer.strides == 2 && host.p[0] == before + 1);
    now.time += answer.duration;
    now.index += answer.solver_steps;
    m4gn::check(m4gn_ride_advanced(ride, &now, &answer));
    // Where it has no result, the jump ends, and the fields are as they were.
    host.p[0] = 200;
    m4gn::check(m4gn_ride_stride(ride, fields.data(), 2, &out, 1, &answer));
    REQUIRE(answer.action == M4GN_RIDE_HAND_BACK && host.p[0] == 200);
    REQUIRE(contains(m4gn_ride_text(ride, M4GN_RIDE_WARNING), "growth has no finite result"));
    m4gn_ride_free(ride);

    own.step = nullptr;
    REQUIRE(
        m4gn_ride_new(M4GN_NO_MPI, &surrogates, &host.mesh.data, options, &start, &ride) == M4GN_ERROR_INPUT
        && !ride);
    own.step = grow;
    own.n_fields = 0;
    REQUIRE(
        m4gn_ride_new(M4GN_NO_MPI, &surrogates, &host.mesh.data, options, &start, &ride) == M4GN_ERROR_INPUT);
    own.n_fields = 1;
    options = R"({"mode": "observe", "adapt": {"mode": "before"}})";
    REQUIRE(
        m4gn_ride_new(M4GN_NO_MPI, &surrogates, &host.mesh.data, options, &start, &ride) == M4GN_ERROR_INPUT);
    REQUIRE(contains(m4gn_last_error(), "does not learn"));
}

void refuses()
{
    Host host(R"({"mode": "replace", "solver_steps": 5, "surrogate_steps": 2})");
    m4gn_ride* none = nullptr;
    m4gn_ride_answer answer{};
    const m4gn_ride_step start = host.now();
    const auto made = [&](const char* options) {
        const m4gn_ride_surrogates surrogates{host.session.get(), nullptr, nullptr, 0};
        return m4gn_ride_new(M4GN_NO_MPI, &surrogates, &host.mesh.data, options, &start, &none);
    };
    for (const char* options :
         {"", "{}", R"({"mode": "ride"})",
          R"({"mode": "observe", "control": {"tolerance": 0.1, "fields": ["q"]}})"})
    {
        REQUIRE(made(options) == M4GN_ERROR_INPUT && !none);
    }
    // What the settings name is there, and nothing else.
    REQUIRE(made(R"({"mode": "observe", "surrogates": ["network", "dmd"]})") == M4GN_ERROR_INPUT);
    REQUIRE(contains(m4gn_last_error(), "no arrays of the state"));
    REQUIRE(made(R"({"mode": "observe", "surrogates": ["dmd"]})") == M4GN_ERROR_INPUT);
    REQUIRE(contains(m4gn_last_error(), "do not name network"));
    m4gn_ride_array array{};
    array.name = "p";
    array.n = 3;
    array.components = array.solved = array.fitted = 1;
    array.weights = host.p.data();
    const m4gn_ride_surrogates both{host.session.get(), nullptr, &array, 1};
    const char* named = R"({"mode": "observe", "surrogates": ["network", "dmd"]})";
    REQUIRE(m4gn_ride_new(M4GN_NO_MPI, &both, &host.mesh.data, named, &start, &none) == M4GN_ERROR_INPUT);
    REQUIRE(contains(m4gn_last_error(), "array p: 3 numbers"));
    REQUIRE(m4gn_ride_new(M4GN_NO_MPI, nullptr, &host.mesh.data, named, &start, &none) == M4GN_ERROR_INPUT);
    REQUIRE(
        m4gn_options_check("ride", R"({"mode": "observe", "control": {"tolerence": 1}})")
        == M4GN_ERROR_INPUT);
    REQUIRE(contains(m4gn_last_error(), "tolerence"));
    m4gn_ride* ride = host.ride.get();
    REQUIRE(m4gn_ride_solved(nullptr, &start, &answer) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_solved(ride, nullptr, &answer) == M4GN_ERROR_INPUT);
    REQUIRE(
        m4gn_ride_decide(ride, nullptr, nullptr, 0, &answer) == M4GN_ERROR_INPUT
        && contains(m4gn_last_error(), "solved is due"));
    REQUIRE(m4gn_ride_advanced(ride, &start, &answer) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_handed_back(ride, &start, nullptr, 0, nullptr, 0, &answer) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_save(ride, nullptr) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_load(ride, "none.state", &start, &answer) == M4GN_ERROR_FILE);
    REQUIRE(m4gn_ride_text(ride, 99) == nullptr);
    host.run(4);
    answer = host.solve();
    answer = host.ride.decide({});
    REQUIRE(answer.action == M4GN_RIDE_STRIDE);
    REQUIRE(m4gn_ride_stride(ride, nullptr, 2, nullptr, 0, &answer) == M4GN_ERROR_INPUT);
    const auto fields = host.fields();
    REQUIRE(m4gn_ride_stride(ride, fields.data(), 2, nullptr, 0, &answer) == M4GN_ERROR_INPUT);
    // It can still be used.
    host.follow(answer = host.ride.stride(host.fields(), host.out()));
    m4gn_ride_free(nullptr);
}

} // namespace

int main()
{
    takesTurns();
    observes();
    controls();
    carriesOn();
    ridesOnItsOwn();
    refuses();
    return 0;
}
