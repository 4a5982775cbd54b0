// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnElasticModes.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnElasticBody.H"
#include "m4gnNodeTypes.H"
#include "Time.H"
#include "m4gnClock.H"
#include <memory>

namespace Foam
{
static word displacementOf(const dictionary& dict) { return dict.getOrDefault<word>("D", "D"); }

//- The entry that the library takes
static dictionary solverEntries(const dictionary& dict)
{
    dictionary own;
    if (const entry* e = dict.findEntry("modalSolver")) {
        own.add(*e);
    }
    return own;
}

} // End namespace Foam

Foam::m4gnElasticModes::m4gnElasticModes(const fvMesh& mesh, const dictionary& dict, const label nModes)
    : mesh_(mesh), eigenvalues_(), cells_()
{
    m4gnClock timer;

    m4gn::endWith(mesh.time());

    const word DName(displacementOf(dict));
    const string found(m4gnElasticBody::describe(mesh, DName));

    if (found != m4gnElasticBody::displacement()) {
        FatalErrorInFunction << "Modes of the elastic body need its displacement " << DName << ": expected a "
                             << m4gnElasticBody::displacement().c_str() << ", found "
                             << (found.empty() ? "no such field" : found.c_str()) << nl
                             << "    Give its name as D, or operator laplacian" << exit(FatalError);
    }

    const m4gnNodeTypes nodeTypes(mesh, dict, "U", "p", DName);
    const m4gnElasticBody body(mesh, dict, nodeTypes.types());

    if (!returnReduce(body.data().n_fixed > 0, orOp<bool>()) && !body.data().free_body) {
        FatalErrorInFunction << "Nothing holds the elastic body: expected a patch where " << DName
                             << " fixes its value (node type handle) or a symmetry"
                             << " plane, found" << nl;
        for (const fvPatch& patch : mesh.boundary()) {
            if (m4gnNodeTypes::carriesValues(patch)) {
                FatalError << "        " << patch.name() << ": "
                           << m4gnNodeTypes::names[nodeTypes.types()[patch.index()]] << nl;
            }
        }
        FatalError << "    Give nodeTypes { <patch> handle; }, freeBody yes, or"
                   << " operator laplacian" << exit(FatalError);
    }

    dictionary asked(solverEntries(dict));
    if (nModes >= 0) {
        // Segments of elastic modes need one at least
        asked.set("modes", Foam::max(nModes, label(1)));
    }
    const std::string options(m4gn::json(asked));

    m4gn_modes* raw = nullptr;
    m4gn::check(
        m4gn_solid_modes_new(m4gn::communicator(), &body.data(), options.c_str(), &raw),
        "Modes of the elastic body cannot be computed"
        " (operator laplacian does without)");
    const std::unique_ptr<m4gn_modes, void (*)(m4gn_modes*)> modes(raw, m4gn_modes_free);

    const label n = m4gn_modes_n_modes(raw);
    eigenvalues_.resize(n);
    m4gn::check(m4gn_modes_eigenvalues(raw, eigenvalues_.data()), "m4gn");

    const labelListList& cellPoints = mesh.cellPoints();
    const label nCells = mesh.nCells();
    vectorField points(mesh.nPoints());
    cells_.resize(n * nCells);

    for (label modei = 0; modei < n; ++modei) {
        m4gn::check(m4gn_modes_vector(raw, modei, reinterpret_cast<double*>(points.data())), "m4gn");
        forAll(cellPoints, celli) {
            vector sum(Zero);
            for (const label pointi : cellPoints[celli]) {
                sum += points[pointi];
            }
            cells_[modei * nCells + celli] = sum / cellPoints[celli].size();
        }
    }

    Info << "m4gn: " << n << " modes of the elastic body in " << timer.elapsed() << " s" << endl;
}

Foam::wordList Foam::m4gnElasticModes::keys() { return {"operator", "material", "freeBody", "modalSolver"}; }

void Foam::m4gnElasticModes::checkDictionary(const dictionary& dict)
{
    if (dict.found("material") && !dict.isDict("material")) {
        FatalIOErrorInFunction(dict) << "Entry material is no dictionary; expected"
                                     << " material { E 1e6; nu 0.3; rho 1000; }" << exit(FatalIOError);
    }
    dict.getOrDefault<bool>("freeBody", false);

    dictionary own(solverEntries(dict));
    if (const entry* e = dict.findEntry("operator")) {
        own.add(*e);
    }
    m4gn::checkOptions(dict, "segments", "{\"segments\": " + m4gn::json(own) + '}', keys());
}

bool Foam::m4gnElasticModes::wanted(const fvMesh& mesh, const dictionary& dict, const label needed)
{
    if (dict.found("operator")) {
        return dict.get<word>("operator") == "elastic";
    }
    if (needed >= 0) {
        return needed > 0;
    }

    // Dictionaries may be read by all ranks together. A rank without cells may
    // be without fields.
    const string unknown(m4gnElasticBody::unknown(mesh, dict));
    const bool moves =
        m4gnElasticBody::describe(mesh, displacementOf(dict)) == m4gnElasticBody::displacement();

    if (!returnReduce(moves, orOp<bool>())) {
        return false;
    }
    if (returnReduce(unknown.empty(), andOp<bool>())) {
        return true;
    }

    Info << "m4gn: no modes of the elastic body, whose material is not known: " << unknown.c_str() << nl
         << "    Segments are then made of the Laplacian's modes. For those of the"
         << " body give the function object's dictionary" << nl << "    material { E ...; nu ...; rho ...; }"
         << nl << endl;

    return false;
}
