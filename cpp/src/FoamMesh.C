// SPDX-License-Identifier: GPL-3.0-or-later
// The mesh as the function objects hand it to libm4gn.so: the same sources, compiled into this library too.

#include "FoamData.H"

#include "m4gnDictionary.H"
#include "m4gnElasticBody.H"
#include "m4gnMeshAdapter.H"
#include "m4gnNodeTypes.H"

#include <string>
#include <vector>

namespace
{

Foam::word word_of(const rust::String& s)
{
    return Foam::word(std::string(s), false);
}

template<class T>
rust::Vec<double> numbers(const T* values, std::size_t n)
{
    rust::Vec<double> result;
    result.reserve(n);
    for (std::size_t i = 0; i < n; ++i) { result.push_back(double(values[i])); }
    return result;
}

} // End anonymous namespace


Foam::dictionary m4gn::FoamCase::Data::function_object() const
{
    const Foam::dictionary functions(time.controlDict().subOrEmptyDict("functions"));
    // What rules a run comes first.
    for (const Foam::word type : {"m4gnSurrogate", "m4gnSegments", "m4gnHarvest"})
    {
        for (const Foam::entry& e : functions)
        {
            if (e.isDict() && e.dict().lookupOrDefault<Foam::word>("type", Foam::word::null) == type)
            {
                return e.dict();
            }
        }
    }
    return Foam::dictionary();
}


std::string m4gn::FoamCase::Data::start_name() const
{
    return Foam::Time::timeName(time.startTime().value());
}


void m4gn::FoamCase::set_node_types(const rust::Vec<rust::String>& keys, const rust::Vec<rust::String>& types)
{
    Foam::dictionary dict(data_->function_object());
    if (dict.name().empty()) { dict.name() = data_->time.path()/"system"/Foam::Time::controlDictName; }
    if (!dict.found("nodeTypes")) { dict.add("nodeTypes", Foam::dictionary()); }
    Foam::dictionary& given = dict.subDict("nodeTypes");
    for (std::size_t i = 0; i < keys.size(); ++i) { given.set(word_of(keys[i]), word_of(types[i])); }

    // What fixes its value where is read from the start time's U and p, as a run registers them.
    Foam::Time& time = data_->time;
    time.setTime(Foam::instant(time.startTime().value(), data_->start_name()), 0);
    data_->current = -1;
    data_->vectors.clear();
    data_->scalars.clear();

    const Foam::m4gnNodeTypes nodes
    (
        *data_->mesh,
        dict,
        dict.lookupOrDefault<Foam::word>("U", "U"),
        dict.lookupOrDefault<Foam::word>("p", "p"),
        dict.lookupOrDefault<Foam::word>("D", "D")
    );
    data_->adapter.reset();
    data_->adapter.reset(new Foam::m4gnMeshAdapter(*data_->mesh, nodes.types()));

    const Foam::dictionary own(dict.subOrEmptyDict("segments"));
    const Foam::word D(dict.lookupOrDefault<Foam::word>("D", "D"));
    const bool possible =
        Foam::m4gnElasticBody::known(*data_->mesh, own)
     && Foam::m4gnElasticBody::describe(*data_->mesh, D) == Foam::m4gnElasticBody::displacement();
    data_->body.reset();
    if (own.lookupOrDefault<Foam::word>("operator", possible ? "elastic" : "laplacian") == "elastic")
    {
        data_->body.reset(new Foam::m4gnElasticBody(*data_->mesh, own, nodes.types()));
    }
}


static rust::Vec<double> body_part(const m4gn_solid& body, const std::string& part)
{
    if (part == "body_flags")
    {
        const int32_t flags[] = {body.plane_stress, body.free_body};
        return numbers(flags, 2);
    }
    if (part == "body_points") { return numbers(body.points, 3*std::size_t(body.n_points)); }
    if (part == "body_face_start") { return numbers(body.face_start, std::size_t(body.n_faces) + 1); }
    if (part == "body_face_points") { return numbers(body.face_points, body.face_start[body.n_faces]); }
    if (part == "body_face_owner") { return numbers(body.face_owner, body.n_faces); }
    if (part == "body_face_neighbour") { return numbers(body.face_neighbour, body.n_internal_faces); }
    if (part == "body_young") { return numbers(body.young, body.n_cells); }
    if (part == "body_poisson") { return numbers(body.poisson, body.n_cells); }
    if (part == "body_density") { return numbers(body.density, body.n_cells); }
    if (part == "body_fixed_point") { return numbers(body.fixed_point, body.n_fixed); }
    if (part == "body_fixed_components") { return numbers(body.fixed_components, body.n_fixed); }
    FatalErrorInFunction << "a body has no part " << part.c_str() << Foam::exit(Foam::FatalError);
    return {};
}


rust::Vec<double> m4gn::FoamCase::mesh_part(rust::Str name) const
{
    if (!data_->adapter)
    {
        FatalErrorInFunction << "the node types of " << data_->path << " are not set" << Foam::exit(Foam::FatalError);
    }
    const m4gn_mesh_data& m = data_->adapter->data();
    const std::string part(name.data(), name.size());
    if (part == "directions") { return numbers(m.directions, m.n_directions); }
    if (part == "cell_centres") { return numbers(m.cell_centres, 3*std::size_t(m.n_cells)); }
    if (part == "cell_volumes") { return numbers(m.cell_volumes, m.n_cells); }
    if (part == "face_owner") { return numbers(m.face_owner, m.n_faces); }
    if (part == "face_neighbour") { return numbers(m.face_neighbour, m.n_faces); }
    if (part == "face_coeff") { return numbers(m.face_coeff, m.n_faces); }
    if (part == "boundary_owner") { return numbers(m.boundary_owner, m.n_boundary); }
    if (part == "boundary_centres") { return numbers(m.boundary_centres, 3*std::size_t(m.n_boundary)); }
    if (part == "boundary_area") { return numbers(m.boundary_area, 3*std::size_t(m.n_boundary)); }
    if (part == "boundary_coeff") { return numbers(m.boundary_coeff, m.n_boundary); }
    if (part == "boundary_type") { return numbers(m.boundary_type, m.n_boundary); }
    if (part == "boundary_patch") { return numbers(m.boundary_patch, m.n_boundary); }
    if (part == "value_patches")
    {
        return numbers(data_->adapter->valuePatches().cdata(), data_->adapter->valuePatches().size());
    }
    if (part == "coupled_owner") { return numbers(m.coupled_owner, m.n_coupled); }
    if (part == "coupled_global") { return numbers(m.coupled_global, m.n_coupled); }
    if (part == "coupled_delta") { return numbers(m.coupled_delta, 3*std::size_t(m.n_coupled)); }
    if (part == "coupled_coeff") { return numbers(m.coupled_coeff, m.n_coupled); }
    if (part.compare(0, 5, "body_") == 0)
    {
        return data_->body ? body_part(data_->body->data(), part) : rust::Vec<double>();
    }
    FatalErrorInFunction << "a mesh has no part " << part.c_str() << Foam::exit(Foam::FatalError);
    return {};
}
