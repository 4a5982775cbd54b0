#!/usr/bin/env bash
# m4gnSurrogate, control: jumps are as long as the tolerance allows; a surrogate that is no good leaves the run to the solver, to the
# byte; two ranks decide as one.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 1.15 writeInterval 0.05 writeFormat binary
set_entries system/fvSolution tolerance 1e-7 relTol 0.05
plain 0.4 1.1
# Until two strides before timeStart a run with a surrogate is the plain one
control startTime 0.4
from_plain() { clean_case && cp -r ../plain/0.4 .; }
ride() { from_plain && surrogate "$@" && solve; }

# One stride of the solver, 0.05 s, before each jump of at most 0.25 s
good='mode replace; model cylinder-flow.safetensors; timeStart 0.5; solverSteps 25; surrogateSteps 5;'
# Steps of the jumps, one after the other
steps() { awk '!/^#/ { printf "%s ", $2 }' postProcessing/test/0.4/surrogate.dat 2>/dev/null; }

# Tolerances that nothing reaches: as without control, and the first jump begins at timeStart
ride "$good control { tolerance 1000; relTol 1000; }"
[ "$(steps)" = "5 5 " ] || fail "expected two whole jumps, found $(steps)"
[ "$(entry jumps_refused)" = 0 ] || fail "a jump was refused"
decided "why there are jumps" "len(of('jump_begun', limited_by='longest')) == 2 and any(d['errors'].get('U', 0) > 0 for d in of('stride'))"
grep -q '# *Time.*strideError.*estimate' postProcessing/test/0.4/surrogate.dat || fail "no columns of the controller"
estimate=$(awk '!/^#/ { print $NF; exit }' postProcessing/test/0.4/surrogate.dat)
keep free 0.75
ride "$good"
same_bytes ../free 0.75/{U,p}

# A tolerance below what is expected of five steps: a shorter jump
tolerance=$(calc "0.9*$estimate")
ride "$good control { tolerance $tolerance; relTol 1000; fields (U); }"
short=$(steps)
[ -n "$short" ] && [ "${short%% *}" -lt 5 ] || fail "expected a first jump of less than 5 steps, found '$short' of tolerance $tolerance"
# What is expected of a jump is never above the tolerance
awk -v most="$tolerance" '!/^#/ && $NF > most { exit 1 }' postProcessing/test/0.4/surrogate.dat || fail "a jump was expected to be worse"

# Two ranks decide as one
from_plain
solve 2
[ "$(steps)" = "$short" ] || fail "two ranks jumped by $(steps), one by $short"

# A network of random weights is no good: the solver does it all, as if there were no surrogate
random="mode replace; $small timeStart 0.5; solverSteps 5; surrogateSteps 5;"
ride "$random control { tolerance 0.05; }"
[ "$(entry jumps)" = 0 ] || fail "a network of random weights jumped"
decided "why there was no jump" "of('stride', decision='tolerance')[0]['time'] < 0.5001 and not of('jump_begun')"
[ "$(entry jumps_refused)" -gt 10 ] || fail "it was not tried beside the solver"
same_bytes ../plain 1.1/{U,p}
# Or the run ends
from_plain
expect_error 'in 3 strides in a row' "$random control { tolerance 0.05; onFailure stop; patience 3; }"

# What the surrogate changes is not to be more its own than the solver's, however wide the tolerance
ride "$good control { tolerance 1000; relTol 1e-6; }"
[ "$(entry jumps)" = 0 ] || fail "a jump whose strides are off by more than relTol"
decided "why there was no jump" "of('stride', decision='relTol')[0]['time'] < 0.5001"

# What is wrong is said before the run begins
from_plain
expect_error 'q is not predicted' "$good control { tolerance 0.1; fields (q); }"
