#!/usr/bin/env bash
# A solver that adjusts its time step, from a cautious first one, with the dmd surrogate: times are written where the plain solver writes them,
# function objects see the solver's own steps in jumps, what an object behind the surrogate solves for loses nothing, and a run that
# is carried on has its fit.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
mkdir -p case/{0,constant,system} && cd case
control_dict pimpleFoam 29.4 0.0001 adjustableRunTime 0.7 12
sed -i 's/^timePrecision .*/timePrecision 6; adjustTimeStep yes; maxCo 0.2; maxDeltaT 1;/' system/controlDict
schemes 'div((nuEff*dev2(T(grad(U))))) Gauss linear;'
solvers 1e-10 0
sed -i '/(U|h|T|DT)/{ s//(U|s)/; s/1e-10/1e-12/; }' system/fvSolution
laminar 0.02
{ header fvOptions; echo 'force { type meanVelocityForce; selectionMode all; fields (U); Ubar (1 0 0); }'; } > constant/fvOptions
others='"left|right" { type cyclic; } frontAndBack { type empty; }'
field p volScalarField '0 2 -2 0 0 0 0' 0 "walls { type zeroGradient; } $others"
field U volVectorField '0 1 -1 0 0 0 0' '(1 0 0)' "walls { type noSlip; } $others"
field s volScalarField '0 0 0 0 0 0 0' 0 "walls { type fixedGradient; gradient uniform 1; } $others"
block '1 1 0.1' '4 20 1' 'left { type cyclic; neighbourPatch right; faces (LEFT); } right { type cyclic; neighbourPatch left; faces (RIGHT); }
    walls { type wall; faces (BOTTOM TOP); } frontAndBack { type empty; faces (BACK FRONT); }'

tracer='tracer { type scalarTransport; libs (solverFunctionObjects); field s; D 0.02; nCorr 0; resetOnStartUp no; writeControl none; log no; }'
average() { echo "average { type fieldAverage; libs (fieldFunctionObjects); timeStart 21.1; writeControl writeTime; fields ( U { mean on; prime2Mean off; base time; } ); }"; }
looks="Co { type CourantNo; libs (fieldFunctionObjects); writeControl writeTime; }
    rows { type volFieldValue; libs (fieldFunctionObjects); fields (U); operation max; regionType all; writeFields no; log no; }"
# U comes to rest: what s does is looked at
surrogate() { echo "test { type m4gnSurrogate; libs (m4gnFoam); mode replace; surrogates (dmd); control { tolerance 0.05; fields (s); } $* }"; }
dmd='dmd { snapshotInterval 0.25; window 24; minSnapshots 24; delays (3 5); holdOut 3; initialJump 10; maxJump 20; }'
largest() { awk '/^internalField/ { on = 1 } /^boundaryField/ { exit } on && /^[0-9.e-]+$/ && n++ && $1 > m { m = $1 } END { print m + 0 }' "$1"; }
total() { sed -n 's/.*totalTime *\(.*\);/\1/p' "$1/uniform/functionObjects/functionObjectProperties"; }

echo "$looks $(average) $tracer" > system/functions
runs pimpleFoam
plain=$(times)
mkdir ../plain && mv [1-9]* postProcessing ../plain && clean_case

for order in front behind; do
    case $order in
        front) echo "$tracer $looks $(average) $(surrogate "$dmd")" ;;
        *) echo "$(surrogate "$dmd") $looks $(average) $tracer" ;;
    esac > system/functions
    clean_case
    runs pimpleFoam
    replaces 0.3 "tracer in $order"
    expect_silence 'could not predict a stride'
    [ "$(times)" = "$plain" ] || fail "times $(times), expected $plain"
    for field in U s; do
        below "$(difference ../plain/29.4/$field 29.4/$field)" 2e-3 "$field, tracer in $order"
    done
done

# Rows of equal weight, and the solver's Courant number, at all times
gap() { awk '!/^#/ { if (n++ > 100 && $1 - t > m) m = $1 - t; t = $1 } END { print m }' "$1/postProcessing/rows/0/volFieldValue.dat"; }
below "$(gap .)" "$(calc "1.5*$(gap ../plain)")" "largest time between two rows"
mean() { awk '!/^#/ && $1 > 15 { gsub(/[()]/, ""); s += $2; ++n } END { print s/n }' "$1/postProcessing/rows/0/volFieldValue.dat"; }
below "$(off "$(mean .)" "$(mean ../plain)")" 2e-3 "mean over rows"
for time in 14 21 23.8 28; do
    below "$(off "$(largest $time/Co)" "$(largest ../plain/$time/Co)")" 0.3 "Courant number at $time"
done
# From a time inside of a stride on
holds "($(total 29.4) - $(total ../plain/29.4))^2 < 0.06^2" "time that is averaged over"

# Carried on, from a time in a jump and from one behind a step of the solver
mkdir ../whole && cp -r [1-9]* postProcessing ../whole
for time in 9.8 14.7 22.4; do
    clean_case
    cp -r ../whole/$time ../whole/postProcessing .
    control startTime $time
    runs pimpleFoam
    expect_silence 'could not predict a stride'
    expect_log '^m4gn: jumped'
    below "$(difference ../whole/29.4/U 29.4/U)" 1e-4 "U, carried on at $time"
done

# A function object whose own times cut steps short, in jumps as in the solver's: no time to write is lost
at='at { type volFieldValue; libs (fieldFunctionObjects); fields (U); operation max; regionType all; writeFields no; log no;
    writeControl adjustableRunTime; writeInterval 0.06; }'
control startTime 0
for run in plain hybrid; do
    clean_case
    echo "$at $tracer $([ $run = plain ] || surrogate "$dmd")" > system/functions
    runs pimpleFoam
    [ $run = hybrid ] || plain=$(times | wc -w)
done
replaces 0.1 'beside a function object with times of its own'
[ "$(times | wc -w)" -eq "$plain" ] || fail "times $(times), expected $plain of them"

# The default: states are so many of the present steps apart, and not of the first; each fourth step is looked at
clean_case
echo "$tracer $(surrogate 'othersInterval 4; dmd { window 24; minSnapshots 24; delays (3 5); holdOut 3; initialJump 5; }') $looks" > system/functions
control endTime 49
runs pimpleFoam
[ "$(grep -c 'fit of' log.run)" -lt 20 ] || fail "$(grep -c 'fit of' log.run) fits: states lie inside of steps"
expect_log '^m4gn: jumped'
below "$(calc "3*$(gap ../plain)")" "$(gap .)" "four steps between two rows"
# Why there is none is said
clean_case
control endTime 1.4
runs pimpleFoam
expect_log 'm4gn: no jump of dmd: no fit: it takes 24 states .* apart'
# The solver's steps are those that another function object sets
for run in plain hybrid; do
    clean_case
    echo "step { type setTimeStep; libs (utilityFunctionObjects); deltaT constant 0.01; } $tracer
        $([ $run = plain ] || surrogate "$dmd")" > system/functions
    runs pimpleFoam
    grep '^deltaT = ' log.run > ../$run.steps
done
cmp ../plain.steps ../hybrid.steps || fail "the steps that setTimeStep sets are others beside the surrogate"
# One that derives each step from the one before is refused
echo "step { type setTimeStep; libs (utilityFunctionObjects); deltaT constant 0.01; deltaTCoeff 1.2; timeStart 5; } $tracer
    $(surrogate "$dmd")" > system/functions
refused 'The entry deltaTCoeff of step' pimpleFoam
surrogate 'othersInterval 0;' > system/functions
refused 'othersInterval 0: expected at least 1 time step' pimpleFoam
