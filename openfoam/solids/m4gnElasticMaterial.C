/*---------------------------------------------------------------------------*\
    m4gn: M4GN surrogates inside OpenFOAM
-------------------------------------------------------------------------------
License
    SPDX-License-Identifier: GPL-3.0-or-later

\*---------------------------------------------------------------------------*/

#include "m4gnElasticBody.H"
#include "m4gnDictionary.H"
#include "IOdictionary.H"
#include "PtrList.H"
#include "Time.H"
#include "dictionaryEntry.H"

// * * * * * * * * * * * * * * * Local Functions * * * * * * * * * * * * * * //

namespace Foam
{

static const word propertiesName("mechanicalProperties");

//- As registered, or as stored; null: there is none
static autoPtr<dictionary> readProperties(const fvMesh& mesh)
{
    for (const objectRegistry* registry : {&mesh.thisDb(), &mesh.time().db()})
    {
        const auto* registered =
            registry->findObject<IOdictionary>(propertiesName);

        if (registered)
        {
            return autoPtr<dictionary>(new dictionary(*registered));
        }
    }

    IOobject io
    (
        propertiesName,
        mesh.time().constant(),
        mesh,
        IOobject::MUST_READ,
        IOobject::NO_WRITE,
        false
    );

    return
        io.typeHeaderOk<IOdictionary>(true)
      ? autoPtr<dictionary>(new dictionary(IOdictionary(io)))
      : autoPtr<dictionary>();
}


//- The last number of an entry: "2e11", "[1 -1 -2 0 0 0 0] 2e11" or
//  "E [1 -1 -2 0 0 0 0] 2e11", or the value of a dictionary; false if there is
//  none, as of the list that materials with several relaxation times have
static bool number(const dictionary& dict, const word& key, scalar& value)
{
    if (dict.isDict(key))
    {
        return number(dict.subDict(key), "value", value);
    }
    if (!dict.found(key))
    {
        return false;
    }

    const ITstream& stream = dict.lookup(key);

    if (stream.empty() || !stream.last().isNumber())
    {
        return false;
    }

    value = stream.last().number();
    return true;
}


//- Do E, nu and rho stand there as solidDisplacementFoam has them?
static bool uniformProperties(const dictionary& dict)
{
    for (const word key : {"E", "nu", "rho"})
    {
        scalar value;
        if
        (
            !dict.isDict(key)
         || dict.subDict(key).getOrDefault<word>("type", "uniform") != "uniform"
         || !number(dict, key, value)
        )
        {
            return false;
        }
    }

    return true;
}


//- E, nu and rho; false if the material does not have them
static bool moduli
(
    const dictionary& dict,
    scalar& E,
    scalar& nu,
    scalar& rho
)
{
    if (!number(dict, "rho", rho))
    {
        return false;
    }
    if (number(dict, "E", E) && number(dict, "nu", nu))
    {
        return true;
    }

    scalar mu, K;
    if (number(dict, "mu", mu) && number(dict, "K", K))
    {
        E = 9*K*mu/(3*K + mu);
        nu = (3*K - 2*mu)/(2*(3*K + mu));
        return true;
    }

    return false;
}


static bool registeredFields(const fvMesh& mesh)
{
    for (const word key : {"E", "nu", "rho"})
    {
        if (!mesh.foundObject<volScalarField>(key))
        {
            return false;
        }
    }

    return
        mesh.lookupObject<volScalarField>("E").dimensions() == dimPressure
     && mesh.lookupObject<volScalarField>("rho").dimensions() == dimDensity;
}


//- The materials of solids4foam's list
static PtrList<entry> materialsOf(const dictionary& properties)
{
    return PtrList<entry>(properties.lookup("mechanical"));
}

} // End namespace Foam


// * * * * * * * * * * * * * Private Member Functions  * * * * * * * * * * * //

void Foam::m4gnElasticBody::setUniform(const dictionary& material)
{
    scalar E = 0;
    scalar nu = 0;
    scalar rho = 0;

    if (!moduli(material, E, nu, rho))
    {
        FatalErrorInFunction
            << material.name() << ": the material of the elastic body is not known: expected E, nu"
            << " and rho (or mu, K and rho), each a number, found "
            << m4gn::join(material.toc()) << exit(FatalError);
    }

    E_ = E;
    nu_ = nu;
    rho_ = rho;
}


void Foam::m4gnElasticBody::setMaterials(const dictionary& properties)
{
    const PtrList<entry> materials(materialsOf(properties));

    labelList count(mesh_.nCells(), Zero);

    for (const entry& material : materials)
    {
        const dictionary& dict = material.dict();
        scalar E = 0;
        scalar nu = 0;
        scalar rho = 0;

        if (!moduli(dict, E, nu, rho))
        {
            FatalErrorInFunction
                << "The material " << material.keyword() << " of "
                << propertiesName << " has neither E and nu nor mu and K"
                << " with rho, each a number: "
                << m4gn::join(dict.toc()) << nl
                << "    Give the function object's dictionary"
                << " material { E ...; nu ...; rho ...; }, or operator"
                << " laplacian" << exit(FatalError);
        }

        const label zonei = mesh_.cellZones().findZoneID(material.keyword());

        if (materials.size() > 1 && zonei < 0)
        {
            FatalErrorInFunction
                << "The material " << material.keyword() << " of "
                << propertiesName << " has no cellZone of its name: found "
                << m4gn::join(mesh_.cellZones().names()) << exit(FatalError);
        }

        const labelList cells
        (
            materials.size() > 1
          ? labelList(mesh_.cellZones()[zonei])
          : identity(mesh_.nCells())
        );

        for (const label celli : cells)
        {
            E_[celli] = E;
            nu_[celli] = nu;
            rho_[celli] = rho;
            ++count[celli];
        }
    }

    forAll(count, celli)
    {
        if (count[celli] != 1)
        {
            FatalErrorInFunction
                << "Cell " << celli << " at " << mesh_.C()[celli] << " has "
                << count[celli] << " materials of " << propertiesName
                << "; expected one: each cell in one of the materials'"
                << " cellZones" << exit(FatalError);
        }
    }
}


void Foam::m4gnElasticBody::setMaterial(const dictionary& dict)
{
    const label n = mesh_.nCells();
    E_.resize(n);
    nu_.resize(n);
    rho_.resize(n);

    const autoPtr<dictionary> properties(readProperties(mesh_));
    bool planeStress =
        properties && properties->getOrDefault<bool>("planeStress", false);

    if (dict.found("material"))
    {
        const dictionary& own = dict.subDict("material");
        m4gn::checkKeys
        (
            own, {"E", "nu", "mu", "K", "rho", "planeStress"}, false
        );
        setUniform(own);
        planeStress = own.getOrDefault<bool>("planeStress", planeStress);
    }
    else if (registeredFields(mesh_))
    {
        E_ = mesh_.lookupObject<volScalarField>("E").primitiveField();
        nu_ = mesh_.lookupObject<volScalarField>("nu").primitiveField();
        rho_ = mesh_.lookupObject<volScalarField>("rho").primitiveField();
    }
    else if (properties && properties->found("mechanical"))
    {
        setMaterials(*properties);
    }
    else if (properties && uniformProperties(*properties))
    {
        setUniform(*properties);
    }
    else
    {
        FatalErrorInFunction
            << "The material of the elastic body is not known: expected E, nu"
            << " and rho as registered fields or in constant/"
            << propertiesName << ", found "
            << word
               (
                   properties
                 ? "there " + m4gn::join(properties->toc())
                 : word("no such file", false),
                   false
               )
            << nl
            << "    Give the function object's dictionary"
            << " material { E ...; nu ...; rho ...; }, or operator laplacian"
            << exit(FatalError);
    }

    data_.young = E_.cdata();
    data_.poisson = nu_.cdata();
    data_.density = rho_.cdata();
    data_.plane_stress = planeStress;
}


// * * * * * * * * * * * * * * * Member Functions  * * * * * * * * * * * * * //

Foam::string Foam::m4gnElasticBody::unknown
(
    const fvMesh& mesh,
    const dictionary& dict
)
{
    if (dict.found("material") || registeredFields(mesh))
    {
        return string();
    }

    const autoPtr<dictionary> properties(readProperties(mesh));

    if (!properties)
    {
        return "there is no constant/" + propertiesName;
    }
    if (!properties->found("mechanical"))
    {
        return
            uniformProperties(*properties)
          ? string()
          : string(propertiesName + " has no uniform E, nu and rho");
    }

    const PtrList<entry> materials(materialsOf(*properties));
    for (const entry& material : materials)
    {
        scalar E, nu, rho;
        if (!material.isDict() || !moduli(material.dict(), E, nu, rho))
        {
            return
                "material " + material.keyword() + " of " + propertiesName
              + " has neither E and nu nor mu and K with rho, each a number";
        }
    }

    return
        materials.size()
      ? string()
      : string("the list mechanical of " + propertiesName + " is empty");
}


// ************************************************************************* //
