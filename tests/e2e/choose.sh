#!/usr/bin/env bash
# m4gnSurrogate with surrogates (network dmd): the network jumps until a fit holds, then the fit; carried on; mode observe.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
sed -i 's/^endTime .*/endTime 4;/; s/^writeInterval .*/writeInterval 0.25;/; s/^writeFormat .*/writeFormat binary;/' system/controlDict
sed -i 's/tolerance  *1e-10/tolerance 1e-7/; s/relTol  *0;/relTol 0.05;/' system/fvSolution
strides=postProcessing/test/0/strides.dat

# Observing leaves the run alone, and has errors of both
runs icoFoam
mkdir ../plain && cp -r 4 ../plain
clean_case
function_object m4gnSurrogate "mode observe; surrogates (network dmd); model cylinder-flow.safetensors; timeStart 2; rolloutSteps 10;
    dmd { snapshotInterval 0.05; }"
runs icoFoam
for field in U p phi; do cmp "4/$field" "../plain/4/$field" || fail "observing has changed $field"; done
errors=postProcessing/test/0/surrogateError.dat
for who in network dmd; do
    awk -v who=$who '!/^#/ && $2 == who && $6 > 0 { ++n } END { exit n < 5 }' $errors || { cat $errors; fail "no rollouts of $who"; }
    grep -q "mean rms errors of the $who surrogate" log.run || fail "no means of $who"
done

# In the solver's place; a drag is held
with_drag() {
    function_object m4gnSurrogate "mode replace; surrogates (network dmd); model cylinder-flow.safetensors; timeStart 2;
        dmd { snapshotInterval 0.05; } quantities ( { object $1; result $2; tolerance 0.5; } );"
    drag forces >> system/functions
}
clean_case
with_drag forces Cd
runs icoFoam
grep -q 'at the end of the jump Cd of forces was off by' log.run || { grep m4gn log.run; fail "the log does not tell of the drag"; }
[ "$(entry quantities_judged)" -ge 1 ] && [ -n "$(entry worst_forces_Cd)" ] || fail "the summary does not tell of the drag"
below 0.2 "$(entry replaced_fraction)" "least that is replaced"
[ "$(entry jumps)" = $(($(entry jumps_network) + $(entry jumps_dmd))) ] || fail "jumps of both are not all jumps"
# A fit that holds goes before the network: there is one when the network may begin
awk '!/^#/ { if ($5 == "jumps") ++jumps[$2] } END { exit !jumps["dmd"] || jumps["network"] > jumps["dmd"] }' $strides ||
    { cat $strides; fail "the network jumps beside a fit"; }
grep -q ': the dmd surrogate jumps$' log.run || { grep m4gn log.run; fail "the log does not tell who jumps"; }
mkdir ../whole && cp -r [0-9]* postProcessing ../whole

# Carried on
clean_case
cp -r ../whole/3.25 ../whole/postProcessing .
sed -i 's/^startTime .*/startTime 3.25;/' system/controlDict
runs icoFoam
grep -q "m4gn: test goes on from its state at time 3.25" log.run || fail "the state was not read"
for field in U p phi; do cmp "4/$field" "../whole/4/$field" || { grep m4gn log.run; fail "carried on: other bytes of $field"; }; done

# What is not there is named
sed -i 's/^startTime .*/startTime 0;/' system/controlDict
clean_case
sed -i 's/^endTime .*/endTime 0.01;/' system/controlDict
with_drag forces Cq
refused 'the result Cq of forces, which it does not have' icoFoam
with_drag nobody Cd
refused 'nobody, which is no other function object' icoFoam

# Each of them needs its own
function_object m4gnSurrogate "mode replace; surrogates (network dmd); dmd { snapshotInterval 0.05; }"
refused 'model' icoFoam
function_object m4gnSurrogate "mode replace; surrogates (dmd dmd);"
refused 'each once' icoFoam
