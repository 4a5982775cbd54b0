#!/usr/bin/env bash
# A scalar that the solver transports itself: buoyantBoussinesqPimpleFoam with U, p_rgh and T observed and replaced by a
# graph convolutional network, on one rank and on two; p and the density follow from p_rgh and T.
# scalar.safetensors has random weights, as `random_model FILE 1 scalar` makes them, and normalisers near this case.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# A channel of 1 x 0.3 m, flow from left to right, its lower wall heated; g points down
mkdir -p case/0 case/constant case/system && cd case
control_dict buoyantBoussinesqPimpleFoam 0.06 0.002 adjustableRunTime 0.01 12
schemes 'div(phi,U) Gauss upwind; div(phi,T) Gauss upwind;'
solvers 1e-12 0
{ header g uniformDimensionedVectorField; echo 'dimensions [0 1 -2 0 0 0 0]; value (0 -9.81 0);'; } > constant/g
{ header turbulenceProperties; echo 'simulationType laminar;'; } > constant/turbulenceProperties
{ header transportProperties; echo 'transportModel Newtonian; nu 1e-3; beta 3e-3; TRef 300; Pr 0.7; Prt 0.9;'; } \
    > constant/transportProperties

sides='frontAndBack { type empty; }'
field U volVectorField '0 1 -1 0 0 0 0' '(1 0 0)' "left { type fixedValue; value uniform (1 0 0); } right { type zeroGradient; }
    \"bottom|top\" { type noSlip; } $sides"
field p_rgh volScalarField '0 2 -2 0 0 0 0' 0 "right { type fixedValue; value uniform 0; }
    \"left|bottom|top\" { type fixedFluxPressure; value uniform 0; } $sides"
field T volScalarField '0 0 0 1 0 0 0' 300 "left { type fixedValue; value uniform 300; } bottom { type fixedValue; value uniform 310; }
    \"right|top\" { type zeroGradient; } $sides"
field alphat volScalarField '0 2 -1 0 0 0 0' 0 "\"left|right|bottom|top\" { type calculated; value uniform 0; } $sides"
block '1 0.3 0.1' '20 6 1' 'left { type patch; faces (LEFT); } right { type patch; faces (RIGHT); } bottom { type wall; faces (BOTTOM); }
    top { type wall; faces (TOP); } frontAndBack { type empty; faces (BACK FRONT); }'

good="model \"$M4GN_HOME/tests/e2e/scalar.safetensors\"; p p_rgh; timeStart 0.02;"

# Beside the solver: an error of each of the three
ride "$good mode observe;"
table=postProcessing/test/0/surrogateError.dat
for name in U p_rgh T; do
    grep -q "hold($name)" $table || { cat $table; fail "observe does not report $name"; }
done
[ "$(grep -vc '^#' $table)" -eq 4 ] || { cat $table; fail "expected four rows"; }

# In its place, between 0.03 and 0.05; p is what p_rgh and T make of it, within the digits that are written
follows() {
    for name in U p_rgh T p; do
        ! grep -q 'not advanced by the surrogate' "$1/$name" || fail "$1/$name is of an earlier time"
    done
    below "$(paste <(values "$1/p") <(values "$1/p_rgh") <(values "$1/T") | awk '
        { y = 0.05*(int((NR - 1)/20) + 0.5); e = $1 - $2 + 9.81*y*(1 - 3e-3*($3 - 300)); if (e < 0) e = -e; if (e > m) m = e }
        END { if (NR != 120) m = 1e9; print m }')" 1e-8 "p - p_rgh - rhok gh"
}
ride "$good mode replace; solverSteps 5; surrogateSteps 2;"
jumped + 2
expect_log '^End'
follows 0.04
[ "$(difference 0.03/T 0.04/T)" != 0 ] || fail "T stood still in the jump"
[ -f 0.06/T ] || fail "the solver did not carry on"
same_on_two_ranks 1e-4 0.04/{U,p_rgh,T}
follows 0.04
