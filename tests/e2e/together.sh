#!/usr/bin/env bash
# A surrogate and the other function objects of a run: two replacers, observing or recording what is replaced, function
# objects that solve equations, fields that nobody advances in a jump.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
replace="mode replace; model \"$small_model\"; timeStart 0.02; solverSteps 5; surrogateSteps 2;"
object() { echo "$1 { type $2; libs (m4gnFoam); $3 }"; }

# Two of them would jump one after the other
{ object first m4gnSurrogate "$replace"; object second m4gnSurrogate "$replace"; } > system/functions
refused 'Both function objects first and second replace the solver' icoFoam

# Observing what is replaced compares the surrogate with itself
{ object first m4gnSurrogate "$replace"; object second m4gnSurrogate "mode observe; model \"$small_model\";"; } > system/functions
refused 'Function object second of mode observe stands beside a solver that first replaces' icoFoam
{ object first m4gnSurrogate "$replace"; object second m4gnSurrogate "mode observe; model \"$small_model\"; timeEnd 0.02;"; } > system/functions
runs icoFoam
[ "$(awk '!/^#/' postProcessing/second/0/surrogateError.dat | wc -l)" -eq 1 ] || fail "the time before was not observed"

# Recording it
clean_case
{ object first m4gnSurrogate "$replace"; object second m4gnRecorder ''; } > system/functions
refused "Function object second would record states of the surrogate first as if they were the solver's" icoFoam
[ -z "$(find . -name 'trajectory*')" ] || fail "a refused recording left a file"
{ object first m4gnSurrogate "$replace"; object second m4gnRecorder 'hybrid yes;'; } > system/functions
clean_case
runs icoFoam
m4gn info postProcessing/second/0/trajectory.h5 > ../info
grep -q 'hybrid.*with states of the surrogate first' ../info || { cat ../info; fail "the recording does not say so"; }

# Of it, what the solver does between the jumps: 0.002 to 0.02, and from what is handed back at 0.04 to the end
# stretches FIRST_TIME FRAMES ...: they are what was recorded
stretches() {
    local files=postProcessing/second/0
    [ "$(find $files -type f | wc -l)" -eq $(($# / 2)) ] || fail "$(find $files -type f): expected $(($# / 2)) files"
    while [ $# -gt 0 ]; do
        m4gn info $files/trajectory-"$1".h5 > ../info || fail "no stretch from $1 s"
        grep -q "^frames  *$2 from $1 to" ../info || { cat ../info; fail "expected $2 frames from $1 s"; }
        grep -q 'hybrid.*the solver between jumps of the surrogate first' ../info || fail "the stretch does not say what it is"
        shift 2
    done
}
record='hybrid stretches;'
{ object first m4gnSurrogate "$replace"; object second m4gnRecorder "$record"; } > system/functions
clean_case
runs icoFoam
stretches 0.002 10 0.04 11
cp postProcessing/second/0/trajectory-0.04.h5 ../behind.h5
{ object second m4gnRecorder "$record"; object first m4gnSurrogate "$replace"; } > system/functions
clean_case
runs icoFoam
stretches 0.002 10 0.04 11
content() { m4gn info "$1" | tail -n +2; }
diff <(content ../behind.h5) <(content postProcessing/second/0/trajectory-0.04.h5) || fail "in front of the surrogate something else is recorded"
clean_case
on_two_ranks icoFoam
stretches 0.002 10 0.04 11
{ object second m4gnRecorder "$record"; object first m4gnSurrogate "$replace executeOthers no;"; } > system/functions
clean_case
runs icoFoam
stretches 0.002 10 0.042 10
{ object first m4gnSurrogate "$replace"; object second m4gnRecorder "$record writeControl timeStep; writeInterval 10;"; } > system/functions
clean_case
runs icoFoam
stretches 0.04 2

{ object first m4gnSurrogate "$replace"; object second m4gnRecorder 'timeEnd 0.02;'; } > system/functions
clean_case
runs icoFoam
[ -f postProcessing/second/0/trajectory.h5 ] || fail "the time before was not recorded"
! m4gn info postProcessing/second/0/trajectory.h5 | grep -q hybrid || fail "a recording of the solver alone says hybrid"

# scalarTransport with the surrogate's stride, five times the solver's, would have to be at 22 times
{ echo 'transport { type scalarTransport; libs (solverFunctionObjects); field s; D 1e-3; nCorr 0; resetOnStartUp no; log yes; }'; drag forces; } > ../s
echo "$(header s volScalarField) dimensions [0 0 0 0 0 0 0]; internalField uniform 0;
boundaryField { inlet { type fixedValue; value uniform 1; } frontAndBack { type empty; } \".*\" { type zeroGradient; } }" > 0/s
sed -i 's/div(phi,U).*/div(phi,U) Gauss linear; div(phi,s) Gauss upwind;/' system/fvSchemes
sed -i 's/^    U$/    "(U|s)"/' system/fvSolution
forces() { awk '!/^#/' postProcessing/forces/0/coefficient.dat | wc -l; }
transports() { grep -c 'Solving for s,' log.run; }
# with ENTRIES: a run with these entries of the surrogate
with() {
    clean_case
    { object first m4gnSurrogate "$replace $1"; cat ../s; } > system/functions
    runs icoFoam
}
with ''
[ "$(forces) $(transports)" = "22 20" ] || fail "by default: $(forces) forces, $(transports) times scalarTransport; expected 22 20"
grep -q "not executed at the surrogate's times, since they do more than look: transport " log.run || fail "it is not said"
with 'executeOthers no;'
[ "$(forces) $(transports)" = "20 20" ] || fail "executeOthers no: $(forces), $(transports)"
with 'executeOthers (transport);'
[ "$(forces) $(transports)" = "20 22" ] || fail "executeOthers (transport): $(forces), $(transports)"
{ object first m4gnSurrogate "$replace executeOthers (force);"; cat ../s; } > system/functions
refused 'executeOthers of first has the name force, which is no other function object of this run' icoFoam
{ object first m4gnSurrogate "$replace executeOthers perhaps;"; cat ../s; } > system/functions
refused 'executeOthers' icoFoam

# What nobody advances has a note where it is written in a jump: 0.03 is in one, 0.04 its end, 0.06 the solver's
with ''
grep -q 'the model does not advance .*s.*: what is written of them in a jump' log.run || { cat log.run; fail "it is not said that s stays"; }
for time in 0.03 0.04; do
    grep -q 'note .*not advanced by the surrogate, values of time 0.02"' $time/s || { head -15 $time/s; fail "no note in $time/s"; }
    ! grep -q 'not advanced' $time/U || fail "a note in $time/U"
    ! grep -q 'not advanced' $time/phi || fail "a note in $time/phi"
done
for time in 0.02 0.05 0.06; do
    ! grep -q 'not advanced' $time/s || fail "a note in $time/s, which the solver wrote"
done
echo "together: passed"
