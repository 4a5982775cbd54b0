// SPDX-License-Identifier: GPL-3.0-or-later
//
// m4gn.h for C++ (14 and later): objects that free themselves, errors as exceptions. Header only.

#ifndef M4GN_HPP
#define M4GN_HPP

#include "m4gn.h"

#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
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
    void operator()(m4gn_segments* segments) const noexcept { m4gn_segments_free(segments); }
    void operator()(m4gn_modes* modes) const noexcept { m4gn_modes_free(modes); }
    void operator()(m4gn_recorder* recorder) const noexcept { m4gn_recorder_free(recorder); }
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

// A text as JSON has it, quotes included.
inline std::string quoted(const std::string& text)
{
    std::string result("\"");
    for (const char c : text) {
        if (c == '"' || c == '\\') {
            result += '\\';
        }
        result += static_cast<unsigned char>(c) < 0x20 ? ' ' : c;
    }
    return result + '"';
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
        const int32_t count = m4gn_model_elastic_modes(model_.get());
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
        // One more than needed, so that a rank without cells has a pointer too.
        std::vector<int32_t> cellSegment(nCells + 1);
        check(m4gn_session_segments(session_.get(), cellSegment.data()));
        cellSegment.pop_back();
        return cellSegment;
    }

    // One step. Collective.
    void step(const std::vector<m4gn_field>& in, const std::vector<m4gn_field_out>& out)
    {
        check(m4gn_session_step(
            session_.get(), in.data(), static_cast<int32_t>(in.size()), out.data(),
            static_cast<int32_t>(out.size())));
    }

    // Displacement of the obstacle's points, x y z each, at the start and at the end of the next step. Collective.
    void setObstacle(const std::vector<double>& now, const std::vector<double>& after)
    {
        const auto n = static_cast<int32_t>(now.size() / 3);
        if (after.size() != now.size()) {
            throw Error(M4GN_ERROR_INPUT, "setObstacle: two displacements of different lengths");
        }
        check(m4gn_session_set_obstacle(session_.get(), now.data(), after.data(), n));
    }

    m4gn_session* get() const noexcept { return session_.get(); }

private:
    detail::Handle<m4gn_session> session_;
};

// Segments of a mesh, of a model's segmentation or of the default one. Made by all ranks together.
class Segments
{
public:
    // options: a JSON object, {"segments": {"count": 36}, ...}. cellSegment may be null: computed; so may model: the default.
    Segments(
        int32_t comm, const m4gn_mesh_data& mesh, const std::string& options = "{}",
        const int32_t* cellSegment = nullptr, const Model* model = nullptr)
        : segments_(detail::made<m4gn_segments>([&](m4gn_segments** made) {
              return m4gn_segments_new(
                  comm, &mesh, model ? model->get() : nullptr, options.c_str(), cellSegment, made);
          }))
    {}

    // Segments K.
    int32_t count() const { return m4gn_segments_count(segments_.get()); }

    // Segment of each of this rank's nCells cells.
    std::vector<int32_t> cells(std::size_t nCells) const
    {
        std::vector<int32_t> cellSegment(nCells + 1);
        check(m4gn_segments_cells(segments_.get(), cellSegment.data()));
        cellSegment.pop_back();
        return cellSegment;
    }

    // Nodes of each segment, and edges between them (K*K), over all ranks.
    void graph(std::vector<double>& sizes, std::vector<double>& adjacency) const
    {
        const auto k = static_cast<std::size_t>(count());
        sizes.resize(k);
        adjacency.resize(k * k);
        check(m4gn_segments_graph(segments_.get(), sizes.data(), adjacency.data()));
    }

    int32_t nModes() const { return m4gn_segments_n_modes(segments_.get()); }

    // Eigenvalue of mode i (1/m^2), and its values in this rank's nCells cells.
    double mode(int32_t i, std::size_t nCells, std::vector<double>& cells) const
    {
        double eigenvalue = 0;
        cells.resize(nCells + 1);
        check(m4gn_segments_mode(segments_.get(), i, &eigenvalue, cells.data()));
        cells.pop_back();
        return eigenvalue;
    }

    // The rank of each segment. rankWeights may be empty: equal.
    static std::vector<int32_t> ranks(
        const std::vector<double>& sizes, const std::vector<double>& adjacency, int32_t nRanks,
        const std::vector<double>& rankWeights = {}, m4gn_rank_report* report = nullptr)
    {
        std::vector<int32_t> rank(sizes.size());
        check(m4gn_segment_ranks(
            static_cast<int32_t>(sizes.size()), sizes.data(), adjacency.data(), nRanks,
            rankWeights.empty() ? nullptr : rankWeights.data(), rank.data(), report));
        return rank;
    }

private:
    detail::Handle<m4gn_segments> segments_;
};

// Modes of a solver's own pair of matrices. Made by all ranks together.
class Modes
{
public:
    // mass: NULL is the identity. options: a JSON object, {"modes": 6, ...}. positions may be null.
    Modes(
        int32_t comm, const m4gn_csr& stiffness, const m4gn_csr* mass, const std::string& options = "{}",
        const double* positions = nullptr)
        : nRows_(static_cast<std::size_t>(stiffness.n_rows)),
          modes_(detail::made<m4gn_modes>([&](m4gn_modes** made) {
              return m4gn_modes_new(comm, &stiffness, mass, options.c_str(), positions, made);
          }))
    {}

    // Of an elastic body: each vector has the displacement (x, y, z) of each of this rank's points.
    Modes(int32_t comm, const m4gn_solid& body, const std::string& options = "{}")
        : nRows_(3 * static_cast<std::size_t>(body.n_points)),
          modes_(detail::made<m4gn_modes>(
              [&](m4gn_modes** made) { return m4gn_solid_modes_new(comm, &body, options.c_str(), made); }))
    {}

    int32_t size() const { return m4gn_modes_count(modes_.get()); }

    // Ascending.
    std::vector<double> eigenvalues() const
    {
        // One more than needed, here and below, so that an empty list has a pointer too.
        std::vector<double> values(static_cast<std::size_t>(size()) + 1);
        check(m4gn_modes_eigenvalues(modes_.get(), values.data()));
        values.pop_back();
        return values;
    }

    // One mode, this rank's rows.
    std::vector<double> vector(int32_t index) const
    {
        std::vector<double> values(nRows_ + 1);
        check(m4gn_modes_vector(modes_.get(), index, values.data()));
        values.pop_back();
        return values;
    }

private:
    std::size_t nRows_;
    detail::Handle<m4gn_modes> modes_;
};

// A trajectory being recorded. Made and destroyed by all ranks together; without finish() nothing is left behind.
class Recorder
{
public:
    // options: a JSON object, {"path": "run.h5", ...}.
    Recorder(
        int32_t comm, const m4gn_mesh_data& mesh, const std::string& options,
        const std::vector<m4gn_recorder_field>& fields)
        : recorder_(detail::made<m4gn_recorder>([&](m4gn_recorder** made) {
              return m4gn_recorder_new(
                  comm, &mesh, options.c_str(), fields.data(), static_cast<int32_t>(fields.size()), made);
          }))
    {}

    // Appends a frame. Collective.
    void append(double time, const std::vector<m4gn_field>& fields)
    {
        check(
            m4gn_recorder_append(recorder_.get(), time, fields.data(), static_cast<int32_t>(fields.size())));
    }

    int64_t nFrames() const { return m4gn_recorder_n_frames(recorder_.get()); }

    // Completes the file and gives it its final name. Collective.
    void finish() { check(m4gn_recorder_finish(recorder_.get())); }

private:
    detail::Handle<m4gn_recorder> recorder_;
};

// A hybrid run (m4gn.h says who calls what when). Made and destroyed by all ranks together.
class Ride
{
public:
    using Fields = std::vector<m4gn_field>;

    // options: a JSON object, {"mode": "replace", "solver_steps": 5, "surrogate_steps": 10}. Of a session, which outlives the ride.
    Ride(
        Session& session, const m4gn_mesh_data& mesh, const std::string& options, const m4gn_ride_step& start)
        : Ride(M4GN_NO_MPI, {session.get(), nullptr, nullptr, 0}, &mesh, options, start)
    {}

    Ride(
        int32_t comm, const m4gn_ride_surrogates& surrogates, const m4gn_mesh_data* mesh,
        const std::string& options, const m4gn_ride_step& start)
        : ride_(detail::made<m4gn_ride>([&](m4gn_ride** made) {
              return m4gn_ride_new(comm, &surrogates, mesh, options.c_str(), &start, made);
          }))
    {}

    m4gn_ride_answer solved(const m4gn_ride_step& now)
    {
        return answer([&](m4gn_ride_answer* a) { return m4gn_ride_solved(ride_.get(), &now, a); });
    }

    m4gn_ride_answer decide(const Fields& fields, const int32_t* const* held = nullptr)
    {
        return answer([&](m4gn_ride_answer* a) {
            return m4gn_ride_decide(ride_.get(), fields.data(), held, size(fields), a);
        });
    }

    m4gn_ride_answer stride(const Fields& fields, const std::vector<m4gn_field_out>& out)
    {
        return answer([&](m4gn_ride_answer* a) {
            return m4gn_ride_stride(ride_.get(), fields.data(), size(fields), out.data(), size(out), a);
        });
    }

    m4gn_ride_answer advanced(const m4gn_ride_step& now)
    {
        return answer([&](m4gn_ride_answer* a) { return m4gn_ride_advanced(ride_.get(), &now, a); });
    }

    // The arrays of the state, where an answer asks for them, and of the one that was predicted.
    void record(const std::vector<const double*>& arrays)
    {
        check(m4gn_ride_record(ride_.get(), arrays.data(), size(arrays)));
    }

    // Those of a state so long before it (s), where a time scheme has an old level.
    void arrays(const std::vector<double*>& places, double before = 0) const
    {
        check(m4gn_ride_arrays(ride_.get(), before, places.data(), size(places)));
    }

    // What is known of the inputs at the end of the next stride.
    void inputs(const std::vector<const double*>& arrays)
    {
        check(m4gn_ride_inputs(ride_.get(), arrays.data(), size(arrays)));
    }

    // What the setting quantities names is after the present state.
    void reported(const std::vector<double>& values)
    {
        check(m4gn_ride_reported(ride_.get(), values.data(), size(values)));
    }

    void spent(double surrogate, double handOver)
    {
        check(m4gn_ride_spent(ride_.get(), surrogate, handOver));
    }

    m4gn_ride_answer handedBack(
        const m4gn_ride_step& now, const Fields& fields,
        const std::vector<m4gn_ride_quantity>& quantities = {})
    {
        return answer([&](m4gn_ride_answer* a) {
            return m4gn_ride_handed_back(
                ride_.get(), &now, quantities.data(), size(quantities), fields.data(), size(fields), a);
        });
    }

    void save(const std::string& path) { check(m4gn_ride_save(ride_.get(), path.c_str())); }

    m4gn_ride_answer load(const std::string& path, const m4gn_ride_step& now)
    {
        return answer(
            [&](m4gn_ride_answer* a) { return m4gn_ride_load(ride_.get(), path.c_str(), &now, a); });
    }

    // M4GN_RIDE_LOG, ...
    std::string text(int32_t kind)
    {
        const char* taken = m4gn_ride_text(ride_.get(), kind);
        return taken ? taken : "";
    }

    m4gn_ride* get() const noexcept { return ride_.get(); }

private:
    template <class List> static int32_t size(const List& list) { return static_cast<int32_t>(list.size()); }

    template <class Call> static m4gn_ride_answer answer(const Call& call)
    {
        m4gn_ride_answer found{};
        check(call(&found));
        return found;
    }

    detail::Handle<m4gn_ride> ride_;
};

} // namespace m4gn

#endif
