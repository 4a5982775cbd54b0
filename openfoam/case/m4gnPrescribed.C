// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnPrescribed.H"
#include "m4gnFatalError.H"
#include "fixedValueFvPatchFields.H"
#include "pointFields.H"
#include "StringStream.H"
#include "Time.H"
#include "valuePointPatchField.H"

namespace
{
using namespace Foam;

//- Kinds of Foam::Function1 and Foam::PatchFunction1 that are not constant
bool isFunction(const word& name)
{
    static const wordHashSet names(
        {"coded", "cosine", "csvFile", "expression", "functionObjectValue", "halfCosineRamp", "linearRamp",
         "mappedFile", "polynomial", "quadraticRamp", "quarterCosineRamp", "quarterSineRamp", "sample",
         "scale", "sine", "square", "step", "table", "tableFile"});
    return names.found(name);
}

//- By chance: a random number for each time
bool isRandom(const word& type)
{
    static const wordHashSet names(
        {"turbulentInlet", "turbulentDFSEMInlet", "turbulentDigitalFilterInlet",
         "atmosphericTurbulentInlet"});
    return names.found(type);
}

//- Is the value or the gradient prescribed in time?
template <class Patch> bool changes(const Patch& patch)
{
    // Functions of a place or of a flow rate
    static const wordHashSet others({"fan", "fanPressure", "fixedProfile", "swirlInletVelocity"});
    if (others.found(patch.type())) {
        return false;
    }
    // Of solids4foam: by a rate, by a frequency, and by a table that is not written
    static const wordHashSet unwritten({"fixedTemperature", "linearDisplacement", "oscillateDisplacement"});
    if (unwritten.found(patch.type())) {
        return true;
    }
    for (const char* of : {"coded", "expr", "groovy", "oscillating", "timeVarying"}) {
        if (patch.type().starts_with(of)) {
            return true;
        }
    }
    OStringStream os;
    patch.write(os);
    IStringStream is(os.str());
    dictionary dict(is);
    dict.remove("value");
    return m4gnPrescribed::hasFunction(dict);
}

template <class Patch> void refuse(const word& name, const Patch& patch)
{
    FatalErrorInFunction << "Nobody can say beforehand what the condition " << patch.type() << " of " << name
                         << " at the patch " << patch.patch().name() << " will be at a later time" << nl
                         << "    Expected fixed values, or conditions that do not change by themselves"
                         << exit(FatalError);
}

} // End anonymous namespace

bool Foam::m4gnPrescribed::hasFunction(const dictionary& dict)
{
    for (const entry& e : dict) {
        if (e.isDict()) {
            // The tables of solids4foam have no kind, and each an end
            if (e.dict().found("outOfBounds") || hasFunction(e.dict())) {
                return true;
            }
        } else if (
            e.stream().size() && e.stream().first().isWord() && isFunction(e.stream().first().wordToken())) {
            return true;
        }
    }
    return false;
}

template <class Type>
void Foam::m4gnPrescribed::find(const word& name, DynamicList<Tuple2<word, label>>& found) const
{
    const auto* field = mesh_.findObject<GeometricField<Type, fvPatchField, volMesh>>(name);

    // The processors' patches are not those of all ranks
    for (label patchi = 0; field && patchi < mesh_.boundaryMesh().nNonProcessor(); ++patchi) {
        const fvPatchField<Type>& patch = field->boundaryField()[patchi];
        const bool random = isRandom(patch.type());

        if (random || changes(patch)) {
            // The displacement of a velocity is that of the step before and more
            if (random || patch.type() == "solidVelocity" || !isA<fixedValueFvPatchField<Type>>(patch)) {
                refuse(name, patch);
            }
            found.append({name, patchi});
        }
    }
}

template <class Type> void Foam::m4gnPrescribed::say(const label i, const scalar later)
{
    typedef GeometricField<Type, fvPatchField, volMesh> fieldType;

    if (!mesh_.foundObject<fieldType>(found_[i].first())) {
        return;
    }
    const fieldType& field = mesh_.lookupObject<fieldType>(found_[i].first());
    const label patchi = found_[i].second();
    const fvPatchField<Type>& patch = field.boundaryField()[patchi];
    // Of the increment of a displacement, solids4foam's conditions prescribe what it leads to
    const auto* sum = field.name() == "DD" ? mesh_.findObject<fieldType>("D") : nullptr;
    Field<Type> faceValues(sum ? sum->boundaryField()[patchi] : patch);

    if (later > 0) {
        // Conditions of solids4foam say what their points will be as well
        typedef valuePointPatchField<vector> pointValues;
        const auto* points = mesh_.findObject<pointVectorField>("point" + field.name());
        const auto* held = points ? isA<pointValues>(points->boundaryField()[patchi]) : nullptr;
        const vectorField pointsNow(held ? vectorField(*held) : vectorField());

        Time& time = const_cast<Time&>(mesh_.time());
        const scalar now = time.value();
        const auto evaluate = [&](const scalar then) {
            time.setTime(then, time.timeIndex());
            tmp<fvPatchField<Type>> copy(patch.clone(patch.internalField()));
            copy.ref().evaluate();
            faceValues = copy();
        };
        // A table (outOfBounds error) need not go on behind the end of the run
        string why;
        if (m4gn::fails([&]() { evaluate(now + later); }, why)) {
            evaluate(min(now + later, time.endTime().value()));
        }
        if (sum) {
            faceValues += sum->oldTime().boundaryField()[patchi];
        }
        time.setTime(now, time.timeIndex());
        if (held) {
            const_cast<pointValues&>(*held) == pointsNow;
        }
    }

    const auto* from = reinterpret_cast<const scalar*>(faceValues.cdata());
    values_[i].resize(faceValues.size() * pTraits<Type>::nComponents);
    std::copy(from, from + values_[i].size(), values_[i].begin());
}

Foam::m4gnPrescribed::m4gnPrescribed(const fvMesh& mesh, const wordList& fields) : mesh_(mesh)
{
    DynamicList<Tuple2<word, label>> found;
    for (const word& name : fields) {
        find<scalar>(name, found);
        find<vector>(name, found);
        if (const auto* points = mesh_.findObject<pointVectorField>(name)) {
            for (const pointPatchVectorField& patch : points->boundaryField()) {
                if (changes(patch)) {
                    refuse(name, patch);
                }
            }
        }
    }
    found_ = found;
    values_.resize(found_.size());
    say(0);
}

Foam::string Foam::m4gnPrescribed::name(const label i) const
{
    return found_[i].first() + " at " + mesh_.boundary()[found_[i].second()].name();
}

void Foam::m4gnPrescribed::say(const scalar later)
{
    forAll(found_, i) {
        say<scalar>(i, later);
        say<vector>(i, later);
    }
}
