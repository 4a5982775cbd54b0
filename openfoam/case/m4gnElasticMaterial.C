// SPDX-License-Identifier: GPL-3.0-or-later

#include "m4gnElasticBody.H"
#include "m4gnDictionary.H"
#include "m4gnMechanicalProperties.H"

void Foam::m4gnElasticBody::setUniform(const dictionary& material)
{
    scalar E = 0;
    scalar nu = 0;
    scalar rho = 0;

    if (!m4gnMechanicalProperties::moduli(material, E, nu, rho)) {
        FatalErrorInFunction << material.name()
                             << ": the material of the elastic body is not known: expected E, nu"
                             << " and rho (or mu, K and rho), each a number, found "
                             << m4gn::join(material.toc()) << exit(FatalError);
    }

    E_ = E;
    nu_ = nu;
    rho_ = rho;
}

void Foam::m4gnElasticBody::setMaterials(const m4gnMechanicalProperties& properties)
{
    const PtrList<entry> materials(properties.materials());

    labelList count(mesh_.nCells(), Zero);

    for (const entry& material : materials) {
        scalar E = 0, nu = 0, rho = 0;
        m4gnMechanicalProperties::moduli(material.dict(), E, nu, rho);

        const label zonei = mesh_.cellZones().findZoneID(material.keyword());

        if (materials.size() > 1 && zonei < 0) {
            FatalErrorInFunction << "The material " << material.keyword() << " of "
                                 << m4gnMechanicalProperties::fileName
                                 << " has no cellZone of its name: found "
                                 << m4gn::join(mesh_.cellZones().names()) << exit(FatalError);
        }

        const labelList cells(
            materials.size() > 1 ? labelList(mesh_.cellZones()[zonei]) : identity(mesh_.nCells()));

        for (const label celli : cells) {
            E_[celli] = E;
            nu_[celli] = nu;
            rho_[celli] = rho;
            ++count[celli];
        }
    }

    forAll(count, celli) {
        if (count[celli] != 1) {
            FatalErrorInFunction << "Cell " << celli << " at " << mesh_.C()[celli] << " has " << count[celli]
                                 << " materials of " << m4gnMechanicalProperties::fileName
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

    const string why(unknown(mesh_, dict));
    if (why.size()) {
        FatalErrorInFunction << "The material of the elastic body is not known: " << why.c_str() << nl
                             << "    Give the function object's dictionary"
                             << " material { E ...; nu ...; rho ...; }, or operator laplacian"
                             << exit(FatalError);
    }

    const m4gnMechanicalProperties properties(mesh_);
    bool planeStress = properties.found() && properties.dict().getOrDefault<bool>("planeStress", false);

    if (dict.found("material")) {
        const dictionary& own = dict.subDict("material");
        m4gn::checkKeys(own, {"E", "nu", "mu", "K", "rho", "planeStress"}, false);
        setUniform(own);
        planeStress = own.getOrDefault<bool>("planeStress", planeStress);
    } else if (properties.registered()) {
        E_ = mesh_.lookupObject<volScalarField>("E").primitiveField();
        nu_ = mesh_.lookupObject<volScalarField>("nu").primitiveField();
        rho_ = mesh_.lookupObject<volScalarField>("rho").primitiveField();
    } else if (properties.listed()) {
        setMaterials(properties);
    } else {
        setUniform(properties.dict());
    }

    data_.young = E_.cdata();
    data_.poisson = nu_.cdata();
    data_.density = rho_.cdata();
    data_.plane_stress = planeStress;
}

Foam::string Foam::m4gnElasticBody::unknown(const fvMesh& mesh, const dictionary& dict)
{
    const m4gnMechanicalProperties properties(mesh);

    if (dict.found("material") || properties.registered()) {
        return string();
    }
    if (!properties.listed()) {
        return properties.uniform() ? string()
                                    : string(
                                        "expected E, nu and rho as registered fields or in constant/"
                                        + m4gnMechanicalProperties::fileName + ", found "
                                        + (properties.found() ? "there " + m4gn::join(properties.dict().toc())
                                                              : std::string("no such file")));
    }
    const PtrList<entry> materials(properties.materials());
    for (const entry& material : materials) {
        scalar E, nu, rho;
        if (!material.isDict() || !m4gnMechanicalProperties::moduli(material.dict(), E, nu, rho)) {
            return "material " + material.keyword() + " of " + m4gnMechanicalProperties::fileName
                   + " has neither E and nu nor mu and K with rho, each a number";
        }
    }
    return materials.size()
               ? string()
               : string("the list mechanical of " + m4gnMechanicalProperties::fileName + " is empty");
}
