#!/usr/bin/env bash
# What other function objects see of time in a run with jumps, and what Time is told: averages weigh times as they are, wherever in the list
# they stand; what they keep for a restart is at each written time; deltaT and stopAt that are edited in a jump are heeded behind it; with
# timeEnd there are totals.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
sed -i 's/^endTime .*/endTime 1.1;/; s/^writeInterval .*/writeInterval 0.05;/; s/^writeFormat .*/writeFormat binary;/; s/^writePrecision .*/writePrecision 16;/' \
    system/controlDict
# Jumps from 0.5 to 0.75 and from 0.8 to 1.05
surrogate="surrogate { type m4gnSurrogate; libs (m4gnFoam); mode replace; model cylinder-flow.safetensors; timeStart 0.5; solverSteps 25;
    surrogateSteps 5; }"
average() {
    echo "average { type fieldAverage; libs (fieldFunctionObjects); fields ( U { mean on; prime2Mean off; base time; } ); writeControl writeTime; $* }"
}
total() { sed -n 's/.*totalTime *\(.*\);/\1/p' "$1/uniform/functionObjects/functionObjectProperties"; }
near() { awk "BEGIN { d = $1 - $2; exit !(d*d < 1e-16) }" || fail "$3: $1, expected $2"; }
begin() { clean_case; sed -i 's/^startTime .*/startTime 0;/; s/^stopAt .*/stopAt endTime;/; s/^deltaT .*/deltaT 0.002;/' system/controlDict; }

# In front of the surrogate and behind it
for order in front behind; do
    begin
    case $order in
        front) { average; echo "$surrogate"; } ;;
        *) { echo "$surrogate"; average; } ;;
    esac > system/functions
    runs icoFoam
    near "$(total 1.1)" 1.1 "time that is averaged over, $order"
    mkdir ../$order && cp -r [01].* ../$order
done
cmp ../front/1.1/UMean ../behind/1.1/UMean || fail "the average depends on the order of function objects"
cmp ../front/1.1/U ../behind/1.1/U || fail "the run depends on the order of function objects"

# Executed each fifth step: 110 samples of 0.002 s in the plain run, and as much weight for each stretch of time with jumps
begin
{ echo "$surrogate"; average 'executeControl timeStep; executeInterval 5;'; } > system/functions
runs icoFoam
near "$(total 1.1)" 0.22 "time that is averaged over each fifth step"

# What they keep is there in a jump, and where one begins, and a run goes on with it
for time in 0.5 0.55 0.6 0.75; do
    [ -f ../behind/$time/uniform/functionObjects/functionObjectProperties ] || fail "no functionObjectProperties at $time"
done
for time in 0.5 0.6 0.75; do
    begin
    cp -r ../behind/$time .
    sed -i "s/^startTime .*/startTime $time;/" system/controlDict
    { echo "$surrogate"; average; } > system/functions
    runs icoFoam
    near "$(total 1.1)" 1.1 "time that is averaged over, carried on at $time"
    for field in U UMean; do
        cmp 1.1/$field ../behind/1.1/$field || fail "$field at 1.1 is another one, carried on at $time"
    done
done

# edit TIME SED...: controlDict is edited at this time of the run
edit() {
    local time=$1
    shift
    cp system/controlDict system/controlDict.before
    sed "$@" system/controlDict > system/controlDict.after
    echo "edit { type timeActivatedFileUpdate; libs (utilityFunctionObjects); fileToUpdate \"<system>/controlDict\";
        timeVsFile ( (0 \"<system>/controlDict.before\") ($time \"<system>/controlDict.after\") ); }"
    touch -d '1 hour ago' system/*
}
sed -i 's/^runTimeModifiable .*/runTimeModifiable yes;/' system/controlDict
echo 'OptimisationSwitches { fileModificationSkew 0; }' >> system/controlDict
begin
{ echo "$surrogate"; edit 0.79 's/^deltaT .*/deltaT 0.001;/'; } > functions
mv functions system
runs icoFoam
[ "$(grep '^Time = ' log.run | tail -n 2 | tr '\n' ' ')" = "Time = 1.099 Time = 1.1 " ] || fail "an edited deltaT is not heeded"
cp system/controlDict.before system/controlDict
begin
{ echo "$surrogate"; edit 0.59 's/^stopAt .*/stopAt nextWrite;/'; } > functions
mv functions system
runs icoFoam
[ ! -d 0.85 ] || fail "the run was not stopped"
cp system/controlDict.before system/controlDict
last=$(find . -maxdepth 1 -name '0.*' | sed 's,./,,' | sort -g | tail -n 1)
sed -i "s/^startTime .*/startTime $last;/" system/controlDict
echo "$surrogate" > system/functions
runs icoFoam
cmp 1.1/U ../behind/1.1/U || fail "a run that was stopped at $last is another one"

# Totals where the surrogate ends before the run
sed -i 's/^runTimeModifiable .*/runTimeModifiable no;/' system/controlDict
begin
echo "$surrogate" | sed 's/surrogateSteps/timeEnd 0.9; surrogateSteps/' > system/functions
runs icoFoam
[ "$(grep -c 'replacedFraction' log.run)" = 1 ] || fail "no totals with timeEnd"
[ -f postProcessing/surrogate/0/summary.json ] || fail "no summary with timeEnd"
begin
function_object m4gnSurrogate "mode observe; model cylinder-flow.safetensors; timeEnd 0.3;"
runs icoFoam
[ "$(grep -c 'mean rms errors' log.run)" = 1 ] || fail "no mean errors with timeEnd"

# A stride of 25 steps does not end at each seventh
begin
function_object m4gnSurrogate "mode observe; model cylinder-flow.safetensors; writeControl writeTime;
    executeControl timeStep; executeInterval 7;"
refused 'executeInterval 1' icoFoam
echo "others-times: passed"
