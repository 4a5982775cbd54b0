#!/usr/bin/env bash
# What other function objects see of time in a run with jumps, and what Time is told: averages weigh times as they are, wherever in the list
# they stand; what they keep for a restart is at each written time; deltaT and stopAt that are edited in a jump are heeded behind it; with
# timeEnd there are totals.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 1.1 writeInterval 0.05 writeFormat binary writePrecision 16
set_entries system/fvSolution tolerance 1e-7 relTol 0.05
# Jumps from 0.5 to 0.75 and from 0.8 to 1.05
surrogate="surrogate { type m4gnSurrogate; libs (m4gnFoam); mode replace; model cylinder-flow.safetensors; timeStart 0.5; solverSteps 25;
    surrogateSteps 5; }"
average() {
    echo "average { type fieldAverage; libs (fieldFunctionObjects); fields ( U { mean on; prime2Mean off; base time; } ); writeControl writeTime; $* }"
}
total() { sed -n 's/.*totalTime *\(.*\);/\1/p' "$1/uniform/functionObjects/functionObjectProperties"; }
near() { holds "($1 - $2)^2 < 1e-16" "$3:"; }
# anew [FUNCTIONS]: the run from its start with these function objects
begin() { clean_case; control startTime 0 stopAt endTime deltaT 0.002; }
anew() { begin; echo "$*" > system/functions; solve; }

# In front of the surrogate and behind it
anew "$(average)" "$surrogate"
near "$(total 1.1)" 1.1 "time that is averaged over, in front"
keep front 1.1
anew "$surrogate" "$(average)"
near "$(total 1.1)" 1.1 "time that is averaged over, behind"
keep behind [01].*
# Neither the average nor the run depends on the order of function objects
same_bytes ../front 1.1/{UMean,U}

# Executed each fifth step: 110 samples of 0.002 s in the plain run, and as much weight for each stretch of time with jumps
anew "$surrogate" "$(average 'executeControl timeStep; executeInterval 5;')"
near "$(total 1.1)" 0.22 "time that is averaged over each fifth step"
# Of a stride of 25 steps 12 or 13 are a second one
anew "$surrogate" "$(average 'executeControl timeStep; executeInterval 2; writeControl onEnd;')"
near "$(total 1.1)" 0.55 "time that is averaged over each second step"

# The former names of its entries say the same, beside an interval that OpenFOAM does not read
for name in write output; do
    [ $name = write ] && other=output || other=write
    anew "$surrogate" "rows { type volFieldValue; libs (fieldFunctionObjects); fields (p); operation max; regionType all; writeFields no; log no;
        ${name}Control timeStep; ${name}Interval 20; ${other}Interval 3; }"
    mv postProcessing/rows/0/volFieldValue.dat ../$name.dat
done
cmp ../write.dat ../output.dat || fail "rows with outputControl are others than with writeControl"

# What they keep is there in a jump, and where one begins, and a run goes on with it
for time in 0.5 0.55 0.6 0.75; do
    [ -f ../behind/$time/uniform/functionObjects/functionObjectProperties ] || fail "no functionObjectProperties at $time"
done
for time in 0.5 0.6 0.75; do
    begin
    cp -r ../behind/$time .
    control startTime $time
    echo "$surrogate $(average)" > system/functions
    solve
    near "$(total 1.1)" 1.1 "time that is averaged over, carried on at $time"
    same_bytes ../behind 1.1/{U,UMean}
    # Steps of the solver behind the jump are told as its own
    grep -q 'solverDeltaT *0;' 0.8/uniform/functionObjects/functionObjectProperties || fail "carried on at $time, 0.8 is taken for a time of a jump"
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
control runTimeModifiable yes
echo 'OptimisationSwitches { fileModificationSkew 0; }' >> system/controlDict
begin
{ echo "$surrogate"; edit 0.79 's/^deltaT .*/deltaT 0.001;/'; } > functions
mv functions system
solve
[ "$(grep '^Time = ' log.run | tail -n 2 | tr '\n' ' ')" = "Time = 1.099 Time = 1.1 " ] || fail "an edited deltaT is not heeded"
cp system/controlDict.before system/controlDict
# Files that are updated in a jump are read before the solver's first step behind it
begin
{ echo "$surrogate"; edit 0.59 's/^deltaT .*/deltaT 0.001;/'; } > functions
mv functions system
solve
expect_log '^Time = 0.751$'
cp system/controlDict.before system/controlDict
begin
{ echo "$surrogate"; edit 0.59 's/^stopAt .*/stopAt nextWrite;/'; } > functions
mv functions system
solve
[ ! -d 0.85 ] || fail "the run was not stopped"
cp system/controlDict.before system/controlDict
last=$(find . -maxdepth 1 -name '0.*' | sed 's,./,,' | sort -g | tail -n 1)
control startTime "$last"
echo "$surrogate" > system/functions
solve
same_bytes ../behind 1.1/U

# A run that is stopped in a jump ends behind a step of the solver, and what is executed at its end is so once
anew "$surrogate" 'stop { type abort; libs (utilityFunctionObjects); action writeNow; file "0.6/uniform/functionObjects/functionObjectProperties"; }
    last { type fieldMinMax; libs (fieldFunctionObjects); fields (p); executeControl onEnd; writeControl onEnd; log no; }'
[ "$(rows postProcessing/last/0/fieldMinMax.dat | awk '{ print $1 }' | sort -u | tr '\n' ' ')" = "0.702 " ] || fail "the run ended at $(rows postProcessing/last/0/fieldMinMax.dat)"

# becomes BEFORE AFTER: a run whose function objects are edited at 0.3 s
becomes() {
    local edit='edit { type timeActivatedFileUpdate; libs (utilityFunctionObjects); fileToUpdate "<system>/functions";
        timeVsFile ( (0 "<system>/functions.before") (0.3 "<system>/functions.after") ); }'
    begin
    echo "$edit $1" > system/functions
    cp system/functions system/functions.before
    echo "$edit $2" > system/functions.after
    touch -d '1 hour ago' system/*
    solve
}
# One that comes into a run begins there; a recorder that is taken out keeps what it has
becomes 'recorder { type m4gnRecorder; libs (m4gnFoam); writeControl timeStep; writeInterval 10; }' \
    'late { type m4gnSurrogate; libs (m4gnFoam); mode observe; model cylinder-flow.safetensors; }'
[ "$(rows postProcessing/late/0/surrogateError.dat | awk '$1 > 0.3' | wc -l)" -ge 10 ] || fail "no errors of a surrogate that came into the run"
expect_log 'recorder is taken out of the run; its recording ends here'
[ -s postProcessing/recorder/0/trajectory.h5 ] || fail "the recording that was taken out has gone"
# A surrogate that is taken out tells what it has until then
becomes 'early { type m4gnSurrogate; libs (m4gnFoam); mode observe; model cylinder-flow.safetensors; }' ''
expect_log 'early is taken out of the run' 'mean rms errors'
# One that replaces the solver and came into the run is carried on under the same conditions
becomes '' "$surrogate"
echo "$surrogate" > system/functions
control startTime 0.8
solve
expect_log 'surrogate goes on from its state at time 0.8'
expect_silence 'under other conditions'
# One with a timeEnd that is edited goes on as it was begun
becomes "${surrogate/surrogateSteps/timeEnd 0.9; surrogateSteps}" "${surrogate/surrogateSteps/timeEnd 0.9; writePrecision 8; surrogateSteps}"
expect_log 'goes on as it was begun'
[ "$(grep -c 'replacedFraction' log.run)" = 1 ] || fail "no totals with timeEnd of a dictionary that was edited"
# A quantity whose function object is taken out cannot be held any more
held="${surrogate/surrogateSteps/quantities ( { object forces; result Cd; tolerance 1e6; \} ); surrogateSteps}"
becomes "$(drag forces) $held" "$held"
expect_log 'Cd of forces had an error of inf' 'the next jumps have 2 strides at most'
# An average that comes into the run sees its jumps
becomes "$surrogate" "$surrogate $(average)"
holds "$(total 1.1) > 0.79" "time that is averaged over from 0.3 on"

# Totals where the surrogate ends before the run
control runTimeModifiable no
anew "${surrogate/surrogateSteps/timeEnd 0.9; surrogateSteps}"
[ "$(grep -c 'replacedFraction' log.run)" = 1 ] || fail "no totals with timeEnd"
[ -f postProcessing/surrogate/0/summary.json ] || fail "no summary with timeEnd"
begin
ride "mode observe; model cylinder-flow.safetensors; timeEnd 0.3;"
[ "$(grep -c 'mean rms errors' log.run)" = 1 ] || fail "no mean errors with timeEnd"

# A stride of 25 steps does not end at each seventh
begin
expect_error 'executeInterval 1' "mode observe; model cylinder-flow.safetensors; writeControl writeTime; executeControl timeStep; executeInterval 7;"
