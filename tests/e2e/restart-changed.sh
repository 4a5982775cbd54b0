#!/usr/bin/env bash
# m4gnSurrogate, a run that is carried on under other conditions, with averages, with fields that the solver makes in its first step, and with
# what is no field: what was fitted before is dropped where it no longer holds, and what a jump cannot follow is refused by name.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 1 writeInterval 0.05 writeFormat binary
set_entries system/fvSolution tolerance 1e-6 relTol 0.05
# In Latin-1
printf 'note "Z\344higkeit";\n' >> constant/transportProperties
# Always a fit, always a jump
dmd='mode replace; surrogates (dmd); timeStart 0.3; control { tolerance 1000; relTol 1000; } dmd { snapshotInterval 0.01; window 14;
    minSnapshots 12; fitTolerance 1000; jumpTolerance 1000; initialJump 12; maxJump 12; }'
# later TIME: the times after it go, and the run begins there
later() {
    local time
    for time in [0-9]*; do
        awk "BEGIN { exit !($time > $1 + 1e-9) }" && rm -rf "$time"
    done
    control startTime "$1"
}
# keep, back TIME: the run so far is kept; it is carried on from there
keep() { rm -rf ../whole && cp -r . ../whole; }
back() { rm -rf ../case && cp -r ../whole ../case && cd ../case && later "$1"; }
# in_a_jump: a stored time that a jump has passed
in_a_jump() { grep -l 'solverDeltaT *0\.' 0.[3-9]*/uniform/functionObjects/functionObjectProperties | sed -n '2s,/.*,,p'; }
# dropped WHAT: the fit is, for this reason, and the solver goes on
dropped() {
    grep -q "under other conditions: .*$1.* is dropped" log.run || { grep m4gn: log.run; fail "no word of $1"; }
    awk '/under other conditions/ { on = 1 } on && /fit of/ { fit = 1 } on && /m4gn: jumped/ && !fit { wrong = 1 } END { exit wrong }' log.run ||
        fail "$1: a jump without a new fit"
}

function_object m4gnSurrogate "$dmd"
runs icoFoam
keep
at=$(in_a_jump)
echo "carried on in a jump at $at"
for time in "$at" 0.6; do
    # Under the same conditions the run is the uninterrupted one
    back "$time"
    runs icoFoam
    cmp 1/U ../whole/1/U || fail "$time: U is another"
    # A property
    back "$time"
    sed -i 's/^nu .*/nu 1.1e-3;/' constant/transportProperties
    runs icoFoam
    dropped 'transportProperties nu was 0.001 and is 0.0011'
done
# What else is compared is compared alike at any time
time=$at
# A scheme, an inlet
back "$time"
sed -i 's/Euler/backward/' system/fvSchemes
runs icoFoam
dropped 'fvSchemes ddtSchemes default was Euler and is backward'
back "$time"
# In the stored time, which is binary
LC_ALL=C sed -i 's/fixedProfile;/fixedValue;/' "$time/U"
runs icoFoam
dropped 'U at inlet type was fixedProfile and is fixedValue'
# Its cells in another order: what is kept is not
back "$time"
runs renumberMesh -overwrite
runs icoFoam
dropped 'order of the cells was'
# An observer begins anew
back "$time"
sed -i 's/mode replace/mode observe/; s/surrogateSteps.*//' system/functions
runs icoFoam
grep -q 'begins to observe' log.run || fail "$time: no word of what is not taken up"
# Earlier times than those that the states of the fit are kept for: the window begins anew
back 0.35
rm postProcessing/test/states.0 && touch postProcessing/test/states.0.2
runs icoFoam
grep -q 'have made room for later ones' log.run || fail "no word of states that have made room"
# A pipe is not waited for
back 0.35
rm postProcessing/test/states.0 && mkfifo postProcessing/test/states.0
refused 'states.0.*found a pipe' timeout 60 icoFoam

# Averages go on from those of the stored time, which strides have that do not meet the times to write
cd ../case && rm -rf 0.[0-9]* 1 postProcessing
control startTime 0
{ echo "test { type m4gnSurrogate; libs (m4gnFoam); ${dmd/0.01/0.012} }
    mean { type fieldAverage; libs (fieldFunctionObjects); writeControl writeTime; fields (U { mean on; prime2Mean on; base time; }); }"; } > system/functions
runs icoFoam
keep
at=$(in_a_jump)
back "$at"
runs icoFoam
cmp 1/UMean ../whole/1/UMean || fail "averages of a run that is carried on in a jump at $at are others"

# Fields of CrankNicolson, which the scheme makes or reads in its first step
sed -i 's/default *Euler/default CrankNicolson 0.9/' system/fvSchemes
cd ../case && rm -rf 0.[0-9]* 1 postProcessing
control startTime 0
function_object m4gnSurrogate "$dmd"
runs icoFoam
keep
for time in 0.2 "$(in_a_jump)"; do
    back "$time"
    runs icoFoam
    ! grep 'other conditions' log.run || fail "CrankNicolson, $time: a fit is dropped"
    cmp 1/U ../whole/1/U || fail "CrankNicolson, carried on at $time: U is another"
done
sed -i 's/CrankNicolson 0.9/Euler/' system/fvSchemes

# A network with backward, carried on where its jump has ended: the old level is a stride old
rm -rf 0.[0-9]* 1 postProcessing
sed -i 's/default *Euler/default backward/' system/fvSchemes
control startTime 0
control endTime 0.3
function_object m4gnSurrogate 'mode replace; model cylinder-flow.safetensors; timeStart 0.1; solverSteps 10; surrogateSteps 2;'
runs icoFoam
keep
back 0.2
runs icoFoam
cmp 0.3/U ../whole/0.3/U || fail "a network's jump with backward, carried on at its end: U is another"
