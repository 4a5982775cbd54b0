#!/usr/bin/env bash
# solidDisplacementFoam: its own recorded states, handed back after a jump, are carried on from as in the run without one.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_oracle

make_beam case

export ORACLE_STRIDE=0.025 ORACLE_FRAMES=5
# The other form of the normal stress stalls at residuals of some 1e-6
while read -r compact tolerance limit; do
    sed -i "s/compactNormalStress.*;/compactNormalStress $compact; nCorrectors 500; D $tolerance;/" system/fvSolution
    clean_case
    function_object m4gnRecorder 'fields (D ddt(D)); writeControl timeStep; writeInterval 1;'
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
function_object m4gnRecorder 'fields (D); writeControl timeStep; writeInterval 1;'
runs solidDisplacementFoam
function_object m4gnSurrogate 'mode replace; model any; timeStart 0.1; solverSteps 10; surrogateSteps 2;'
refused 'carries on from D, ddt(D)' solidDisplacementFoam

# Another solver's D
function_object m4gnSurrogate 'mode replace; model any; state totalDisplacement; timeStart 0.1; solverSteps 10; surrogateSteps 2;'
refused 'solidProperties with solidModel' solidDisplacementFoam
echo "solid: passed"
