#!/usr/bin/env bash
# m4gnSurrogate, mode observe: the solver's result is untouched, and the table is right.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case

# same ROWS TABLE: the numbers of a table on two ranks are those of the serial one
same() {
    paste <(echo "$1") <(awk '!/^#/' "$2") | awk '
        { for (i = 1; i <= NF/2; ++i) { d = ($i - $(i + NF/2))/($i + 1e-12); if (d*d > 1e-8) exit 1 } }' || {
        cat "$2"
        fail "two ranks found other errors than one"
    }
}
runs icoFoam
mkdir ../alone && cp -r 0.06 ../alone

clean_case
function_object m4gnSurrogate "mode observe; model \"$small_model\"; timeStart 0.02; rolloutSteps 2;"
runs icoFoam
table=postProcessing/test/0/surrogateError.dat
cat $table
cmp 0.06/U ../alone/0.06/U || fail "observing has changed U"
# 0.03, 0.04, 0.05, 0.06; rollouts of one, two, one, two steps
[ "$(awk '!/^#/ { printf "%s:%s ", $1 + 0, $2 }' $table)" = "0.03:1 0.04:2 0.05:1 0.06:2 " ] || fail "other rows were expected"
# On the first step of a rollout it is the one-step prediction
awk '!/^#/ && $2 == 1 && ($3 != $5 || $4 != $6 || $8 != $10) { exit 1 }' $table || fail "rollout and one step differ"
# hold(U) at 0.04 is the change of U from 0.03 on, over cells and the two solved components
expected=$(paste <(values 0.03/U) <(values 0.04/U) | awk '{ s += ($1-$4)^2 + ($2-$5)^2 + ($3-$6)^2 } END { printf "%.12g", sqrt(s/(2*NR)) }')
found=$(awk '!/^#/ && $1 == 0.04 { print $4 }' $table)
below "$(awk "BEGIN { d = $found/$expected - 1; print d < 0 ? -d : d }")" 1e-6 "error of hold(U)"
grep -q 'one step .*hold ' log.run || fail "no summary in the log"

serial=$(awk '!/^#/' $table)
clean_case
on_two_ranks icoFoam
same "$serial" $table

# Where the rollout is off: the field at a write time has the root mean square of the table, and so have the segments together; the
# solver's result stays as it is
clean_case
function_object m4gnSurrogate "mode observe; model \"$small_model\"; timeStart 0.02; rolloutSteps 2; writeErrors yes;"
runs icoFoam
cmp 0.06/U ../alone/0.06/U || fail "observing with writeErrors has changed U"
rms=$(awk '!/^#/ && $1 == 0.04 { print $5 }' $table)
found=$(values '0.04/error(U)' | awk '{ s += $1^2 + $2^2 + $3^2 } END { printf "%.12g", sqrt(s/(2*NR)) }')
below "$(awk "BEGIN { d = $found/$rms - 1; print d < 0 ? -d : d }")" 1e-6 "rms of error(U)"
grep -q "dimensions *\[0 1 -1 0 0 0 0\]" '0.04/error(U)' || fail "error(U) has other dimensions than U"
parts=postProcessing/test/0/surrogateSegmentError.dat
found=$(awk -v table="$parts" 'NR == FNR { ++n[$1]; ++all; next }
    !/^#/ && $1 == 0.04 { for (k in n) s += n[k]*$(2 + k)^2; printf "%.12g", sqrt(s/all) }' <(values 0/m4gnSegment) "$parts")
below "$(awk "BEGIN { d = $found/$rms - 1; print d < 0 ? -d : d }")" 1e-6 "rms of U over the segments"
segments=$(awk '!/^#/' $parts)
clean_case
on_two_ranks icoFoam
same "$segments" $parts

# What error control would do: a stride is measured first, then each rollout has an error and what was expected of it
clean_case
function_object m4gnSurrogate "mode observe; model \"$small_model\"; timeStart 0.02; rolloutSteps 2; control { tolerance 1000; relTol 1000; onFailure stop; }"
runs icoFoam
cmp 0.06/U ../alone/0.06/U || fail "observing with control has changed U"
[ "$(awk '!/^#/ { printf "%s:%s ", $1 + 0, $2 }' $table)" = "0.04:1 0.05:2 0.06:1 " ] || fail "other rows were expected with control"
# The error of the stride to 0.03, relative to U there, and twice that: this model says nothing of the growth
expected=$(echo "$serial" | awk '$1 == 0.03 { print $3/$7 }')
awk -v e="$expected" '!/^#/ && $1 < 0.055 { d = $NF/(e*$2) - 1; if (d*d > 1e-8) exit 1; ++n } END { exit n != 2 }' $table ||
    { cat $table; fail "expected estimates of $expected and twice that"; }
awk '!/^#/ { if ($7 > size) size = $7; d = $(NF - 1)*size/$5 - 1; if (d*d > 1e-6) exit 1 }' $table || { cat $table; fail "relative errors"; }
# One rollout of two steps came to its end; the other one had no time
grep -q 'would have let 1 rollouts go as jumps, of 2 steps .* 1 of them was within the tolerance 1000' log.run ||
    { tail -n 12 log.run; fail "no summary of the controller"; }
function_object m4gnSurrogate "mode observe; model \"$small_model\"; timeStart 0.02; rolloutSteps 2; control { tolerance 1e-9; }"
clean_case
runs icoFoam
grep -q 'would have let 0 rollouts go .* at 2 other starts it would have let none go' log.run || { tail log.run; fail "jumps that nothing allows"; }
echo "observe: passed"
