#!/usr/bin/env bash
# m4gnSurrogate, mode replace: what is written when, by the run and by function objects before and behind the surrogate.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case

# The solver to 0.02 in steps of 0.002, two strides of 0.01 to 0.04, the solver again
# One that has its rows when it is executed, and one that has them when it is written
table() {
    drag "$1" "executeControl $2; executeInterval $3; writeControl $2; writeInterval $3;"
    echo "$1Extrema { type fieldMinMax; libs (fieldFunctionObjects); fields (p); log no; writeControl $2; writeInterval $3; }"
}
# case_with CONTROL INTERVAL END
case_with() {
    clean_case
    control writeControl "$1" writeInterval "$2" endTime "$3"
    { table before "$1" "$2"; surrogate "$jump"; cat system/functions; table behind "$1" "$2"; } > functions
    mv functions system
    solve
    decided "a jump to 0.04" "abs(of('handed_back', strides=2)[0]['time'] - 0.04) < 1e-9"
}
# written WHAT TIMES...: fields at these times
written() {
    local what=$1 found
    shift
    found=$(find . -maxdepth 1 -name '0.*' -printf '%f\n' | sort | tr '\n' ' ')
    [ "$found" = "$* " ] || fail "$what: fields at $found, expected $*"
}
# executed WHAT TIMES...: all function objects at these times
executed() {
    local what=$1 found table
    shift
    for table in postProcessing/{before,behind}{/*/coefficient,Extrema/*/fieldMinMax}.dat; do
        found=$(awk '!/^#/ { print $1 + 0 }' "$table" | tr '\n' ' ')
        [ "$found" = "$* " ] || fail "$what: $table has $found, expected $*"
    done
}
both() { written "$@" && executed "$@"; }

solver=(0.004 0.008 0.012 0.016 0.02)
for control in runTime adjustableRunTime; do
    case_with $control 0.004 0.06
    both "$control, 0.4 strides" "${solver[@]}" 0.03 0.04 0.044 0.048 0.052 0.056 0.06
    # The last time follows the jump by less than half a stride
    case_with $control 0.004 0.044
    both "$control, to the end" "${solver[@]}" 0.03 0.04 0.044
    case_with $control 0.02 0.06
    both "$control, two strides" 0.02 0.04 0.06
done
# What runs at the run's end does so once, however near to it a stride ends
clean_case
control writeControl adjustableRunTime writeInterval 0.004 endTime 0.044
{ table before onEnd 1; surrogate "$jump"; cat system/functions; table behind onEnd 1; } > functions
mv functions system
solve
executed "onEnd" 0.044
case_with timeStep 10 0.06
both "timeStep, ten: two strides" 0.02 0.04 0.06
case_with timeStep 2 0.06
both "timeStep, two" "${solver[@]}" 0.03 0.04 0.044 0.048 0.052 0.056 0.06
case_with timeStep 3 0.06
both "timeStep, three" 0.006 0.012 0.018 0.03 0.04 0.042 0.048 0.054 0.06

# A run that is carried on between two times to write, where a stride ended, writes at those of the run before
control writePrecision 16
case_with adjustableRunTime 0.012 0.06
both "adjustableRunTime, 1.2 strides" 0.012 0.03 0.04 0.048 0.06
keep whole 0.06
rm -r 0.04 0.048 0.06 postProcessing
control startTime 0.03
solve
written "carried on in a jump" 0.012 0.03 0.04 0.048 0.06
executed "carried on in a jump" 0.04 0.048 0.06
close_to ../whole 1e-10 0.06/U

# So does one with a fit, whose next state may be a time to write within the stride. What others keep is there where a jump begins
clean_case
control startTime 0 writeInterval 0.004 endTime 0.3
beside="average { type fieldAverage; libs (fieldFunctionObjects); fields ( U { mean on; prime2Mean off; base time; } ); writeControl writeTime; }
    $(drag forces) averages { type m4gnAverages; libs (m4gnAverages); timeStart 0.01; quantities { Cd { functionObject forces; result Cd; } } }"
surrogate 'mode replace; surrogates (dmd); writeJumps yes; control { tolerance 1e30; relTol 1e30; }
    dmd { snapshotInterval 0.01; window 14; minSnapshots 14; holdOut 3; delays (2 4); svdRank (4 8); jumpTolerance 1e30; fitTolerance 1e30;
        initialJump 2; maxJump 2; }'
solve
keep whole 0.* postProcessing
begun=$(python3 -c 'import json
for line in map(json.loads, open("postProcessing/test/decisions.jsonl")):
    if line["event"] == "jump_begun" and round(line["time"]/0.01) % 2:
        print("%g" % line["time"])
        break')
[ -n "$begun" ] || fail "no jump of the fit begins between two times to write"
carry_on "$begun"
expect_log "averages carries on with the series of .*/$begun/uniform/averages.state"
close_to ../whole 1e-6 0.3/UMean
from() { find "$1" -maxdepth 1 -name '0.*' -printf '%f\n' | sort -g | awk -v t="$begun" '$1 >= t'; }
diff <(from ../whole) <(from .) || fail "carried on at $begun, other times are written"
