#!/usr/bin/env bash
# m4gnSurrogate, mode observe: the solver's result is untouched, and the table is right.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
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
paste <(echo "$serial") <(awk '!/^#/' $table) | awk '
    { for (i = 1; i <= NF/2; ++i) { d = ($i - $(i + NF/2))/($i + 1e-12); if (d*d > 1e-8) exit 1 } }' || {
    cat $table
    fail "two ranks found other errors than one"
}
echo "observe: passed"
