#!/usr/bin/env bash
# m4gnSurrogate, control: jumps are as long as the tolerance allows; a surrogate that is no good leaves the run to the solver, to the
# byte; two ranks decide as one.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
sed -i 's/^endTime .*/endTime 1.15;/; s/^writeInterval .*/writeInterval 0.05;/' system/controlDict
runs icoFoam
mkdir ../full && cp -r [01].* ../full

# One stride of the solver, 0.05 s, before each jump of at most 0.25 s
surrogate() {
    function_object m4gnSurrogate "mode replace; model cylinder-flow.safetensors; timeStart 0.5; solverSteps 25; surrogateSteps 5;
        $*"
}
# Steps of the jumps, one after the other
steps() { awk '!/^#/ { printf "%s ", $2 }' postProcessing/test/0/surrogate.dat 2>/dev/null; }

# Tolerances that nothing reaches: as without control, and the first jump begins at timeStart
surrogate 'control { tolerance 1000; relTol 1000; }'
runs icoFoam
[ "$(steps)" = "5 5 " ] || fail "expected two whole jumps, found $(steps)"
[ "$(entry jumps_refused)" = 0 ] || fail "a jump was refused"
grep -q 'a stride beside the solver was off by' log.run || fail "the log does not tell of the estimate"
grep -q '# *Time.*strideError.*estimate' postProcessing/test/0/surrogate.dat || fail "no columns of the controller"
estimate=$(awk '!/^#/ { print $NF; exit }' postProcessing/test/0/surrogate.dat)
mkdir ../free && cp -r 0.75 ../free
clean_case
surrogate ''
runs icoFoam
for field in U p; do
    cmp ../free/0.75/$field 0.75/$field || fail "$field at 0.75 is not that of a run without control"
done

# A tolerance below what is expected of five steps: a shorter jump
tolerance=$(awk "BEGIN { print 0.9*$estimate }")
clean_case
surrogate "control { tolerance $tolerance; relTol 1000; fields (U); }"
runs icoFoam
short=$(steps)
[ -n "$short" ] && [ "${short%% *}" -lt 5 ] || fail "expected a first jump of less than 5 steps, found '$short' of tolerance $tolerance"
# What is expected of a jump is never above the tolerance
awk -v most="$tolerance" '!/^#/ && $NF > most { exit 1 }' postProcessing/test/0/surrogate.dat || fail "a jump was expected to be worse"

# Two ranks decide as one
clean_case
on_two_ranks icoFoam
[ "$(steps)" = "$short" ] || fail "two ranks jumped by $(steps), one by $short"

# A network of random weights is no good: the solver does it all, as if there were no surrogate
clean_case
function_object m4gnSurrogate "mode replace; model \"$small_model\"; timeStart 0.5; solverSteps 5; surrogateSteps 5;
    control { tolerance 0.05; }"
runs icoFoam
[ "$(entry jumps)" = 0 ] || fail "a network of random weights jumped"
grep -q 'no jump at time 0.5: the surrogate beside the solver was off by' log.run || fail "the log does not tell why there was no jump"
[ "$(entry jumps_refused)" -gt 10 ] || fail "it was not tried beside the solver"
for field in U p; do
    cmp ../full/1.1/$field 1.1/$field || fail "$field at 1.1 is not the solver's own"
done
# Or the run ends
clean_case
function_object m4gnSurrogate "mode replace; model \"$small_model\"; timeStart 0.5; solverSteps 5; surrogateSteps 5;
    control { tolerance 0.05; onFailure stop; patience 3; }"
refused 'in 3 strides in a row' icoFoam

# What the surrogate changes is not to be more its own than the solver's, however wide the tolerance
clean_case
surrogate 'control { tolerance 1000; relTol 1e-6; }'
runs icoFoam
[ "$(entry jumps)" = 0 ] || fail "a jump whose strides are off by more than relTol"
grep -q 'no jump at time 0.5: .* more than relTol of what the solver changed' log.run || fail "the log does not tell of relTol"

# What is wrong is said before the run begins
clean_case
surrogate 'control { tolerance 0; }'
refused 'tolerance 0' icoFoam
surrogate 'control { }'
refused 'tolerance' icoFoam
surrogate 'control { tolerance 0.1; onFailure maybe; }'
refused 'onFailure' icoFoam
surrogate 'control { tolerance 0.1; fields (q); }'
refused 'q is not predicted' icoFoam
echo "control: passed"
