// SPDX-License-Identifier: GPL-3.0-or-later
// The mesh as the function objects hand it to libm4gn.so: the same sources, compiled into this library too.

#include "FoamData.H"

#include "m4gnDictionary.H"
#include "m4gnElasticBody.H"
#include "m4gnNodes.H"
#include "m4gnNodeTypes.H"

#include <string>

namespace
{
Foam::word word_of(const rust::String& s) { return Foam::word(std::string(s), false); }

} // End anonymous namespace

Foam::dictionary m4gn::FoamCase::Data::function_object() const
{
    const Foam::dictionary functions(time.controlDict().subOrEmptyDict("functions"));
    // What rules a run comes first.
    for (const Foam::word type : {"m4gnSurrogate", "m4gnSegments", "m4gnRecorder"}) {
        for (const Foam::entry& e : functions) {
            const bool on = e.isDict() && e.dict().lookupOrDefault<bool>("enabled", true);
            if (on && e.dict().lookupOrDefault<Foam::word>("type", Foam::word::null) == type) {
                return e.dict();
            }
        }
    }
    return Foam::dictionary();
}

std::string m4gn::FoamCase::Data::start_name() const
{
    // timeFormat may have another name than the user's folder. Time 0 is also that of constant
    const Foam::instant start(time.startTime().value());
    const Foam::word stored(time.findInstancePath(start));
    return stored.empty() || stored == time.constant() ? start.name() : stored;
}

void m4gn::FoamCase::set_node_types(const rust::Vec<rust::String>& keys, const rust::Vec<rust::String>& types)
{
    Foam::dictionary dict(data_->function_object());
    if (dict.name().empty()) {
        dict.name() = data_->time.path() / "system" / Foam::Time::controlDictName;
    }
    if (!dict.found("nodeTypes")) {
        dict.add("nodeTypes", Foam::dictionary());
    }
    Foam::dictionary& nodeTypes = dict.subDict("nodeTypes");
    for (std::size_t i = 0; i < keys.size(); ++i) {
        nodeTypes.set(word_of(keys[i]), word_of(types[i]));
    }

    // What fixes its value where is read from the start time's U and p, as a run registers them.
    Foam::Time& time = data_->time;
    time.setTime(Foam::instant(time.startTime().value(), data_->start_name()), 0);
    data_->forget();

    const Foam::m4gnNodeTypes kinds(
        *data_->mesh, dict, dict.lookupOrDefault<Foam::word>("U", "U"),
        dict.lookupOrDefault<Foam::word>("p", "p"), dict.lookupOrDefault<Foam::word>("D", "D"));
    data_->nodes.reset();
    data_->nodes.reset(new Foam::m4gnNodes(*data_->mesh, kinds.types()));

    // Of m4gnRecorder they stand among its own entries
    const Foam::dictionary own(dict.isDict("segments") ? dict.subDict("segments") : dict);
    const Foam::word D(dict.lookupOrDefault<Foam::word>("D", "D"));
    const bool possible =
        Foam::m4gnElasticBody::unknown(*data_->mesh, own).empty()
        && Foam::m4gnElasticBody::describe(*data_->mesh, D) == Foam::m4gnElasticBody::displacement();
    data_->body.reset();
    if (own.lookupOrDefault<Foam::word>("operator", possible ? "elastic" : "laplacian") == "elastic") {
        data_->body.reset(new Foam::m4gnElasticBody(*data_->mesh, own, kinds.types()));
    }
}

const m4gn_mesh_data* m4gn::FoamCase::mesh() const { return &data_->nodes->data(); }

const m4gn_solid* m4gn::FoamCase::body() const { return data_->body ? &data_->body->data() : nullptr; }
