// SPDX-License-Identifier: GPL-3.0-or-later
// A completion of another library: fields as predicted, the flux left as it is, with an entry of its own, "share".

#include "m4gnCompletionType.H"

namespace Foam
{

class bareFlowCompletion : public m4gnCompletion
{
    const scalar share_;

public:
    static const char* const needs;

    static wordList keys() { return wordList({"share"}); }

    static bool applies(const fvMesh& mesh, const dictionary&)
    {
        return mesh.foundObject<volVectorField>("U");
    }

    bareFlowCompletion(const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
        : m4gnCompletion(mesh, session), share_(dict.getOrDefault<scalar>("share", 1))
    {}

    virtual void advance(const m4gnState& predicted, const scalar) { predicted.impose(); }

    virtual void complete(const scalar, const bool) {}

    virtual List<quantity> quantities() const { return {quantity("share", share_)}; }
};

const char* const bareFlowCompletion::needs = "a velocity U";

} // End namespace Foam

addM4gnCompletion(bareFlowCompletion, bareFlow)
