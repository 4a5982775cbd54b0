#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd) and heat: a cavity between a warm and a cold wall on its way to rest, with a density that varies
# (buoyantPimpleFoam) and with Boussinesq's (buoyantBoussinesqPimpleFoam), and a plate that cools (laplacianFoam). The pressure p_rgh is found,
# enthalpy, density and compressibility go with the temperature, and so does the heat that goes through the walls.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
mkdir -p case/{0,constant,system} && cd case
control_dict laplacianFoam 24 0.05 adjustableRunTime 12 12
schemes 'div(phi,K) Gauss linear;'
{ header fvSolution; cat <<'EOD'; } > system/fvSolution
solvers
{
    "rho.*" { solver diagonal; }
    "p_rgh.*" { solver PCG; preconditioner DIC; tolerance 1e-10; relTol 0.01; }
    "(U|h|T|DT).*" { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-10; relTol 0; }
}
PIMPLE { momentumPredictor yes; nOuterCorrectors 1; nCorrectors 2; nNonOrthogonalCorrectors 0; pRefCell 0; pRefValue 0; }
SIMPLE { nNonOrthogonalCorrectors 0; }
EOD
{ header g uniformDimensionedVectorField; echo 'dimensions [0 1 -2 0 0 0 0]; value (0 -9.81 0);'; } > constant/g
{ header turbulenceProperties; echo 'simulationType laminar;'; } > constant/turbulenceProperties
{ header thermophysicalProperties; cat <<'EOD'; } > constant/thermophysicalProperties
thermoType { type heRhoThermo; mixture pureMixture; transport const; thermo hConst; equationOfState perfectGas; specie specie; energy sensibleEnthalpy; }
mixture { specie { molWeight 28.9; } thermodynamics { Cp 1000; Hf 0; } transport { mu 1.8e-05; Pr 0.7; } }
EOD
{ header transportProperties
  echo 'transportModel Newtonian; nu 1.5e-5; beta 3.3e-3; TRef 300; Pr 0.7; Prt 0.85; DT DT [0 2 -1 0 0 0 0] 2e-5;'; } > constant/transportProperties
# field NAME CLASS DIMENSIONS VALUE PATCHES
field() {
    { header "$1" "$2"; echo "dimensions [$3]; internalField uniform $4; boundaryField { $5 frontAndBack { type empty; } }"; } > "0/$1"
}
field U volVectorField '0 1 -1 0 0 0 0' '(0 0 0)' '".*" { type noSlip; }'
field T volScalarField '0 0 0 1 0 0 0' 300 'warm { type fixedValue; value uniform 302; } cold { type fixedValue; value uniform 298; }
    floor { type zeroGradient; }'
field alphat volScalarField '0 2 -1 0 0 0 0' 0 '".*" { type calculated; value uniform 0; }'
: > system/functions
block '0.05 0.05 0.01' '16 16 1' 'warm { type wall; faces (LEFT); } cold { type wall; faces (RIGHT); }
    floor { type wall; faces (BOTTOM TOP); } frontAndBack { type empty; faces (BACK FRONT); }'

# compared SOLVER FIELDS: the hybrid run beside the plain one
compared() {
    local solver=$1 name
    shift
    echo "${heat:-}" > system/functions
    clean_case
    runs "$solver"
    rm -rf ../plain && mkdir ../plain && mv 12 24 ../plain
    if [ -n "${heat:-}" ]; then mv postProcessing ../plain; fi
    echo "${heat:-} test { type m4gnSurrogate; libs (m4gnFoam); mode replace; surrogates (dmd); dmd { snapshotInterval 0.25; minSnapshots 24; fitTolerance 0.025; } }" > system/functions
    runs "$solver"
    replaces 0.1 "$solver"
    for name in "$@"; do
        # Over the largest value; the temperature's is 302 K, and it varies by 4
        below "$(difference ../plain/24/"$name" 24/"$name")" "$([ "$name" = T ] && echo 2.6e-4 || echo 0.02)" "$solver: largest error of $name"
    done
}

compared laplacianFoam T

field p_rgh volScalarField '0 2 -2 0 0 0 0' 0 '".*" { type fixedFluxPressure; value uniform 0; }'
compared buoyantBoussinesqPimpleFoam T U
grep -q '^m4gn: the dmd surrogate advances T, U, alphat, p_rgh, phi and, with them, .*rhok' log.run || fail "p_rgh is not found"

sed -i 's/pRefValue 0/pRefValue 1e5/' system/fvSolution
field alphat volScalarField '1 -1 -1 0 0 0 0' 0 '".*" { type calculated; value uniform 0; }'
field p volScalarField '1 -1 -2 0 0 0 0' 1e5 '".*" { type calculated; value uniform 1e5; }'
field p_rgh volScalarField '1 -1 -2 0 0 0 0' 1e5 '".*" { type fixedFluxPressure; value uniform 1e5; }'
heat='heat { type wallHeatFlux; libs (fieldFunctionObjects); patches (warm cold); writeControl timeStep; writeInterval 1; }'
compared buoyantPimpleFoam T U
grep -q '^m4gn: the dmd surrogate advances .*p_rgh, phi and, with them, .*h, rho, .*thermo:psi' log.run || fail "enthalpy and density are not handed over"
flux() { awk '/^[0-9]/ && $1 == 24 && $2 == "warm" { v = $NF } END { print v }' "$1"; }
plain=$(flux ../plain/postProcessing/heat/0/wallHeatFlux.dat)
hybrid=$(flux postProcessing/heat/0/wallHeatFlux.dat)
below "$(awk "BEGIN { d = ($hybrid)/($plain) - 1; print d < 0 ? -d : d }")" 0.03 "heat through the warm wall, $plain W/m2, is off by"
