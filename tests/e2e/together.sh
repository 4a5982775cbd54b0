#!/usr/bin/env bash
# A surrogate and the other function objects of a run: two replacers, observing or recording what is replaced, function
# objects that solve equations, fields that nobody advances in a jump.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
object() { echo "$1 { type $2; libs (m4gnFoam); $3 }"; }
first() { object first m4gnSurrogate "$jump $*"; }
second() { object second "$@"; }
# with FUNCTIONS...: a run anew with these; never TEXT FUNCTIONS...: they are refused.
with() { clean_case && echo "$*" > system/functions && solve; }
never() { clean_case && echo "${*:2}" > system/functions && refused "$1" icoFoam; }

# Two of them would jump one after the other
never 'Both function objects first and second replace the solver' "$(first)" "$(second m4gnSurrogate "$jump")"

# Observing what is replaced compares the surrogate with itself
never 'Function object second of mode observe stands beside a solver that first replaces' "$(first)" "$(second m4gnSurrogate "mode observe; $small")"
with "$(first)" "$(second m4gnSurrogate "mode observe; $small timeEnd 0.02;")"
[ "$(rows postProcessing/second/0/surrogateError.dat | wc -l)" -eq 1 ] || fail "the time before was not observed"

# Recording it
never "Function object second would record states of the surrogate first as if they were the solver's" "$(first)" "$(second m4gnRecorder '')"
[ -z "$(find . -name 'trajectory*')" ] || fail "a refused recording left a file"
with "$(first)" "$(second m4gnRecorder 'timeEnd 0.02;')"
[ -f postProcessing/second/0/trajectory.h5 ] || fail "the time before was not recorded"

# scalarTransport with the surrogate's stride, five times the solver's, would have to be at 22 times
others=$(echo 'transport { type scalarTransport; libs (solverFunctionObjects); field s; D 1e-3; nCorr 0; resetOnStartUp no; log yes; }'; drag forces)
echo "$(header s volScalarField) dimensions [0 0 0 0 0 0 0]; internalField uniform 0;
boundaryField { inlet { type fixedValue; value uniform 1; } frontAndBack { type empty; } \".*\" { type zeroGradient; } }" > 0/s
sed -i 's/div(phi,U).*/div(phi,U) Gauss linear; div(phi,s) Gauss upwind;/' system/fvSchemes
sed -i 's/^    U$/    "(U|s)"/' system/fvSolution
forces() { rows postProcessing/forces/0/coefficient.dat | wc -l; }
transports() { grep -c 'Solving for s,' log.run; }
# executes ENTRIES FORCES TRANSPORTS: with these entries of the surrogate they are executed so often
executes() {
    with "$(first "$1")" "$others"
    [ "$(forces) $(transports)" = "$2 $3" ] || fail "'$1': $(forces) forces, $(transports) times scalarTransport; expected $2 $3"
}
executes 'executeOthers no;' 20 20
executes 'executeOthers (transport);' 20 22
never 'executeOthers of first has the name force, which is no other function object of this run' "$(first 'executeOthers (force);')" "$others"
never 'executeOthers' "$(first 'executeOthers perhaps;')" "$others"
# Rows of m4gnAverages are of steps that it and what publishes have seen: a jump that one of both has not is no part of a mean
for entries in 'executeOthers (averages);' 'executeOthers no;'; do
    with "$(first "$entries")" "$(drag forces) averages { type m4gnAverages; libs (m4gnAverages); quantities { Cd { functionObject forces; result Cd; } } }"
    python3 - <<'EOD' || fail "'$entries': rows of m4gnAverages"
import struct
data = open("0.06/uniform/averages.state", "rb").read()
length, _, _, count = struct.unpack_from("<4Q", data, 8)
weights = [struct.unpack_from("<4d", data, 40 + length + 32*i)[2] for i in range(count)]
assert count == 20 and max(weights) < 0.0021, weights
EOD
done
executes '' 22 20
expect_log "not executed at the surrogate's times, since they do more than look: transport "

# What nobody advances has a note where it is written in a jump: 0.03 is in one, 0.04 its end, 0.06 the solver's
expect_log 'the model does not advance .*s.*: what is written of them in a jump'
for time in 0.03 0.04; do
    grep -q 'note .*not advanced by the surrogate, values of time 0.02"' $time/s || { head -15 $time/s; fail "no note in $time/s"; }
    ! grep -q 'not advanced' $time/U || fail "a note in $time/U"
    ! grep -q 'not advanced' $time/phi || fail "a note in $time/phi"
done
for time in 0.02 0.05 0.06; do
    ! grep -q 'not advanced' $time/s || fail "a note in $time/s, which the solver wrote"
done

# What ends the run does so after a step of the solver: 0.03, where it would, is in a jump
with "$(first)" 'stop { type runTimeControl; libs (utilityFunctionObjects); conditions { time { type maxDuration; duration 0.025; } } }'
expect_log "not executed at the surrogate's times, since they do more than look: stop "
[ -d 0.042 ] && [ ! -d 0.05 ] || fail "it was to end behind the jump, at 0.042: $(ls -d 0.*)"
