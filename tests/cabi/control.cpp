// The controller of a surrogate's jumps through the C ABI: figures known on paper, a state that is carried on, every kind of refusal.

#include "mesh.hpp"

namespace
{

const std::string model = std::string(M4GN_TEST_DATA) + "/small.safetensors";

struct Control
{
    m4gn_control* get = nullptr;
    char note[64] = "";

    Control(const m4gn::Session& session, const char* options)
    {
        m4gn::check(m4gn_control_new(session.get(), options, note, sizeof(note), &get));
    }
    Control(const Control&) = delete;
    Control& operator=(const Control&) = delete;
    ~Control() { m4gn_control_free(get); }

    // A stride that was off by 2 % of U and by half of p
    void measure()
    {
        const m4gn_stride_error rows[] = {{0.04, 0.3, 2.0}, {1.0, 0.3, 2.0}};
        m4gn::check(m4gn_control_measure(get, rows, 2));
    }

    int32_t strides(double& error, double& estimate) const
    {
        int32_t count = -1;
        m4gn::check(m4gn_control_strides(get, 10, &count, &error, &estimate));
        return count;
    }
};

bool near(double a, double b) { return std::abs(a - b) < 1e-12; }

void decides()
{
    Channel mesh(6, 4);
    m4gn::Session session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model));
    Control control(session, R"({"tolerance": 0.05})");
    REQUIRE(std::string(control.note) == "U");

    double error = 0, estimate = 0;
    int32_t bad = 0;
    m4gn_stride_error rows[2] = {};
    REQUIRE(control.strides(error, estimate) == 0 && std::isinf(error));
    m4gn::check(m4gn_control_state(control.get, rows, 2, &bad));
    REQUIRE(bad == -1);

    // This model does not say how its errors grow: they add up, 0.02 a stride
    control.measure();
    REQUIRE(control.strides(error, estimate) == 2 && near(error, 0.02) && near(estimate, 0.04));
    m4gn::check(m4gn_control_estimate(control.get, 3, &estimate));
    REQUIRE(near(estimate, 0.06));
    const double errors[] = {0.1, 5.0};
    m4gn::check(m4gn_control_relative(control.get, errors, 2, &error));
    REQUIRE(near(error, 0.05));
    int32_t accepted = -1;
    const double changes[] = {0.89, 0.1}, more[] = {0.91, 0.1};
    m4gn::check(m4gn_control_accepts(control.get, changes, 2, &accepted));
    REQUIRE(accepted == 1);
    m4gn::check(m4gn_control_accepts(control.get, more, 2, &accepted));
    REQUIRE(accepted == 0);

    // Another controller goes on from its state
    m4gn::check(m4gn_control_state(control.get, rows, 2, &bad));
    REQUIRE(bad == 0 && rows[0].error == 0.04 && rows[1].size == 2.0);
    Control next(session, R"({"tolerance": 0.05})");
    m4gn::check(m4gn_control_restore(next.get, rows, 2, bad));
    REQUIRE(next.strides(error, estimate) == 2 && near(error, 0.02) && near(estimate, 0.04));

    // A field that is off by half of itself allows no jump, and three such strides end the run
    Control strict(session, R"({"tolerance": 0.05, "fields": ["p"], "onFailure": "stop", "patience": 3})");
    strict.measure();
    strict.measure();
    REQUIRE(strict.strides(error, estimate) == 0);
    std::string message;
    REQUIRE(failure(message, [&] { strict.measure(); }) == M4GN_ERROR_NUMERICAL);
    REQUIRE(contains(message, "3 strides in a row"));
}

void refuses()
{
    Channel mesh(6, 4);
    m4gn::Session session(M4GN_NO_MPI, mesh.data, m4gn::Model(M4GN_NO_MPI, model));
    Control control(session, R"({"tolerance": 0.05})");
    double figure = 0;
    int32_t count = 0;
    m4gn_stride_error rows[3] = {};
    const double figures[3] = {};

    for (const char* options : {"", "{}", R"({"tolerance": -1})", R"({"tolerance": 0.1, "fields": ["q"]})"})
    {
        m4gn_control* none = nullptr;
        REQUIRE(m4gn_control_new(session.get(), options, nullptr, 0, &none) == M4GN_ERROR_INPUT && !none);
    }
    REQUIRE(m4gn_control_check(R"({"tolerence": 1})") == M4GN_ERROR_INPUT && contains(m4gn_last_error(), "tolerence"));
    REQUIRE(m4gn_control_measure(control.get, rows, 3) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_control_measure(control.get, nullptr, 2) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_control_measure(nullptr, rows, 2) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_control_strides(control.get, -1, &count, &figure, &figure) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_control_accepts(control.get, figures, 1, &count) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_control_estimate(control.get, -1, &figure) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_control_relative(control.get, figures, 3, &figure) == M4GN_ERROR_INPUT);
    REQUIRE(m4gn_control_restore(control.get, rows, 2, -1) == M4GN_ERROR_INPUT);
    rows[0].size = NAN;
    REQUIRE(m4gn_control_restore(control.get, rows, 2, 0) == M4GN_ERROR_INPUT);
    control.measure();
    REQUIRE(m4gn_control_state(control.get, rows, 1, &count) == M4GN_ERROR_INPUT);
    m4gn_control_free(nullptr);
}

} // namespace

int main()
{
    decides();
    refuses();
    return 0;
}
