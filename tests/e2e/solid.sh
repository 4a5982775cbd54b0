#!/usr/bin/env bash
# solidDisplacementFoam: its own recorded states, handed back after a jump, are carried on from as in the run without one.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_oracle

# A beam of 0.4 x 0.05 m, clamped at its left, loaded at its tip at time 0. One period is some 0.5 s.
mkdir -p case/0 case/constant case/system && cd case
header() { echo "FoamFile { version 2.0; format ascii; class ${2:-dictionary}; object $1; }"; }
{ header blockMeshDict; cat <<'EOD'; } > system/blockMeshDict
vertices ((0 0 0) (0.4 0 0) (0.4 0.05 0) (0 0.05 0) (0 0 0.01) (0.4 0 0.01) (0.4 0.05 0.01) (0 0.05 0.01));
blocks (hex (0 1 2 3 4 5 6 7) (24 4 1) simpleGrading (1 1 1));
boundary
(
    clamp { type patch; faces ((0 4 7 3)); }
    tip { type patch; faces ((1 2 6 5)); }
    sides { type wall; faces ((0 1 5 4) (3 7 6 2)); }
    frontAndBack { type empty; faces ((0 3 2 1) (4 5 6 7)); }
);
EOD
{ header controlDict; cat <<'EOD'; } > system/controlDict
application     solidDisplacementFoam;
startFrom       startTime;
startTime       0;
stopAt          endTime;
endTime         0.255;
deltaT          0.005;
writeControl    timeStep;
writeInterval   1;
writeFormat     ascii;
writePrecision  14;
timePrecision   8;
runTimeModifiable no;
functions       { #include "functions" }
EOD
{ header fvSchemes; cat <<'EOD'; } > system/fvSchemes
d2dt2Schemes { default Euler; }
ddtSchemes { default Euler; }
gradSchemes { default leastSquares; grad(D) leastSquares; }
divSchemes { default none; div(sigmaD) Gauss linear; }
laplacianSchemes { default none; laplacian(DD,D) Gauss linear corrected; laplacian(m4gn) Gauss linear corrected; }
interpolationSchemes { default linear; }
snGradSchemes { default none; }
EOD
{ header fvSolution; cat <<'EOD'; } > system/fvSolution
solvers { "(D|T)" { solver GAMG; tolerance 1e-12; relTol 0.01; smoother GaussSeidel; nCellsInCoarsestLevel 20; } }
stressAnalysis { compactNormalStress yes; }
EOD
{ header mechanicalProperties
  echo 'rho { type uniform; value 1000; } nu { type uniform; value 0.3; } E { type uniform; value 1e6; } planeStress yes;'
} > constant/mechanicalProperties
{ header thermalProperties
  echo 'C { type uniform; value 434; } k { type uniform; value 60.5; } alpha { type uniform; value 1.1e-05; } thermalStress no;'
} > constant/thermalProperties
{ header D volVectorField; cat <<'EOD'; } > 0/D
dimensions [0 1 0 0 0 0 0];
internalField uniform (0 0 0);
boundaryField
{
    clamp { type fixedValue; value uniform (0 0 0); }
    tip { type tractionDisplacement; traction uniform (0 50 0); pressure uniform 0; value uniform (0 0 0); }
    sides { type tractionDisplacement; traction uniform (0 0 0); pressure uniform 0; value uniform (0 0 0); }
    frontAndBack { type empty; }
}
EOD
: > system/functions
runs blockMesh

export ORACLE_STRIDE=0.025 ORACLE_FRAMES=5
# The other form of the normal stress stalls at residuals of some 1e-6
while read -r compact tolerance limit; do
    sed -i "s/compactNormalStress.*;/compactNormalStress $compact; nCorrectors 500; D $tolerance;/" system/fvSolution
    clean_case
    function_object m4gnHarvest 'fields (D ddt(D)); writeControl timeStep; writeInterval 1;'
    runs solidDisplacementFoam
    rm -rf ../full && mkdir ../full && mv 0.* ../full

    # The solver to 0.1, the surrogate to 0.15, the solver to 0.2, the surrogate to 0.25
    clean_case
    function_object m4gnSurrogate 'mode replace; model any; timeStart 0.1; solverSteps 10; surrogateSteps 2;'
    : > any
    runs solidDisplacementFoam
    [ "$(grep -c '^m4gn: jumped 2 steps' log.run)" -eq 2 ] || fail "expected two jumps of two steps"
    [ ! -d 0.13 ] && [ -d 0.15 ] || fail "expected the surrogate's times 0.125 and 0.15, found: $(echo 0.1*)"
    for time in 0.155 0.175 0.2 0.255; do
        below "$(difference ../full/$time/D $time/D)" $limit "compactNormalStress $compact, D at $time after the recorded state"
    done
done <<'EOD'
yes 1e-8 1e-5
no 2e-5 1e-3
EOD

# Without its rate, D is half of the state
function_object m4gnHarvest 'fields (D); writeControl timeStep; writeInterval 1;'
runs solidDisplacementFoam
function_object m4gnSurrogate 'mode replace; model any; timeStart 0.1; solverSteps 10; surrogateSteps 2;'
refused 'carries on from D, ddt(D)' solidDisplacementFoam

# Another solver's D
function_object m4gnSurrogate 'mode replace; model any; state totalDisplacement; timeStart 0.1; solverSteps 10; surrogateSteps 2;'
refused 'solidProperties with solidModel' solidDisplacementFoam
echo "solid: passed"
