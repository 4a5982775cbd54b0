#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd) and heat: a cavity between a warm and a cold wall on its way to rest, with a density that varies
# (buoyantPimpleFoam) and with Boussinesq's (buoyantBoussinesqPimpleFoam), and a plate that cools (laplacianFoam). The pressure p_rgh is found,
# enthalpy, density and compressibility go with the temperature, and so does the heat that goes through the walls.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
mkdir -p case/{0,constant,system} && cd case
control_dict laplacianFoam 24 0.05 adjustableRunTime 12 12
schemes 'div(phi,K) Gauss linear;'
solvers 1e-10 0.01
{ header g uniformDimensionedVectorField; echo 'dimensions [0 1 -2 0 0 0 0]; value (0 -9.81 0);'; } > constant/g
{ header turbulenceProperties; echo 'simulationType laminar;'; } > constant/turbulenceProperties
{ header thermophysicalProperties; cat <<'EOD'; } > constant/thermophysicalProperties
thermoType { type heRhoThermo; mixture pureMixture; transport const; thermo hConst; equationOfState perfectGas; specie specie; energy sensibleEnthalpy; }
mixture { specie { molWeight 28.9; } thermodynamics { Cp 1000; Hf 0; } transport { mu 1.8e-05; Pr 0.7; } }
EOD
{ header transportProperties
  echo 'transportModel Newtonian; nu 1.5e-5; beta 3.3e-3; TRef 300; Pr 0.7; Prt 0.85; DT DT [0 2 -1 0 0 0 0] 2e-5;'; } > constant/transportProperties
field U volVectorField '0 1 -1 0 0 0 0' '(0 0 0)' '".*" { type noSlip; } frontAndBack { type empty; }'
field T volScalarField '0 0 0 1 0 0 0' 300 'warm { type fixedValue; value uniform 302; } cold { type fixedValue; value uniform 298; }
    floor { type zeroGradient; } frontAndBack { type empty; }'
field alphat volScalarField '0 2 -1 0 0 0 0' 0 '".*" { type calculated; value uniform 0; } frontAndBack { type empty; }'
block '0.05 0.05 0.01' '16 16 1' 'warm { type wall; faces (LEFT); } cold { type wall; faces (RIGHT); }
    floor { type wall; faces (BOTTOM TOP); } frontAndBack { type empty; faces (BACK FRONT); }'

# compared SOLVER: the hybrid run beside the plain one
compared() {
    control application "$1"
    plain 12 24
    [ ! -d postProcessing ] || keep plain 12 24 postProcessing
    ride 'mode replace; surrogates (dmd); dmd { snapshotInterval 0.25; minSnapshots 24; fitTolerance 0.025; }'
    replaces 0.1 "$1"
    # The temperature's largest value is 302 K, and it varies by 4
    close_to ../plain 2.6e-4 24/T
}

compared laplacianFoam

# It does not heed adjustTimeStep: times to write are those of its own steps, in jumps as well
control writeInterval 1.13 deltaT '0.05; adjustTimeStep yes'
clean_case
: > system/functions
solve
plain=$(times)
ride 'mode replace; surrogates (dmd); dmd { snapshotInterval 0.25; minSnapshots 24; fitTolerance 0.025; }'
replaces 0.1 'laplacianFoam with adjustTimeStep'
[ "$(times)" = "$plain" ] || fail "times $(times), expected $plain"
control writeInterval 12
sed -i 's/ adjustTimeStep yes;//' system/controlDict

field p_rgh volScalarField '0 2 -2 0 0 0 0' 0 '".*" { type fixedFluxPressure; value uniform 0; } frontAndBack { type empty; }'
compared buoyantBoussinesqPimpleFoam
close_to ../plain 0.02 24/U
expect_log '^m4gn: the dmd surrogate advances T, U, alphat, p_rgh, phi and, with them, .*rhok'

sed -i 's/pRefValue 0/pRefValue 1e5/' system/fvSolution
field alphat volScalarField '1 -1 -1 0 0 0 0' 0 '".*" { type calculated; value uniform 0; } frontAndBack { type empty; }'
field p volScalarField '1 -1 -2 0 0 0 0' 1e5 '".*" { type calculated; value uniform 1e5; } frontAndBack { type empty; }'
field p_rgh volScalarField '1 -1 -2 0 0 0 0' 1e5 '".*" { type fixedFluxPressure; value uniform 1e5; } frontAndBack { type empty; }'
beside='heat { type wallHeatFlux; libs (fieldFunctionObjects); patches (warm cold); writeControl timeStep; writeInterval 1; }'
compared buoyantPimpleFoam
close_to ../plain 0.02 24/U
expect_log '^m4gn: the dmd surrogate advances .*p_rgh, phi and, with them, .*h, rho, .*thermo:psi'
flux() { awk '/^[0-9]/ && $1 == 24 && $2 == "warm" { v = $NF } END { print v }' "$1"; }
plain=$(flux ../plain/postProcessing/heat/0/wallHeatFlux.dat)
hybrid=$(flux postProcessing/heat/0/wallHeatFlux.dat)
below "$(off "$hybrid" "$plain")" 0.03 "heat through the warm wall, $plain W/m2, is off by"

# A solver of regions, of which the case has one
clean_case
mkdir {0,constant,system}/air
mv 0/{T,U,alphat,p,p_rgh} 0/air
mv constant/{polyMesh,thermophysicalProperties,turbulenceProperties} constant/air
cp system/fv* system/air
{ header regionProperties; echo 'regions (fluid (air) solid ());'; } > constant/regionProperties
control application chtMultiRegionFoam
: > system/functions
m4gn check . --seconds 1000 > ../log.check 2>&1 || { cat ../log.check; fail 'm4gn check of a region'; }
expect_in ../log.check '^dmd: fits'
refused 'is a case of regions' m4gn verify .
