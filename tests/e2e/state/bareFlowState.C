// SPDX-License-Identifier: GPL-3.0-or-later
// A solver state of another library: fields as predicted, the flux left as it is, with an entry of its own, "share".

#include "m4gnDictionary.H"
#include "m4gnModelState.H"
#include "m4gnSolverStateType.H"

namespace Foam
{

class bareFlowState : public m4gnModelState
{
    const scalar share_;

public:
    static const char* const needs;
    static const bool atPoints = false;

    static wordList keys() { return wordList({"share"}); }

    static bool applies(const fvMesh& mesh, const dictionary&)
    {
        return mesh.foundObject<volVectorField>("U");
    }

    bareFlowState(const fvMesh& mesh, const dictionary& dict, const m4gnSession& session)
        : m4gnModelState(mesh, dict, session), share_(dict.getOrDefault<scalar>("share", 1))
    {}

    virtual void advance(const List<scalarField>& predicted, const scalar duration)
    {
        step(duration);
        forAll(predicted, outputi) {
            impose(outputi, predicted[outputi]);
        }
    }

    virtual void complete(const scalar, const bool) {}

    virtual List<quantity> quantities() const { return {quantity("share", share_)}; }
};

const char* const bareFlowState::needs = "a velocity U";

} // End namespace Foam

addM4gnSolverState(bareFlowState, bareFlow)
