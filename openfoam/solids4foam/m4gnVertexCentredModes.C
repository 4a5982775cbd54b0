// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnVertexCentredModes.H"
#include "addToRunTimeSelectionTable.H"
#include "fixedValuePointPatchFields.H"
#include "lookupSolidModel.H"
#include "m4gnCore.H"
#include "m4gnDictionary.H"
#include "m4gnRun.H"
#include "OFstream.H"
#include "OSspecific.H"
#include "sparseMatrix.H"
#include "vfvmCellPoint.H"
#include <cmath>
#include <memory>

namespace Foam
{
namespace functionObjects
{
    defineTypeNameAndDebug(m4gnVertexCentredModes, 0);
    addToRunTimeSelectionTable(functionObject, m4gnVertexCentredModes, dictionary);
}
}

namespace
{
using namespace Foam;

//- Rows of the points that are not held, negative of solids4foam's matrix
struct csr
{
    std::vector<int64_t> start;
    std::vector<int64_t> columns;
    std::vector<double> values;

    csr(const sparseMatrix& matrix, const labelList& rowOf, const label n)
    :
        start(3*n + 1, 0)
    {
        typedef std::pair<label, tensor> block;
        std::vector<std::vector<block>> rows(n);

        forAllConstIters(matrix.data(), iter)
        {
            const label row = rowOf[iter.key()[0]];
            const label column = rowOf[iter.key()[1]];
            if (row >= 0 && column >= 0)
            {
                rows[row].push_back(block(column, -iter.val()));
            }
        }

        for (label i = 0; i < 3*n; ++i)
        {
            for (const block& b : rows[i/3])
            {
                for (label j = 0; j < 3; ++j)
                {
                    columns.push_back(3*b.first + j);
                    values.push_back(b.second[3*(i % 3) + j]);
                }
            }
            start[i + 1] = columns.size();
        }
    }

    m4gn_csr view() const
    {
        return
        {
            int32_t(start.size() - 1),
            start.data(),
            columns.data(),
            values.data()
        };
    }
};

} // End anonymous namespace

Foam::labelList Foam::functionObjects::m4gnVertexCentredModes::rows() const
{
    const auto& D = mesh_.lookupObject<pointVectorField>(dict_.getOrDefault<word>("D", "pointD"));

    labelList row(mesh_.nPoints(), 0);
    for (const pointPatchVectorField& patch : D.boundaryField())
    {
        if (isA<fixedValuePointPatchVectorField>(patch))
        {
            for (const label pointi : patch.patch().meshPoints())
            {
                row[pointi] = -1;
            }
        }
        else if (patch.constraintType() != word::null)
        {
            FatalErrorInFunction
                << "Patch " << patch.patch().name() << " is of type "
                << patch.type() << "; the modes of a vertex-centred model are"
                << " for patches that fix all of the displacement or nothing,"
                << " in serial" << exit(FatalError);
        }
    }

    label n = 0;
    for (label& r : row)
    {
        if (r == 0)
        {
            r = n++;
        }
    }

    return row;
}

std::string Foam::functionObjects::m4gnVertexCentredModes::options(const dictionary& dict)
{
    dictionary settings(m4gn::without(dict, m4gn::commonKeys()));
    settings = m4gn::without(settings, {"zeta", "D"});
    settings.set("symmetric", word("no"));
    settings.set("block", 3);
    return m4gn::json(settings);
}

Foam::functionObjects::m4gnVertexCentredModes::m4gnVertexCentredModes
(
    const word& name,
    const Time& runTime,
    const dictionary& dict
)
:
    fvMeshFunctionObject(name, runTime, dict),
    done_(false)
{
    read(dict);
}

bool Foam::functionObjects::m4gnVertexCentredModes::read(const dictionary& dict)
{
    fvMeshFunctionObject::read(dict);

    m4gn::checkOptions(dict, "modes", options(dict), {"zeta", "D"});

    dict_ = dict;

    return true;
}

bool Foam::functionObjects::m4gnVertexCentredModes::execute()
{
    if (done_)
    {
        return true;
    }
    done_ = true;

    m4gn::checkAbi();

    const solidModel& solid = lookupSolidModel(mesh_);

    if (solid.mechanical().PtrList<mechanicalLaw>::size() != 1)
    {
        FatalErrorInFunction
            << "mechanicalProperties has "
            << solid.mechanical().PtrList<mechanicalLaw>::size()
            << " materials; the modes of a vertex-centred model are for one"
            << exit(FatalError);
    }

    const labelList rowOf(rows());
    const label n = max(rowOf) + 1;

    const dictionary& coeffs = solid.solidModelDict();
    const scalar zeta = dict_.getOrDefault<scalar>
    (
        "zeta",
        coeffs.getOrDefault<scalar>("zetaImplicit", coeffs.getOrDefault<scalar>("zeta", 0))
    );

    const fvMesh& dual = solid.dualMesh();
    const labelList& pointOf = solid.dualMeshMap().dualCellToPoint();

    const Field<scalarSquareMatrix> tangent
    (
        dual.nFaces(),
        static_cast<const PtrList<mechanicalLaw>&>(solid.mechanical())[0]
       .materialTangent()
    );

    sparseMatrix stiffness(27*mesh_.nPoints());
    vfvm::divSigma
    (
        stiffness,
        mesh_,
        dual,
        solid.dualMeshMap().dualFaceToCell(),
        pointOf,
        tangent,
        zeta
    );

    scalarField volume(mesh_.nPoints(), Zero);
    forAll(pointOf, dualCelli)
    {
        volume[pointOf[dualCelli]] = dual.V()[dualCelli];
    }
    scalarField density(mesh_.nPoints(), Zero);
    forAll(mesh_.pointCells(), pointi)
    {
        const labelList& cells = mesh_.pointCells()[pointi];
        for (const label celli : cells)
        {
            density[pointi] += solid.rho()[celli]/cells.size();
        }
    }

    // With a unit time step, the diagonal of Euler's scheme is the mass
    sparseMatrix mass(mesh_.nPoints());
    ITstream scheme("d2dt2", tokenList(1, token(word("Euler"))));
    vfvm::d2dt2(scheme, 1, "pointD", mass, density, volume, 0);

    const csr K(stiffness, rowOf, n);
    const csr M(mass, rowOf, n);

    std::vector<vector> positions(n);
    forAll(rowOf, pointi)
    {
        if (rowOf[pointi] >= 0)
        {
            positions[rowOf[pointi]] = mesh_.points()[pointi];
        }
    }

    const std::string settings(options(dict_));

    const m4gn_csr viewK = K.view();
    const m4gn_csr viewM = M.view();
    m4gn_modes* modes = nullptr;
    m4gn::check
    (
        m4gn_modes_new
        (
            m4gn::communicator(),
            &viewK,
            &viewM,
            settings.c_str(),
            reinterpret_cast<const double*>(positions.data()),
            &modes
        ),
        "m4gnVertexCentredModes cannot find the modes"
    );
    const std::unique_ptr<m4gn_modes, void(*)(m4gn_modes*)> owned(modes, m4gn_modes_free);

    const label count = m4gn_modes_count(modes);
    scalarField eigenvalues(count);
    m4gn::check(m4gn_modes_eigenvalues(modes, eigenvalues.data()), "m4gnVertexCentredModes");

    const fileName dir(m4gn::outputDir(name(), mesh_));
    mkDir(dir);
    OFstream os(dir/"frequencies.dat");
    os  << "# mode\tfrequency(Hz)" << nl;

    for (label i = 0; i < count; ++i)
    {
        const scalar frequency =
            Foam::sqrt(max(eigenvalues[i], scalar(0)))
           /constant::mathematical::twoPi;

        Log << type() << ' ' << name() << ": mode " << i + 1 << ", "
            << frequency << " Hz" << endl;
        os  << i + 1 << tab << frequency << nl;

        std::vector<vector> shape(n);
        m4gn::check
        (
            m4gn_modes_vector(modes, i, reinterpret_cast<double*>(shape.data())),
            "m4gnVertexCentredModes"
        );

        pointVectorField field
        (
            IOobject
            (
                "m4gnMode" + Foam::name(i + 1),
                time_.timeName(),
                mesh_,
                IOobject::NO_READ,
                IOobject::NO_WRITE,
                false
            ),
            pointMesh::New(mesh_),
            dimensionedVector(dimless, Zero)
        );
        forAll(rowOf, pointi)
        {
            if (rowOf[pointi] >= 0)
            {
                field[pointi] = shape[rowOf[pointi]];
            }
        }
        field.write();
    }
    Log << endl;

    return true;
}

bool Foam::functionObjects::m4gnVertexCentredModes::write()
{
    return true;
}
