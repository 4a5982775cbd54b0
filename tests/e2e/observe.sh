#!/usr/bin/env bash
# m4gnSurrogate, mode observe: the solver's result is untouched, and the table is right.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
table=postProcessing/test/0/surrogateError.dat
observe="mode observe; $small timeStart 0.02; rolloutSteps 2;"
# rms FILE: of the vectors in it, over two components
rms() { values "$1" | awk '{ s += $1^2 + $2^2 + $3^2 } END { printf "%.12g", sqrt(s/(2*NR)) }'; }
plain 0.06

ride "$observe"
cat $table
same_bytes ../plain 0.06/U
# 0.03, 0.04, 0.05, 0.06; rollouts of one, two, one, two steps
[ "$(awk '!/^#/ { printf "%s:%s ", $1 + 0, $2 }' $table)" = "0.03:1 0.04:2 0.05:1 0.06:2 " ] || fail "other rows were expected"
# On the first step of a rollout it is the one-step prediction
awk '!/^#/ && $2 == 1 && ($3 != $5 || $4 != $6 || $8 != $10) { exit 1 }' $table || fail "rollout and one step differ"
# hold(U) at 0.04 is the change of U from 0.03 on, over cells and the two solved components
expected=$(paste <(values 0.03/U) <(values 0.04/U) | awk '{ s += ($1-$4)^2 + ($2-$5)^2 + ($3-$6)^2 } END { printf "%.12g", sqrt(s/(2*NR)) }')
found=$(awk '!/^#/ && $1 == 0.04 { print $4 }' $table)
below "$(off "$found" "$expected")" 1e-6 "error of hold(U)"
expect_log 'one step .*hold '

serial=$(rows $table)
clean_case
solve 2
same_rows "$serial" "$(rows $table)"

# Where the rollout is off: the field at a write time has the root mean square of the table, and so have the segments together; the
# solver's result stays as it is
ride "$observe writeErrors yes;"
same_bytes ../plain 0.06/U
rms=$(awk '!/^#/ && $1 == 0.04 { print $5 }' $table)
below "$(off "$(rms '0.04/error(U)')" "$rms")" 1e-6 "rms of error(U)"
grep -q "dimensions *\[0 1 -1 0 0 0 0\]" '0.04/error(U)' || fail "error(U) has other dimensions than U"
parts=postProcessing/test/0/surrogateSegmentError.dat
found=$(awk -v table="$parts" 'NR == FNR { ++n[$1]; ++all; next }
    !/^#/ && $1 == 0.04 { for (k in n) s += n[k]*$(2 + k)^2; printf "%.12g", sqrt(s/all) }' <(values 0/m4gnSegment) "$parts")
below "$(off "$found" "$rms")" 1e-6 "rms of U over the segments"
segments=$(rows $parts)
clean_case
solve 2
same_rows "$segments" "$(rows $parts)"

# What error control would do: a stride is measured first, then each rollout has an error and what was expected of it
ride "$observe control { tolerance 1000; relTol 1000; onFailure stop; }"
same_bytes ../plain 0.06/U
[ "$(awk '!/^#/ { printf "%s:%s ", $1 + 0, $2 }' $table)" = "0.04:1 0.05:2 0.06:1 " ] || fail "other rows were expected with control"
# The error of the stride to 0.03, relative to U there, and twice that: this model says nothing of the growth
expected=$(echo "$serial" | awk '$1 == 0.03 { print $3/$7 }')
awk -v e="$expected" '!/^#/ && $1 < 0.055 { d = $NF/(e*$2) - 1; if (d*d > 1e-8) exit 1; ++n } END { exit n != 2 }' $table ||
    { cat $table; fail "expected estimates of $expected and twice that"; }
awk '!/^#/ { if ($7 > size) size = $7; d = $(NF - 1)*size/$5 - 1; if (d*d > 1e-6) exit 1 }' $table || { cat $table; fail "relative errors"; }
# One rollout of two steps came to its end; the other one had no time
decided "what control would have done" "[of('end')[0]['rollouts'][name] for name in ('jumps', 'strides', 'within')] == [1, 2, 1]"
ride "$observe control { tolerance 1e-9; }"
decided "no jumps that nothing allows" "of('end')[0]['rollouts']['jumps'] == 0 and of('end')[0]['rollouts']['refused'] == 2"
