// SPDX-License-Identifier: GPL-3.0-or-later
//
// Models, sessions and rides of m4gn.h for C++ (14 and later): objects that free themselves, errors as exceptions. Header only.

#ifndef M4GN_HPP
#define M4GN_HPP

#include "m4gn.h"

#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace m4gn
{

// A failed call. status() is that of m4gn.h: > 0 the object is still usable, < 0 it is not.
class Error : public std::runtime_error
{
public:
    Error(int32_t status, const std::string& message) : std::runtime_error(message), status_(status) {}

    int32_t status() const noexcept { return status_; }

private:
    int32_t status_;
};

// Throws the last error unless the status is fine.
inline void check(int32_t status)
{
    if (status != M4GN_OK) {
        throw Error(status, m4gn_last_error());
    }
}

// Throws if the library is not the one that this header describes.
inline void checkVersion()
{
    if (m4gn_abi_version() != M4GN_ABI_VERSION) {
        throw Error(
            M4GN_ERROR_INTERNAL, "libm4gn.so has interface version " + std::to_string(m4gn_abi_version())
                                     + ", this program was built for " + std::to_string(M4GN_ABI_VERSION)
                                     + ": build it again");
    }
}

namespace detail
{
struct Free
{
    void operator()(m4gn_model* model) const noexcept { m4gn_model_free(model); }
    void operator()(m4gn_session* session) const noexcept { m4gn_session_free(session); }
    void operator()(m4gn_ride* ride) const noexcept { m4gn_ride_free(ride); }
};

template <class Type> using Handle = std::unique_ptr<Type, Free>;

// What the call makes.
template <class Type, class Call> Handle<Type> made(const Call& call)
{
    checkVersion();
    Type* object = nullptr;
    check(call(&object));
    return Handle<Type>(object);
}

} // namespace detail

// Throws if these settings (the text of a JSON object, see m4gn.h) are not valid for m4gn_<kind>_new.
inline void checkOptions(const std::string& kind, const std::string& options)
{
    check(m4gn_options_check(kind.c_str(), options.c_str()));
}

// A model file, read once. Made by all ranks together.
class Model
{
public:
    Model(int32_t comm, const std::string& path)
        : model_(detail::made<m4gn_model>(
            [&](m4gn_model** made) { return m4gn_model_open(comm, path.c_str(), made); }))
    {}

    // Modes of the elastic body that the mesh must have for the model's segments.
    int32_t elasticModes() const
    {
        const int32_t count = m4gn_model_n_elastic_modes(model_.get());
        if (count < 0) {
            throw Error(M4GN_ERROR_MODEL, m4gn_last_error());
        }
        return count;
    }

    const m4gn_model* get() const noexcept { return model_.get(); }

private:
    detail::Handle<m4gn_model> model_;
};

// A model on a mesh. Made and destroyed by all ranks together.
class Session
{
public:
    // options: a JSON object, {"n_threads": 2, ...}. cellSegment may be null: computed.
    Session(
        int32_t comm, const m4gn_mesh_data& mesh, const Model& model, const std::string& options = "{}",
        const int32_t* cellSegment = nullptr)
        : session_(detail::made<m4gn_session>([&](m4gn_session** made) {
              return m4gn_session_new(comm, &mesh, model.get(), options.c_str(), cellSegment, made);
          }))
    {}

    // Time that one step advances, s.
    double stride() const { return m4gn_session_stride(session_.get()); }

    // Segments K.
    int32_t nSegments() const { return m4gn_session_n_segments(session_.get()); }

    // Fields of the model, in its order.
    std::vector<m4gn_field_info> fields() const
    {
        std::vector<m4gn_field_info> list(m4gn_session_n_fields(session_.get()));
        for (std::size_t i = 0; i < list.size(); ++i) {
            check(m4gn_session_field(session_.get(), static_cast<int32_t>(i), &list[i]));
        }
        return list;
    }

    // Segment of each of this rank's nCells cells.
    std::vector<int32_t> segments(std::size_t nCells) const
    {
        std::vector<int32_t> cellSegment(nCells);
        check(m4gn_session_segments(session_.get(), cellSegment.data()));
        return cellSegment;
    }

    // One step, with an array (or null) of each field in all three lists; m4gn.h says what they are. Collective.
    void step(
        const std::vector<const double*>& cells, const std::vector<const double*>& boundary,
        const std::vector<double*>& next)
    {
        const auto n = static_cast<std::size_t>(m4gn_session_n_fields(session_.get()));
        if (cells.size() != n || boundary.size() != n || next.size() != n) {
            throw Error(M4GN_ERROR_INPUT, "step: expected lists of " + std::to_string(n) + " fields");
        }
        check(m4gn_session_step(session_.get(), cells.data(), boundary.data(), next.data()));
    }

    m4gn_session* get() const noexcept { return session_.get(); }

private:
    detail::Handle<m4gn_session> session_;
};

// The arrays of a solver's state on this rank: described once, read and written where the solver has them.
class State
{
public:
    // Names and values must stay where they are: a vector is filled anew, and neither resized nor swapped.
    State& add(const m4gn_array& array, double* values)
    {
        arrays_.push_back(array);
        values_.push_back(values);
        const bool fixed = array.role == M4GN_PRESCRIBED || array.role == M4GN_HELD;
        places_.push_back(fixed ? nullptr : values);
        return *this;
    }

    // weights: those of the items of a solved array; null: 1 each. solved: components that are solved; 0: all.
    State& add(
        const char* name, int32_t place, int32_t role, int32_t components, std::vector<double>& values,
        const double* weights = nullptr, int32_t solved = 0)
    {
        const int64_t n = static_cast<int64_t>(values.size()) / components;
        return add(
            {name, place, role, components, solved ? solved : components, n, -HUGE_VAL, weights},
            values.data());
    }

    const std::vector<m4gn_array>& arrays() const noexcept { return arrays_; }

    const std::vector<double*>& values() const noexcept { return values_; }

    // Where a surrogate may write: null of what it does not advance.
    const std::vector<double*>& places() const noexcept { return places_; }

private:
    std::vector<m4gn_array> arrays_;
    std::vector<double*> values_, places_;
};

// What a host brings along to a ride.
struct Host
{
    State state;
    // Of the surrogate "network": a session, which must outlive the ride, or a surrogate of the host's own; and the mesh of either.
    Session* session = nullptr;
    const m4gn_surrogate* own = nullptr;
    const m4gn_mesh_data* mesh = nullptr;
    // Writes what the prescribed arrays will be a time `later` (s) from the present one; the other places are null. What it throws is an
    // error of the ride's call. May be empty: prescribed values do not change.
    std::function<void(double later, const std::vector<double*>& places)> ahead;
};

// A hybrid run (m4gn.h says who calls what when). The state is read and written where it is. Made and destroyed by all ranks together.
class Ride
{
public:
    // options: a JSON object, {"mode": "replace", "solver_steps": 5, "surrogate_steps": 10}. comm is not read with a session.
    Ride(int32_t comm, Host host, const std::string& options, const m4gn_ride_step& start)
        : host_(new Host(std::move(host))), ride_(detail::made<m4gn_ride>([&](m4gn_ride** made) {
              const auto& arrays = host_->state.arrays();
              const m4gn_host plain{
                  host_->session ? host_->session->get() : nullptr,
                  host_->own,
                  host_->mesh,
                  arrays.data(),
                  static_cast<int32_t>(arrays.size()),
                  host_->ahead ? &Ride::ahead : nullptr,
                  host_.get()};
              return m4gn_ride_new(comm, &plain, options.c_str(), &start, made);
          }))
    {}

    // Whether the state after this step is read: it need not be made up to date where not.
    bool wants(const m4gn_ride_step& now) const
    {
        int32_t wanted = 0;
        check(m4gn_ride_wants(ride_.get(), &now, &wanted));
        return wanted != 0;
    }

    m4gn_ride_answer solved(const m4gn_ride_step& now)
    {
        return answer([&](m4gn_ride_answer* a) { return m4gn_ride_solved(ride_.get(), &now, values(), a); });
    }

    // On M4GN_RIDE_ADVANCE the state is the prediction.
    m4gn_ride_answer stride()
    {
        return answer([&](m4gn_ride_answer* a) {
            return m4gn_ride_stride(ride_.get(), host_->state.places().data(), a);
        });
    }

    m4gn_ride_answer advanced(const m4gn_ride_step& now)
    {
        return answer(
            [&](m4gn_ride_answer* a) { return m4gn_ride_advanced(ride_.get(), &now, values(), a); });
    }

    // The state a time `before` (s) the present one, where a time scheme has an old level; null places of arrays that have none.
    void oldLevel(double before, const std::vector<double*>& places) const
    {
        const std::size_t n = host_->state.arrays().size();
        if (places.size() != n) {
            throw Error(M4GN_ERROR_INPUT, "oldLevel: expected places of " + std::to_string(n) + " arrays");
        }
        check(m4gn_ride_old_level(ride_.get(), before, places.data()));
    }

    // What the setting quantities names is after the present state.
    void reported(const std::vector<double>& values)
    {
        check(m4gn_ride_reported(ride_.get(), values.data(), static_cast<int32_t>(values.size())));
    }

    void spent(double surrogate, double handOver)
    {
        check(m4gn_ride_spent(ride_.get(), surrogate, handOver));
    }

    m4gn_ride_answer handedBack(
        const m4gn_ride_step& now, const std::vector<m4gn_ride_quantity>& quantities = {})
    {
        return answer([&](m4gn_ride_answer* a) {
            return m4gn_ride_handed_back(
                ride_.get(), &now, values(), quantities.data(), static_cast<int32_t>(quantities.size()), a);
        });
    }

    void conditions(const std::string& json) { check(m4gn_ride_conditions(ride_.get(), json.c_str())); }

    void save(const std::string& path) { check(m4gn_ride_save(ride_.get(), path.c_str())); }

    // The state must be that of this time.
    m4gn_ride_answer load(const std::string& path, const m4gn_ride_step& now)
    {
        return answer([&](m4gn_ride_answer* a) {
            return m4gn_ride_load(ride_.get(), path.c_str(), &now, values(), a);
        });
    }

    // M4GN_RIDE_LOG, ...
    std::string text(int32_t kind)
    {
        const char* taken = m4gn_ride_text(ride_.get(), kind);
        return taken ? taken : "";
    }

    m4gn_ride* get() const noexcept { return ride_.get(); }

private:
    // The ride calls back to it, and is freed first.
    std::unique_ptr<Host> host_;
    detail::Handle<m4gn_ride> ride_;

    const double* const* values() const noexcept { return host_->state.values().data(); }

    static int32_t ahead(void* data, double later, double* const* arrays) noexcept
    {
        try {
            const Host& host = *static_cast<const Host*>(data);
            host.ahead(later, {arrays, arrays + host.state.arrays().size()});
            return M4GN_OK;
        } catch (const Error& error) {
            return error.status();
        } catch (...) {
            return M4GN_ERROR_INPUT;
        }
    }

    template <class Call> static m4gn_ride_answer answer(const Call& call)
    {
        m4gn_ride_answer found{};
        check(call(&found));
        return found;
    }
};

} // namespace m4gn

#endif
