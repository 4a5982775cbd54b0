// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnSolidLaw.H"
#include "OSspecific.H"
#include "Time.H"
#include <dlfcn.h>

namespace Foam
{
defineTypeNameAndDebug(m4gnSolidLaw, 0);
defineRunTimeSelectionTable(m4gnSolidLaw, mesh);
}

namespace
{
//- The name in the table, and what adds it
const char* const kind = "solids4foam";
const char* const library = "libm4gnSolids4Foam.so";

//- Load the library, from beside this one. Why it could not be; empty: it is
Foam::string load()
{
    Foam::fileName path(library);

    Dl_info self;
    if (::dladdr(reinterpret_cast<const void*>(&load), &self) && self.dli_fname) {
        path = Foam::fileName(self.dli_fname).path() / library;
    }

    std::string why;
    if (!Foam::isFile(path, false)) {
        return "there is no " + path;
    }
    Foam::dlOpen(path, why);
    return why;
}

} // End anonymous namespace

Foam::wordList Foam::m4gnSolidLaw::fields()
{
    return wordList(
        {"sigma", "grad(D)", "grad(DD)", "DD", "pointD", "pointDD", "F", "Finv", "J", "relF", "relFinv",
         "relJ", "rho", "epsilon_", "F_", "Ff_", "sigmaHyd", "grad(sigmaHyd)"});
}

Foam::autoPtr<Foam::m4gnSolidLaw> Foam::m4gnSolidLaw::New(const fvMesh& mesh, string* told)
{
    static bool notice = false;

    autoPtr<m4gnSolidLaw> law;
    string why;

    if (!meshConstructorTablePtr_ || !meshConstructorTablePtr_->found(kind)) {
        why = load();
    }
    if (why.empty() && meshConstructorTablePtr_) {
        const auto found = meshConstructorTablePtr_->cfind(kind);
        if (found.found()) {
            law = found.val()(mesh);
            why = law->mismatch();
        }
    }
    if (!law && why.empty()) {
        why = word(library) + " has no law of solids4foam";
    }

    // The same on all ranks, whatever their machines have
    if (returnReduce(why.empty(), andOp<bool>())) {
        return law;
    }

    if (why.empty()) {
        why = "another rank cannot";
    }
    if (told) {
        *told = why;
    } else if (!notice) {
        Info << "m4gn: solids4foam's material law is not asked: " << why.c_str() << nl
             << "    Stresses at the surrogate's times stay those of the solver's"
             << " last step, and boundary values are extrapolated. To build what"
             << " asks it: setup/solids4foam.sh, or openfoam/solids4foam" << endl;
        notice = true;
    }

    return autoPtr<m4gnSolidLaw>();
}
