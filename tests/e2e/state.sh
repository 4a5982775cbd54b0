#!/usr/bin/env bash
# A solver state from another library that the case loads: found by name, with its own entries; where two kinds apply,
# the dictionary must say which. And a function object of that library that moves the mesh.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
foam=$("$M4GN_HOME/setup/openfoam.sh" --export)
eval "$foam"
runs cmake -S "$M4GN_HOME/tests/e2e/state" -B build
runs cmake --build build
make_case case
state() {
    echo "test { type m4gnSurrogate; libs (m4gnFoam \"$work/build/libbareFlow.so\"); mode replace; model \"$small_model\";
        timeStart 0.02; solverSteps 5; surrogateSteps 2; $* }" > system/functions
}
table=postProcessing/test/0/surrogate.dat

state 'state bareFlow; share 0.25;'
runs icoFoam
grep -q '^# Time.*share' $table || { cat $table; fail "the state's own quantity is not in the table"; }
awk '!/^#/ { ++n; other += $5 != 0.25 } END { exit !n || other }' $table || fail "the state did not get its entry"
clean_case
state ''
refused 'carries on from several kinds of state: bareFlow, flow' icoFoam
state 'state flow; share 0.25;'
refused 'share: unknown entry' icoFoam
state 'state bareFlow; projection { nCorrectors 1; }'
refused 'projection.nCorrectors: unknown entry' icoFoam
state 'state none;'
refused 'Entry state is none; expected one of bareFlow, flow, totalDisplacement' icoFoam
state 'state flow; projection { nCorrectors 1; }'
runs icoFoam
grep -q 'maxDivAfter' log.run || { cat log.run; fail "the flow state was not taken"; }

# A mesh that another function object moves: said with the name of the function object that cannot follow
move="move { type moveMesh; libs (\"$work/build/libbareFlow.so\"); executeControl timeStep; executeInterval 3; }"
for object in "m4gnSurrogate; mode observe; model \"$small_model\"" m4gnRecorder; do
    clean_case
    echo "watch { libs (m4gnFoam); type $object; } $move" > system/functions
    refused "Function object watch of type ${object%%;*}: the mesh has moved" icoFoam
    grep -q 'or run on a fixed mesh' log.run || { cat log.run; fail "no remedy"; }
done
