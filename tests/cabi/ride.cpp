// A hybrid run through the C ABI: who calls what when, control, a state that is carried on, every kind of refusal. What the decisions are is tested in src/ride, with surrogates that are known on paper; here a
// network of random weights is enough.

#include "mesh.hpp"

#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>

namespace
{

const std::string model = std::string(M4GN_TEST_DATA) + "/small.safetensors";

// A host whose solver changes its fields by more than the network does. It hands the state in where that is read alone.
struct Host
{
    Channel mesh{6, 4};
    m4gn::Session session;
    Fields fields{mesh};
    std::vector<double> held;
    int64_t index = 0;
    m4gn::State state;
    m4gn::Ride ride;
    std::vector<int32_t> actions;

    explicit Host(const std::string& options)
        : session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model)), held(mesh.nBoundary(), 1),
          state(fields.state(mesh).add("p", M4GN_BOUNDARY, M4GN_HELD, 1, held)),
          ride(M4GN_NO_MPI, {state, &session, nullptr, &mesh.data, {}}, options, at(0))
    {}

    const double* const* values(bool read) const { return read ? state.values().data() : nullptr; }

    m4gn_ride_answer solve()
    {
        const double time = dt * static_cast<double>(index);
        for (std::size_t i = 0; i < fields.U.size(); ++i) {
            fields.U[i] += 2 * std::sin(300 * time + static_cast<double>(i));
        }
        for (std::size_t i = 0; i < fields.p.size(); ++i) {
            fields.p[i] += 2 * std::cos(300 * time + static_cast<double>(i));
        }
        const m4gn_ride_step now = at(++index);
        m4gn_ride_answer answer{};
        m4gn::check(m4gn_ride_solved(ride.get(), &now, values(ride.wants(now)), &answer));
        return answer;
    }

    void follow(m4gn_ride_answer answer)
    {
        while (answer.action != M4GN_RIDE_SOLVE) {
            actions.push_back(answer.action);
            const bool read = answer.state != 0;
            if (answer.action == M4GN_RIDE_STRIDE) {
                answer = ride.stride();
                continue;
            }
            if (answer.action == M4GN_RIDE_ADVANCE) {
                const m4gn_ride_step now = at(index += answer.solver_steps);
                m4gn::check(m4gn_ride_advanced(ride.get(), &now, values(read), &answer));
                continue;
            }
            const m4gn_ride_step now = at(index);
            const m4gn_ride_quantity energy{"energy", 0.5};
            m4gn::check(m4gn_ride_handed_back(ride.get(), &now, values(read), &energy, 1, &answer));
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
    REQUIRE(std::vector<int32_t>(host.actions.begin(), host.actions.begin() + 5) == jump);
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
    std::vector<double> off(host.fields.U.size());
    REQUIRE(m4gn_ride_difference(host.ride.get(), 0, 0, off.data()) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_wave(host.ride.get(), 0, 0, 1, 0, off.data()) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_wave(host.ride.get(), -1, 0, 1, 0, off.data()) == M4GN_ERROR_INPUT);
    host.run(11);
    std::istringstream rows(host.ride.text(M4GN_RIDE_ERRORS));
    std::string line;
    int n = 0;
    while (std::getline(rows, line)) {
        n += line[0] != '#';
    }
    REQUIRE(n == 2);
    REQUIRE(!host.ride.text(M4GN_RIDE_SEGMENT_ERRORS).empty());
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
    Host stops(base + R"({"tolerance": 1e-9, "onFailure": "stop", "patience": 1}})");
    std::string message;
    REQUIRE(
        failure(message, [&] { stops.run(12); }) == M4GN_ERROR_NUMERICAL
        && contains(message, "in 1 strides in a row"));
}

void carriesOn()
{
    const std::string options =
        R"({"mode": "replace", "solver_steps": 5, "surrogate_steps": 2, "name": "ride", "control": {"tolerance": 1e9, "relTol": 1e9}})";
    Host whole(options);
    whole.run(7);
    const std::string path = "ride-test.state";
    const m4gn_ride_answer asked = whole.solve();
    const int64_t index = whole.index;
    whole.ride.conditions(R"({"nu": "1"})");
    whole.ride.save(path);
    Host changed(options);
    changed.index = index;
    changed.ride.conditions(R"({"nu": "2"})");
    REQUIRE(changed.ride.load(path, at(index)).action == M4GN_RIDE_SOLVE);
    REQUIRE(contains(changed.ride.text(M4GN_RIDE_LOG), "under other conditions: nu was 1 and is 2"));
    REQUIRE(m4gn_ride_conditions(changed.ride.get(), "[]") == M4GN_ERROR_INPUT);
    Host next(options);
    next.ride.conditions(R"({"nu": "1"})");
    // What the state points to stays where it is.
    std::copy(whole.fields.U.begin(), whole.fields.U.end(), next.fields.U.begin());
    std::copy(whole.fields.p.begin(), whole.fields.p.end(), next.fields.p.begin());
    next.index = whole.index;
    next.follow(next.ride.load(path, at(next.index)));
    REQUIRE(contains(next.ride.text(M4GN_RIDE_LOG), "ride goes on from its state"));
    whole.follow(asked);
    whole.run(12);
    next.run(12);
    REQUIRE(whole.index == next.index && whole.fields.U == next.fields.U && whole.fields.p == next.fields.p);

    std::ofstream(path, std::ios::binary | std::ios::app) << "more";
    REQUIRE(fails(M4GN_ERROR_FILE, {path.c_str()}, [&] { Host(options).ride.load(path, at(index)); }));
    std::remove(path.c_str());
}

void refuses()
{
    Host host(R"({"mode": "replace", "solver_steps": 5, "surrogate_steps": 2})");
    m4gn_ride* none = nullptr;
    m4gn_ride_answer answer{};
    const m4gn_ride_step start = at(0);
    const auto& arrays = host.state.arrays();
    const m4gn_host good{
        host.session.get(),
        nullptr,
        &host.mesh.data,
        arrays.data(),
        static_cast<int32_t>(arrays.size()),
        nullptr,
        nullptr};
    const char* usual = R"({"mode": "observe"})";
    const auto refused = [&](const m4gn_host& changed, const char* options) {
        return m4gn_ride_new(M4GN_NO_MPI, &changed, options, &start, &none) == M4GN_ERROR_INPUT && !none;
    };
    for (const char* options :
         {"", "{}", R"({"mode": "ride"})",
          R"({"mode": "observe", "control": {"tolerance": 0.1, "fields": ["q"]}})"})
    {
        REQUIRE(refused(good, options));
    }
    // What the settings name is there, and nothing else.
    REQUIRE(refused(good, R"({"mode": "observe", "surrogates": ["dmd"]})"));
    REQUIRE(contains(m4gn_last_error(), "do not name network"));
    m4gn_host changed = good;
    changed.session = nullptr;
    REQUIRE(refused(changed, usual));
    changed = good;
    const m4gn_surrogate own{};
    changed.own = &own;
    REQUIRE(refused(changed, usual) && contains(m4gn_last_error(), "both"));
    REQUIRE(
        m4gn_options_check("ride", R"({"mode": "observe", "control": {"tolerence": 1}})")
        == M4GN_ERROR_INPUT);
    REQUIRE(contains(m4gn_last_error(), "tolerence"));

    m4gn_ride* ride = host.ride.get();
    const double* const* state = host.values(true);
    double* const* next = host.state.places().data();
    int32_t wants = 0;
    REQUIRE(m4gn_ride_wants(nullptr, &start, &wants) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_wants(ride, nullptr, &wants) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_wants(ride, &start, nullptr) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_solved(nullptr, &start, state, &answer) == M4GN_ERROR_INPUT);
    // Calls that are not due
    const m4gn_ride_step first = at(1);
    REQUIRE(
        m4gn_ride_stride(ride, next, &answer) == M4GN_ERROR_INPUT
        && contains(m4gn_last_error(), "solved is due"));
    REQUIRE(m4gn_ride_advanced(ride, &first, state, &answer) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_handed_back(ride, &first, state, nullptr, 0, &answer) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_old_level(ride, dt, next) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_load(ride, "none.state", &start, state, &answer) == M4GN_ERROR_FILE);
    REQUIRE(m4gn_ride_text(ride, 99) == nullptr);

    // The state before a jump: finite. What may be missing of it, and of the places of the next one, is tried by tests/odds.
    host.run(4);
    const m4gn_ride_step fifth = at(++host.index);
    REQUIRE(host.ride.wants(fifth));
    const double pressure = host.fields.p[2];
    host.fields.p[2] = NAN;
    REQUIRE(m4gn_ride_solved(ride, &fifth, state, &answer) == M4GN_ERROR_NUMERICAL);
    host.fields.p[2] = pressure;
    REQUIRE(m4gn_ride_solved(ride, &fifth, state, nullptr) == M4GN_ERROR_INPUT);
    // It can still be used.
    m4gn::check(m4gn_ride_solved(ride, &fifth, state, &answer));
    REQUIRE(answer.action == M4GN_RIDE_STRIDE);
    host.follow(host.ride.stride());
    m4gn_ride_free(nullptr);
}

} // namespace

int main()
{
    takesTurns();
    observes();
    controls();
    carriesOn();
    refuses();
    return 0;
}
