// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnRelaxation.H"
#include "m4gnDictionary.H"
#include "Time.H"
#include "volFields.H"

namespace
{
const Foam::word entryName("relaxation");

//- Implicit steps: the order in (omega h)^2 to which slow modes stay
const Foam::label nSteps = 3;

//- The time that the dictionary asks for, 0 for none, else as given (s).
//  FatalIOError if the entry is not valid.
Foam::scalar timeOf(const Foam::dictionary& dict, const Foam::scalar usual)
{
    if (Foam::m4gn::isNone(dict, entryName, "relaxation { time 0.02; tolerance 1e-5; }")) {
        return 0;
    }
    if (!dict.found(entryName)) {
        return usual;
    }

    const Foam::dictionary& own = dict.subDict(entryName);
    Foam::m4gn::checkKeys(own, {"time", "tolerance"}, false);

    for (const Foam::word& name : {Foam::word("time"), Foam::word("tolerance")}) {
        if (own.found(name) && !(own.get<Foam::scalar>(name) > 0)) {
            FatalIOErrorInFunction(own) << "Entry " << name << " of " << own.dictName() << " is "
                                        << own.get<Foam::scalar>(name) << "; expected more than 0" << Foam::nl
                                        << "    To hand over what was predicted: " << entryName << " none;"
                                        << Foam::exit(Foam::FatalIOError);
        }
    }

    return own.getOrDefault<Foam::scalar>("time", usual);
}

} // End anonymous namespace

Foam::vectorField Foam::m4gnRelaxation::read(const word& name) const
{
    IOobject file(name, mesh_.time().timeName(), mesh_, IOobject::MUST_READ, IOobject::NO_WRITE, false);
    return file.typeHeaderOk<volVectorField>(true) ? vectorField(volVectorField(file, mesh_).primitiveField())
                                                   : vectorField();
}

void Foam::m4gnRelaxation::write(
    const word& name, const dimensionSet& dimensions, const vectorField& values) const
{
    const IOobject file(name, mesh_.time().timeName(), mesh_, IOobject::NO_READ, IOobject::NO_WRITE, false);
    volVectorField field(file, mesh_, dimensionedVector(dimensions, Zero));
    field.primitiveFieldRef() = values;
    field.write();
}

Foam::m4gnRelaxation::m4gnRelaxation(const fvMesh& mesh, const dictionary& dict, const scalar stride)
    : mesh_(mesh), time_(timeOf(dict, 0.5 * stride)),
      tolerance_(time_ > 0 ? dict.subOrEmptyDict(entryName).getOrDefault<scalar>("tolerance", 1e-5) : 0),
      relaxedAt_(-VGREAT), lastTime_(-VGREAT), warning_(false)
{
    if (active()) {
        predictedD_ = read("surrogateD");
        if (returnReduce(predictedD_.size(), sumOp<label>())) {
            relaxedAt_ = lastTime_ = mesh.time().value();
            predictedRate_ = read("surrogateRate");
            lastAcceleration_ = read("relaxedAcceleration");
        }
    }
}

Foam::autoPtr<Foam::m4gnRelaxation> Foam::m4gnRelaxation::New(
    const fvMesh& mesh, const dictionary& dict, const scalar stride, const autoPtr<m4gnSolidLaw>& law,
    const bool dynamic)
{
    if (!law) {
        return nullptr;
    }
    const string why(
        dynamic ? law->cannotRelax() : string("the case is quasi-static; needed: d2dt2Schemes Euler"));
    if (why.empty()) {
        return autoPtr<m4gnRelaxation>(new m4gnRelaxation(mesh, dict, stride));
    }
    if (dict.isDict(entryName)) {
        FatalIOErrorInFunction(dict) << "Entry relaxation of " << dict.dictName()
                                     << " cannot be followed: " << why.c_str() << nl << "    Remove the entry"
                                     << exit(FatalIOError);
    }

    return nullptr;
}

void Foam::m4gnRelaxation::checkDictionary(const dictionary& dict) { timeOf(dict, 1); }

bool Foam::m4gnRelaxation::relaxed() const { return relaxedAt_ == mesh_.time().value(); }

bool Foam::m4gnRelaxation::relax(m4gnSolidLaw& law, vectorField& D, vectorField& rate, const scalar deltaT)
{
    if (relaxed()) {
        return true;
    }

    const vectorField predicted(D);
    vectorField free(predicted);
    bool done = true;
    for (label i = 0; done && i < nSteps; ++i) {
        if (i) {
            free -= D - predicted;
        }
        done = law.relax(free, time_, tolerance_);
    }
    if (!done) {
        D = predicted;
        lastD_.clear();
        if (!warning_) {
            warning_ = true;
            WarningInFunction << "The displacement of the surrogate could not be relaxed at"
                              << " time " << mesh_.time().timeName() << ": such states are"
                              << " handed over as predicted" << nl
                              << "    Give it another time, or a larger tolerance (relaxation"
                              << " { time ...; tolerance ...; }), or have relaxation none;" << endl;
        }
        return false;
    }

    const scalar now = mesh_.time().value();
    relaxedAt_ = now;
    predictedD_ = predicted;
    predictedRate_ = rate;
    const vectorField relaxedAcceleration((D - free) / sqr(time_));

    const scalar between = now - lastTime_;
    if (lastD_.size() && between > 0) {
        rate = (D - lastD_) / between + between * (relaxedAcceleration / 3 + lastAcceleration_ / 6)
               - 0.5 * deltaT * relaxedAcceleration;
    }

    lastD_ = D;
    lastAcceleration_ = relaxedAcceleration;
    lastTime_ = now;

    return true;
}

bool Foam::m4gnRelaxation::restore(vectorField& D, vectorField& rate)
{
    if (!relaxed()) {
        return false;
    }
    if (!lastD_.size()) {
        // Of a run that is carried on
        lastD_ = D;
    }

    D = predictedD_;
    rate = predictedRate_;
    relaxedAt_ = -VGREAT;

    return true;
}

void Foam::m4gnRelaxation::end()
{
    relaxedAt_ = -VGREAT;
    lastD_.clear();
}

void Foam::m4gnRelaxation::write() const
{
    if (!relaxed()) {
        return;
    }

    write("surrogateD", dimLength, predictedD_);
    write("surrogateRate", dimVelocity, predictedRate_);
    write("relaxedAcceleration", dimAcceleration, lastAcceleration_);
}
