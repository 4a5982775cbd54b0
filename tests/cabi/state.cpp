// The state of a hybrid run through the C ABI: what crosses for a surrogate of the host's own and for a fit of the run's own states, and
// arrays and calls that are refused. Whole runs of a network, controlled and carried on, are those of examples/hybrid_host.

#include "mesh.hpp"

namespace
{

const std::string model = std::string(M4GN_TEST_DATA) + "/small.safetensors";

// A surrogate of the host's own: p grows by 1 in a stride. Large values are its ends: no result, another error, what is not finite.
int32_t grow(void* data, const double* const* state, double* const* next)
{
    const int nCells = *static_cast<const int*>(data);
    REQUIRE(!next[0] && !next[2] && !next[3] && !next[4] && state[4][0] == 7);
    for (int c = 0; c < nCells; ++c) {
        REQUIRE(next[1][c] == state[1][c]);
        next[1][c] += 1;
    }
    const double first = state[1][0];
    next[1][0] = first >= 300 ? NAN : next[1][0];
    return first >= 300 || first < 100 ? M4GN_OK : first >= 200 ? M4GN_ERROR_FILE : M4GN_ERROR_NUMERICAL;
}

void ridesOnItsOwn()
{
    Channel mesh(6, 4);
    Fields fields(mesh);
    int nCells = mesh.nCells();
    const char* names[] = {"p"};
    m4gn_surrogate own{"growth", 0.01, 1, names, grow, &nCells};
    std::vector<double> held(fields.pBoundary.size(), 7);
    const auto ride = [&] {
        m4gn::State state = fields.state(mesh);
        state.add("p", M4GN_BOUNDARY, M4GN_HELD, 1, held);
        const m4gn::Host host{state, nullptr, &own, &mesh.data, {}};
        return m4gn::Ride(
            M4GN_NO_MPI, host, R"({"mode": "replace", "solver_steps": 1, "surrogate_steps": 3})", at(0));
    };
    // Where it has no result, the jump ends, and the fields are as they were; another status is an error of the call.
    for (const double broken : {150.0, 250.0, 350.0}) {
        fields.p[0] = 0;
        m4gn::Ride made = ride();
        m4gn_ride_answer answer = made.solved(at(1));
        const double before = fields.p[1];
        answer = made.stride();
        REQUIRE(answer.action == M4GN_RIDE_ADVANCE && answer.strides == 2 && !answer.whole);
        REQUIRE(fields.p[1] == before + 1);
        fields.p[0] = broken;
        REQUIRE(made.advanced(at(6)).action == M4GN_RIDE_STRIDE);
        std::string message;
        const int32_t status = failure(message, [&] { answer = made.stride(); });
        REQUIRE(fields.p[0] == broken && fields.p[1] == before + 1);
        if (broken == 250) {
            REQUIRE(status == M4GN_ERROR_INPUT && contains(message, "growth failed with status 2"));
        } else {
            REQUIRE(status == M4GN_OK && answer.action == M4GN_RIDE_HAND_BACK);
            REQUIRE(contains(made.text(M4GN_RIDE_WARNING), "growth has no finite result"));
        }
    }

    std::string message;
    const auto refused = [&](const char* why) {
        const bool found = failure(message, ride) == M4GN_ERROR_INPUT && contains(message, why);
        own = {"growth", 0.01, 1, names, grow, &nCells};
        names[0] = "p";
        return found;
    };
    own.step = nullptr;
    REQUIRE(refused("step"));
    own.n_fields = 0;
    REQUIRE(refused("at least one field"));
    own.n_fields = -1;
    REQUIRE(refused("n_fields"));
    own.stride = 0;
    REQUIRE(refused("stride"));
    own.name = nullptr;
    REQUIRE(refused("name"));
    own.fields = nullptr;
    REQUIRE(refused("fields"));
    names[0] = "T";
    REQUIRE(refused("T"));
}

// A run whose waves a fit knows after a while: it jumps without a model, a mesh, or a session.
struct Waves
{
    std::vector<double> p = std::vector<double>(20), flux = std::vector<double>(7), inlet{0};
    int64_t index = 0;
    bool knows = true;
    m4gn::Ride ride;

    explicit Waves(const std::string& more = "")
        : ride(
            M4GN_NO_MPI, host(),
            R"({"mode": "replace", "surrogates": ["dmd"], "dmd": {"snapshotInterval": 0.01}, "name": "waves")"
                + more + "}",
            at(0))
    {}

    static double wave(double time, std::size_t i) { return std::sin(30 * time - 0.4 * i); }

    m4gn::Host host()
    {
        m4gn::Host host{};
        host.state.add("p", M4GN_POINTS, M4GN_SOLVED, 1, p)
            .add("flux", M4GN_FACES, M4GN_CARRIED, 1, flux)
            .add("inlet", M4GN_BOUNDARY, M4GN_PRESCRIBED, 1, inlet);
        host.ahead = [this](double later, const std::vector<double*>& places) {
            if (!knows) {
                throw m4gn::Error(M4GN_ERROR_FILE, "nobody knows");
            }
            REQUIRE(!places[0] && !places[1] && later > 0);
            places[2][0] = wave(dt * static_cast<double>(index) + later, 0);
        };
        return host;
    }

    // What is off from the solver's own state.
    double error() const
    {
        double most = 0;
        for (std::size_t i = 0; i < p.size(); ++i) {
            most = std::max(most, std::abs(p[i] - wave(dt * static_cast<double>(index), i)));
        }
        for (std::size_t i = 0; i < flux.size(); ++i) {
            most = std::max(most, std::abs(flux[i] - 3 * wave(dt * static_cast<double>(index), i + 5)));
        }
        return most;
    }

    void set()
    {
        const double time = dt * static_cast<double>(index);
        for (std::size_t i = 0; i < p.size(); ++i) {
            p[i] = wave(time, i);
        }
        for (std::size_t i = 0; i < flux.size(); ++i) {
            flux[i] = 3 * wave(time, i + 5);
        }
        inlet[0] = wave(time, 0);
    }

    // Until a stride is due.
    m4gn_ride_answer solve()
    {
        m4gn_ride_answer answer{};
        while (answer.action == M4GN_RIDE_SOLVE && index < 1000) {
            ++index;
            set();
            answer = ride.solved(at(index));
        }
        REQUIRE(answer.action == M4GN_RIDE_STRIDE);
        return answer;
    }
};

void fits()
{
    Waves host;
    m4gn_ride_answer answer = host.solve();
    int strides = 0;
    double most = 0;
    for (; answer.action == M4GN_RIDE_STRIDE; ++strides) {
        answer = host.ride.stride();
        if (answer.action == M4GN_RIDE_ADVANCE) {
            REQUIRE(answer.whole && answer.solver_steps == 5);
            host.index += answer.solver_steps;
            host.inlet[0] = Waves::wave(dt * static_cast<double>(host.index), 0);
            most = std::max(most, host.error());
            answer = host.ride.advanced(at(host.index));
        }
    }
    REQUIRE(strides == 10 && most < 1e-6);
    // The state of the solver's step before, for its time scheme.
    std::vector<double> p(host.p), flux(host.flux), inlet(1);
    host.ride.oldLevel(dt, {p.data(), flux.data(), nullptr});
    p.swap(host.p);
    flux.swap(host.flux);
    --host.index;
    REQUIRE(host.error() < 1e-6);
    ++host.index;
    p.swap(host.p);
    flux.swap(host.flux);
    // Of the flux none is wanted
    std::vector<double> one(host.p);
    host.ride.oldLevel(dt, {one.data(), nullptr, nullptr});
    REQUIRE(one == p);
    REQUIRE(m4gn_ride_old_level(host.ride.get(), dt, nullptr) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_old_level(host.ride.get(), NAN, host.host().state.places().data()) == M4GN_ERROR_INPUT);
    REQUIRE(host.ride.handedBack(at(host.index)).action == M4GN_RIDE_SOLVE);
    REQUIRE(contains(host.ride.text(M4GN_RIDE_LOG), "jumped 10 steps of 0.01 s"));

    // What the host cannot say of its prescribed values is an error of the call that asks.
    Waves lost;
    lost.knows = false;
    std::string message;
    const int32_t status = failure(message, [&] {
        lost.solve();
        lost.ride.stride();
    });
    REQUIRE(status == M4GN_ERROR_INPUT && contains(message, "prescribed"));

    // A prescribed value that the fit says otherwise of: no stride.
    Waves other;
    other.solve();
    other.index += 3;
    REQUIRE(other.ride.stride().action != M4GN_RIDE_ADVANCE);
}

// Arrays that are no state, beside those that tests/odds hands in on one rank of several.
void refusesArrays()
{
    Channel mesh(6, 4);
    Fields fields(mesh);
    m4gn::Session session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model));
    std::string message;
    const std::string network = R"({"mode": "observe"})",
                      dmd = R"({"mode": "observe", "surrogates": ["dmd"]})";
    const auto with = [&](void (*change)(std::vector<m4gn_array>&), const std::string& options) {
        auto arrays = fields.state(mesh).arrays();
        change(arrays);
        const bool fit = options == dmd;
        const m4gn_host host{
            fit ? nullptr : session.get(),
            nullptr,
            fit ? nullptr : &mesh.data,
            arrays.data(),
            static_cast<int32_t>(arrays.size()),
            nullptr,
            nullptr};
        const m4gn_ride_step start = at(0);
        m4gn_ride* ride = nullptr;
        const int32_t status = m4gn_ride_new(M4GN_NO_MPI, &host, options.c_str(), &start, &ride);
        message = status == M4GN_OK ? "" : m4gn_last_error();
        REQUIRE((status == M4GN_OK) == (ride != nullptr));
        m4gn_ride_free(ride);
        return status;
    };
    using Arrays = std::vector<m4gn_array>;
    for (const std::string& options : {network, dmd}) {
        REQUIRE(with([](Arrays&) {}, options) == M4GN_OK);
        const auto refused = [&](void (*change)(Arrays&), const char* why) {
            return with(change, options) == M4GN_ERROR_INPUT && contains(message, why);
        };
        REQUIRE(refused([](Arrays& a) { a[1].n = INT64_MAX; }, "p"));
        REQUIRE(refused([](Arrays& a) { a[1].components = -3; }, "p"));
        REQUIRE(refused([](Arrays& a) { a[0].solved = 0; }, "U"));
        REQUIRE(refused([](Arrays& a) { a[1].place = 5; }, "place"));
        REQUIRE(refused([](Arrays& a) { a[1].role = 5; }, "role"));
        REQUIRE(refused([](Arrays& a) { a[1].name = "\xff"; }, "name"));
        REQUIRE(refused([](Arrays& a) { a.clear(); }, ""));
    }
    // Of a network all that it reads, of its mesh; of a fit some that it is made of.
    REQUIRE(with([](Arrays& a) { a[3].n = 3; }, network) == M4GN_ERROR_INPUT && contains(message, "p"));
    REQUIRE(with([](Arrays& a) { a[3].name = "T"; }, network) == M4GN_ERROR_INPUT && contains(message, "p"));
    REQUIRE(with([](Arrays& a) { a[0].components = 1; }, network) == M4GN_ERROR_INPUT);
    REQUIRE(with([](Arrays& a) { a[0].role = M4GN_CARRIED; }, dmd) == M4GN_ERROR_INPUT);
}

// Surrogates that the settings do not name, places that there are not, calls that are not due; the ride can be used afterwards.
void refusesCalls()
{
    Channel mesh(6, 4);
    Fields fields(mesh);
    m4gn::Session session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model));
    const m4gn::State state = fields.state(mesh);
    const auto& arrays = state.arrays();
    const m4gn_ride_step start = at(0), first = at(1);
    const auto refused = [&](m4gn_session* of, const m4gn_surrogate* own, const char* options,
                             const char* why) {
        const m4gn_host host{of,      own,    &mesh.data, arrays.data(), static_cast<int32_t>(arrays.size()),
                             nullptr, nullptr};
        m4gn_ride* ride = nullptr;
        return m4gn_ride_new(M4GN_NO_MPI, &host, options, &start, &ride) == M4GN_ERROR_INPUT && !ride
               && contains(m4gn_last_error(), why);
    };
    const char* observe = R"({"mode": "observe"})";
    const m4gn_surrogate own{};
    REQUIRE(refused(session.get(), nullptr, R"({"mode": "ride"})", "mode"));
    REQUIRE(refused(
        session.get(), nullptr, R"({"mode": "observe", "surrogates": ["dmd"]})", "do not name network"));
    REQUIRE(refused(session.get(), &own, observe, "both"));
    REQUIRE(refused(nullptr, nullptr, observe, ""));

    m4gn::Ride made(
        M4GN_NO_MPI, {state, &session, nullptr, &mesh.data, {}},
        R"({"mode": "replace", "solver_steps": 5, "surrogate_steps": 2})", start);
    m4gn_ride* ride = made.get();
    const double* const* values = state.values().data();
    double* const* next = state.places().data();
    std::vector<double> off(fields.U.size());
    m4gn_ride_answer answer{};
    int32_t wants = 0;
    REQUIRE(m4gn_ride_wants(nullptr, &start, &wants) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_wants(ride, nullptr, &wants) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_wants(ride, &start, nullptr) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_solved(nullptr, &start, values, &answer) == M4GN_ERROR_INPUT);
    REQUIRE(
        m4gn_ride_stride(ride, next, &answer) == M4GN_ERROR_INPUT
        && contains(m4gn_last_error(), "solved is due"));
    REQUIRE(m4gn_ride_advanced(ride, &first, values, &answer) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_handed_back(ride, &first, values, nullptr, 0, &answer) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_old_level(ride, dt, next) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_difference(ride, 0, 0, off.data()) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_wave(ride, -1, 0, 1, 0, off.data()) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_conditions(ride, "[]") == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_ride_load(ride, "none.state", &start, values, &answer) == M4GN_ERROR_FILE);
    REQUIRE(m4gn_ride_text(ride, 99) == nullptr);
    m4gn_ride_free(nullptr);
    REQUIRE(made.solved(first).action == M4GN_RIDE_SOLVE);
}

} // namespace

int main()
{
    ridesOnItsOwn();
    fits();
    refusesArrays();
    refusesCalls();
    return 0;
}
