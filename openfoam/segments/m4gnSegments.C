// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSegments.H"
#include "addToRunTimeSelectionTable.H"
#include "m4gnDictionary.H"
#include "m4gnSegmentField.H"
#include "mathematicalConstants.H"

namespace Foam
{
namespace functionObjects
{
defineTypeNameAndDebug(m4gnSegments, 0);
addToRunTimeSelectionTable(functionObject, m4gnSegments, dictionary);
}
}

Foam::word Foam::functionObjects::m4gnSegments::instance() const
{
    // A run's start; in post-processing startFrom latestTime may be later than
    // the time that was asked for
    return postProcess ? time_.timeName() : Time::timeName(time_.startTime().value());
}

template <class Type>
void Foam::functionObjects::m4gnSegments::writeMode(const label modei, const tmp<Field<Type>>& cells) const
{
    auto tfield = m4gn::cellField<Type>(mesh_, "m4gnMode" + Foam::name(modei + 1), instance());
    tfield.ref().primitiveFieldRef() = cells;
    tfield.ref().correctBoundaryConditions();
    m4gn::writeToInstance(tfield());
}

Foam::functionObjects::m4gnSegments::m4gnSegments(
    const word& name, const Time& runTime, const dictionary& dict)
    : fvMeshFunctionObject(name, runTime, dict), dict_(), segmentation_(), written_(false)
{
    read(dict);
}

bool Foam::functionObjects::m4gnSegments::read(const dictionary& dict)
{
    fvMeshFunctionObject::read(dict);

    m4gn::checkKeys(dict, {"segments", "modes", "recompute", "nodeTypes", "D"}, true);
    m4gn::checkDictionaries(dict, {"nodeTypes", "segments"});

    m4gnSegmentation::checkDictionary(dict.subOrEmptyDict("segments"));
    dict.getOrDefault<bool>("modes", true);
    dict.getOrDefault<bool>("recompute", false);

    dict_ = dict;

    return true;
}

bool Foam::functionObjects::m4gnSegments::execute()
{
    if (segmentation_) {
        return true;
    }

    dictionary own(dict_.subOrEmptyDict("segments"));
    for (const word key : {"nodeTypes", "D"}) {
        if (const entry* e = dict_.findEntry(key)) {
            own.add(*e);
        }
    }

    segmentation_.reset(new m4gnSegmentation(
        mesh_, own, dict_.getOrDefault<bool>("modes", true), dict_.getOrDefault<bool>("recompute", false)));

    if (const m4gnElasticModes* modes = segmentation_->elastic()) {
        forAll(modes->eigenvalues(), modei) {
            const scalar eigenvalue = modes->eigenvalues()[modei];

            Log << "m4gn: eigenvalue " << modei + 1 << " = " << m4gn::text(eigenvalue).c_str() << " 1/s^2, "
                << Foam::sqrt(max(eigenvalue, scalar(0))) / constant::mathematical::twoPi << " Hz" << endl;
        }
        return true;
    }

    scalarField cells;
    for (label modei = 0; modei < segmentation_->nModes(); ++modei) {
        const scalar eigenvalue = segmentation_->mode(modei, cells);

        Log << "m4gn: eigenvalue " << modei + 1 << " = " << m4gn::text(eigenvalue).c_str() << " 1/m^2"
            << endl;
    }

    return true;
}

bool Foam::functionObjects::m4gnSegments::write()
{
    if (!segmentation_ || written_) {
        return true;
    }
    written_ = true;

    segmentation_->store(instance());

    if (const m4gnElasticModes* modes = segmentation_->elastic()) {
        for (label modei = 0; modei < modes->size(); ++modei) {
            writeMode<vector>(modei, modes->mode(modei));
        }
        return true;
    }

    scalarField cells;
    for (label modei = 0; modei < segmentation_->nModes(); ++modei) {
        segmentation_->mode(modei, cells);
        writeMode<scalar>(modei, cells);
    }

    return true;
}
