#!/usr/bin/env bash
# solidDisplacementFoam: its own recorded states, handed back after a jump, are carried on from as in the run without one.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_oracle
make_beam case
each='writeControl timeStep; writeInterval 1;'
good='mode replace; model any; timeStart 0.1; solverSteps 10; surrogateSteps 2;'
: > any

export ORACLE_STRIDE=0.025 ORACLE_FRAMES=5
# The other form of the normal stress stalls at residuals of some 1e-6
while read -r compact tolerance limit; do
    stress $compact 500 $tolerance
    record "fields (D ddt(D)); $each"
    keep full 0.*

    # From the recorded run's 0.05: the solver to 0.1, the surrogate to 0.15, the solver to 0.2, the surrogate to 0.25
    clean_case
    cp -r ../full/0.05 .
    control startTime 0.05
    surrogate "$good"
    solve
    jumped 2 2
    [ ! -d 0.13 ] && [ -d 0.15 ] || fail "expected the surrogate's times 0.125 and 0.15, found: $(echo 0.1*)"
    close_to ../full $limit 0.{155,175,2,255}/D

    # Carried on from where the first jump ended: with the velocity that was handed back
    keep whole 0.15 postProcessing
    control endTime 0.175
    carry_on 0.15
    control startTime 0 endTime 0.255
    close_to ../full $limit 0.{155,175}/D
done <<'EOD'
yes 1e-7 1e-4
no 2e-5 1e-3
EOD

# Without its rate, D is half of the state. Only its fields are looked at, so that few correctors do.
stress no 5 2e-5
recorder "fields (D); $each"
solve
expect_error 'carries on from D, ddt(D)' "$good"

# Another solver's D
expect_error 'solidProperties with solidModel' "$good state totalDisplacement;"
