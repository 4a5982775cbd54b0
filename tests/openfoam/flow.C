// SPDX-License-Identifier: GPL-3.0-or-later

#include "testing.H"
#include "m4gnCaseChecks.H"
#include "m4gnFluxProjection.H"
#include "m4gnHandOver.H"
#include "m4gnCompletion.H"
#include "cloud.H"
#include "fvcDiv.H"
#include "IOMRFZoneList.H"
#include "OSspecific.H"
#include "surfaceFields.H"
#include "volFields.H"

using testing::caseFolder;
using testing::dict;

namespace
{
//- Velocity, pressure and flux in a block of squares of 1 m, which a flow of
//  1 m/s enters at the left and leaves at the right
struct channel
{
    caseFolder run;
    autoPtr<fvMesh> mesh;
    autoPtr<volVectorField> U;
    autoPtr<volScalarField> p;
    autoPtr<surfaceScalarField> phi;

    channel(const label nx, const label ny, const word& outlet)
        : mesh(
            run.block({nx, ny, 1}, vector(nx, ny, 1), {"patch", "patch", "wall", "wall", "empty", "empty"}))
    {
        const wordList walls({"slip", "slip", "empty", "empty"});
        wordList ofU({"fixedValue", outlet == "fixedValue" ? "zeroGradient" : "fixedValue"});
        ofU.append(walls);
        wordList ofP({"zeroGradient", outlet, "zeroGradient", "zeroGradient", "empty", "empty"});
        U.reset(new volVectorField(io("U"), *mesh, dimensionedVector(dimVelocity, Zero), ofU));
        p.reset(new volScalarField(io("p"), *mesh, dimensionedScalar(sqr(dimVelocity), Zero), ofP));
        phi.reset(new surfaceScalarField(io("phi"), *mesh, dimensionedScalar(dimVolume / dimTime, Zero)));
        U->boundaryFieldRef()[0] == vector(1, 0, 0);
        if (U->boundaryField()[1].fixesValue()) {
            U->boundaryFieldRef()[1] == vector(1, 0, 0);
        }
    }

    IOobject io(const word& name) const { return IOobject(name, mesh->time().timeName(), *mesh); }

    //- Give the cells these velocities and hand over
    void handOver(const vectorField& cells, const dictionary& settings = dictionary())
    {
        U->primitiveFieldRef() = cells;
        U->correctBoundaryConditions();
        m4gnFluxProjection::interpolate(*U, *phi);
        m4gnFluxProjection(*mesh, settings).project(*p, *U, *phi, true);
    }
};
} // End anonymous namespace

TEST(theFluxOfAVelocity)
{
    channel c(3, 1, "fixedValue");
    c.U->primitiveFieldRef() = vectorField({vector(1, 0, 0), vector(3, 0, 0), vector(2, 0, 0)});
    c.U->correctBoundaryConditions();
    m4gnFluxProjection::interpolate(*c.U, *c.phi);

    EXPECT_NEAR(c.phi()[0], 2, 1e-14);
    EXPECT_NEAR(c.phi()[1], 2.5, 1e-14);
    EXPECT_NEAR(c.phi->boundaryField()[0][0], -1, 1e-14);
    EXPECT_NEAR(c.phi->boundaryField()[1][0], 2, 1e-14);
    // The first cell: in 1, out 2
    EXPECT_NEAR(m4gnCompletion::maxDiv(*c.phi), 1, 1e-14);
}

// What enters a channel of one row of cells goes through each of its faces
TEST(aRowOfCellsCarriesWhatEnters)
{
    channel c(4, 1, "fixedValue");
    c.handOver(vectorField({vector(2, 0, 0), vector(-1, 0, 0), vector(5, 0, 0), vector(0.5, 0, 0)}));

    EXPECT_NEAR(c.phi->boundaryField()[0][0], -1, 0);
    for (label facei = 0; facei < 3; ++facei) {
        EXPECT_NEAR(c.phi()[facei], 1, 1e-9);
    }
    EXPECT_NEAR(c.phi->boundaryField()[1][0], 1, 1e-9);
    EXPECT_NEAR(m4gnCompletion::maxDiv(*c.phi), 0, 1e-9);
}

TEST(aFluxWithoutDivergenceStays)
{
    channel c(4, 3, "fixedValue");
    c.handOver(vectorField(12, vector(1, 0, 0)));
    forAll(*c.phi, facei) {
        const bool along = mag(c.mesh->Sf()[facei].x()) > 0.5;
        EXPECT_NEAR(c.phi()[facei], along ? 1 : 0, 1e-12);
    }
    EXPECT_NEAR(c.U()[5], vector(1, 0, 0), 1e-12);
}

TEST(wallsStayTight)
{
    channel c(4, 3, "fixedValue");
    vectorField rough(12);
    forAll(rough, i) {
        rough[i] = vector(1 + 0.3 * Foam::sin(scalar(i)), 0.2 * Foam::cos(3.0 * i), 0);
    }
    c.handOver(rough);

    EXPECT_NEAR(m4gnCompletion::maxDiv(*c.phi), 0, 1e-8);
    EXPECT_NEAR(sum(mag(c.phi->boundaryField()[2])), 0, 0);
    EXPECT_NEAR(sum(mag(c.phi->boundaryField()[3])), 0, 0);
    EXPECT_NEAR(sum(c.phi->boundaryField()[1]), 3, 1e-8);
}

// Where the pressure is fixed nowhere, its level is not known, and the flux is adjusted to be balanced
TEST(aPressureWithoutALevel)
{
    channel c(4, 1, "zeroGradient");
    c.handOver(vectorField({vector(2, 0, 0), vector(0, 0, 0), vector(3, 0, 0), vector(1, 0, 0)}));
    for (label facei = 0; facei < 3; ++facei) {
        EXPECT_NEAR(c.phi()[facei], 1, 1e-9);
    }
    EXPECT_NEAR(m4gnCompletion::maxDiv(*c.phi), 0, 1e-9);
}

TEST(settingsOfTheProjectionAreChecked)
{
    channel c(2, 1, "fixedValue");
    EXPECT_REFUSED(m4gnFluxProjection(*c.mesh, dict("projection { every yes; }")), "Unknown entry every");
    EXPECT_REFUSED(m4gnFluxProjection(*c.mesh, dict("projection { tolerance 0; }")), "tolerance");
    EXPECT_REFUSED(m4gnFluxProjection(*c.mesh, dict("projection { nCorrectors -1; }")), "nCorrectors");
}

TEST(aFlowOfAConstantDensityIsHandedOver)
{
    channel c(2, 1, "fixedValue");
    EXPECT_TEXT(m4gn::notHandedOver(*c.mesh, "U", "p", "phi"), "");

    c.phi->dimensions().reset(dimMass / dimTime);
    EXPECT(m4gn::notHandedOver(*c.mesh, "U", "p", "phi").find("the flux phi") == 0);
    c.phi->dimensions().reset(dimVolume / dimTime);

    // interFoam
    c.p->dimensions().reset(dimPressure);
    EXPECT(m4gn::notHandedOver(*c.mesh, "U", "p", "phi").find("the pressure p is not divided") == 0);
}

TEST(particlesThatTheSolverMovesAreNotHandedOver)
{
    channel c(2, 1, "fixedValue");
    const cloud sparks(*c.mesh, "sparks");
    EXPECT_TEXT(m4gn::notHandedOver(*c.mesh, "U", "p", "phi"), "particles go with the flow (sparks)");
    EXPECT_TEXT(m4gn::unsupported(*c.mesh), "particles go with the flow (sparks)");

    // Those of a function object wait, or are moved in jumps, as executeOthers says
    const_cast<dictionary&>(c.run.time().controlDict())
        .set("functions", dict("drift { type icoUncoupledKinematicCloud; kinematicCloud sparks; }"));
    EXPECT_TEXT(m4gn::notHandedOver(*c.mesh, "U", "p", "phi"), "");
    EXPECT_TEXT(m4gn::unsupported(*c.mesh), "");
}

TEST(aComputedPressureIsNotHandedOver)
{
    channel c(2, 1, "fixedValue");
    c.p.clear();
    const wordList computed({"calculated", "calculated", "calculated", "calculated", "empty", "empty"});
    const dimensionedScalar zero(sqr(dimVelocity), Zero);
    const volScalarField p(c.io("p"), *c.mesh, zero, computed);
    EXPECT_TEXT(m4gn::notHandedOver(*c.mesh, "U", "p", "phi"), "");
    const volScalarField pRgh(c.io("p_rgh"), *c.mesh, zero, computed);
    EXPECT(m4gn::notHandedOver(*c.mesh, "U", "p", "phi").find("give p p_rgh;") != std::string::npos);
    EXPECT_TEXT(m4gn::notHandedOver(*c.mesh, "U", "p_rgh", "phi"), "");
}

TEST(sourcesAreNamed)
{
    channel c(2, 1, "fixedValue");
    EXPECT_TEXT(m4gn::sources(*c.mesh), "");
    const IOdictionary options(
        c.io("fvOptions"), dict("porosity { type explicitPorositySource; } off { active no; }"));
    EXPECT_TEXT(m4gn::sources(*c.mesh), "fvOptions porosity");
}

// As the solid beside its fluid, and as a material of a solid
TEST(meshesThatWouldStayBehindAreNamed)
{
    channel c(2, 1, "fixedValue");
    const auto beside = [&](const word& name) {
        const fvMesh other(
            IOobject(name, c.run.time().timeName(), c.run.time()), pointField(c.mesh->points()),
            faceList(c.mesh->faces()), labelList(c.mesh->faceOwner()), labelList(c.mesh->faceNeighbour()));
        return m4gn::otherMeshes(*c.mesh);
    };
    EXPECT(m4gn::otherMeshes(*c.mesh).empty());
    EXPECT(beside("solid") == wordList({"solid"}));
    EXPECT(beside("steelSubset").size() == 1);
}

// As solids4foam's vertex-centred models have it
TEST(aHistoryOnADualMeshIsNotHandedOver)
{
    channel c(2, 1, "fixedValue");
    const fvMesh dual(
        IOobject("dualMesh", c.run.time().timeName(), c.run.time()), pointField(c.mesh->points()),
        faceList(c.mesh->faces()), labelList(c.mesh->faceOwner()), labelList(c.mesh->faceNeighbour()));
    const auto unsupported = [&](const std::string& law) {
        const IOdictionary properties(
            c.io("mechanicalProperties"), dict("mechanical (steel { type " + law + "; });"));
        return m4gn::unsupported(*c.mesh);
    };
    EXPECT_TEXT(unsupported("linearElastic"), "");
    EXPECT(unsupported("linearElasticMisesPlastic").find("the history of linearElasticMisesPlastic") == 0);
}

// From 0 to 1 s
TEST(sourcesThatActForAPartOfARunAreNamed)
{
    channel c(2, 1, "fixedValue");
    const auto unsupported = [&](const std::string& limits) {
        const IOdictionary options(c.io("fvOptions"), dict("ignition { type x; " + limits + " }"));
        return m4gn::unsupported(*c.mesh);
    };
    EXPECT_TEXT(unsupported("timeStart 0; duration 1;"), "");
    EXPECT(unsupported("timeStart 0.5; duration 9;").find("the source ignition") == 0);
    EXPECT(unsupported("timeStart 0; duration 0.5;").find("the source ignition") == 0);
    EXPECT_TEXT(unsupported("timeStart 0; duration 0;"), "");
    EXPECT_TEXT(unsupported("timeStart 2; duration 1;"), "");
    c.run.time().stopAt(Time::stopAtControls::saNextWrite);
    EXPECT_TEXT(unsupported("timeStart 0; duration 1;"), "");
    EXPECT(unsupported("timeStart 0; duration 0.5;").find("the source ignition") == 0);

    const auto ignited = [&](const std::string& entries) {
        const IOdictionary combustion(
            c.io("combustionProperties"), dict(entries + " ignitionSites ({ start 0; duration 0.5; });"));
        return m4gn::unsupported(*c.mesh);
    };
    EXPECT(ignited("ignite yes;").find("one of the ignitionSites") == 0);
    EXPECT_TEXT(ignited("ignite no;"), "");
}

// A zone that turns about z at 2 rad/s: of a velocity that turns with it no flux is left
TEST(theFluxOfARotatingZoneIsRelativeToIt)
{
    channel c(3, 3, "fixedValue");
    c.mesh->cellZones().append(new cellZone("rotor", identity(9), 0, c.mesh->cellZones()));
    c.run.write(
        "constant/MRFProperties",
        "rotor { cellZone rotor; active yes; origin (0 0 0); axis (0 0 1); omega constant 2; }");
    const IOMRFZoneList zones(*c.mesh);
    EXPECT_TEXT(m4gn::sources(*c.mesh), "MRFProperties rotor");

    c.U->primitiveFieldRef() = vector(0, 0, 2) ^ c.mesh->C().primitiveField();
    m4gnFluxProjection::interpolate(*c.U, *c.phi);
    forAll(*c.phi, facei) {
        EXPECT_NEAR(c.phi()[facei], 0, 1e-12);
    }
}

TEST(tablesOverTimeAreToldFromOthers)
{
    channel c(2, 1, "fixedValue");
    const auto changing = [&](const std::string& source) {
        const IOdictionary options(c.io("fvOptions"), dict("heat { " + source + " }"));
        return m4gn::changingSources(*c.mesh);
    };
    EXPECT_TEXT(changing("type scalarSemiImplicitSource; rate table ((0 1) (1 2));"), "heat of fvOptions");
    EXPECT_TEXT(changing("type jouleHeatingSource; sigma table ((300 1) (400 2));"), "");
}

TEST(aSunThatGoesRoundIsNamed)
{
    channel c(2, 1, "fixedValue");
    const auto changing = [&](const std::string& model) {
        const IOdictionary radiation(
            c.io("radiationProperties"),
            dict("fvDOMCoeffs { solarLoadCoeffs { sunDirectionModel " + model + "; } }"));
        return m4gn::changingSources(*c.mesh);
    };
    EXPECT_TEXT(changing("sunDirConstant"), "");
    EXPECT_TEXT(changing("sunDirTracking"), "fvDOMCoeffs of radiationProperties");
}

// As solids4foam moves them
TEST(cellsThatAreMovedOverTimeAreNamed)
{
    channel c(2, 1, "fixedValue");
    const Time& time = c.run.time();
    const IOdictionary solid(IOobject("solidModel_" + c.mesh->name(), time.constant(), time), dict(""));
    const auto changing = [&](const std::string& displacement) {
        const IOdictionary properties(
            IOobject("solidProperties", time.constant(), time),
            dict("solidModel a; aCoeffs { cellDisplacements { tip { " + displacement + " } } }"));
        return m4gn::changingSources(*c.mesh);
    };
    EXPECT_TEXT(changing("displacement (0 0 0);"), "");
    EXPECT_TEXT(
        changing("timeVaryingDisplacement { file path; outOfBounds clamp; }"),
        "cellDisplacements of solidProperties");
}

// The fluid's mesh moves beside a body whose own mesh follows it
TEST(aMeshFollowsTheBodyThatIsOnIt)
{
    channel c(2, 1, "fixedValue");
    const Time& time = c.run.time();
    const IOdictionary properties(
        IOobject("solidProperties", time.constant(), time),
        dict("solidModel unsNonLinearGeometryUpdatedLagrangian;"));
    EXPECT(!m4gn::meshFollowsBody(*c.mesh));
    const IOdictionary solid(IOobject("solidModel_" + c.mesh->name(), time.constant(), time), dict(""));
    EXPECT(m4gn::meshFollowsBody(*c.mesh));
}
