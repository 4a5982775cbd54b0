#!/usr/bin/env bash
# The beam tutorial with the shipped model, the first 0.82 s of it: close to the solver alone, the same on two ranks, compared.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

cp -r "$M4GN_HOME/openfoam/templates/vibrating-beam" full
cp "$M4GN_HOME"/openfoam/tutorials/beam/system/{controlDict,decomposeParDict,setExprFieldsDict} full/system
cd full
rm 0/D_0
sed -i 's/@tip@/0.02/; s/@tolerance@/5e-6/; s/@endTime@/0.82/; s/@deltaT@/0.001/; s/binary;/ascii;/' system/*
: > system/functions
runs blockMesh
runs setExprFields
cp -r ../full ../hybrid
# The solver's own answer to less than a per cent, with half of the correctors or less
echo 'predictor { type m4gnPredictor; libs (m4gnAccelerators); }' > system/functions
runs solidDisplacementFoam
cd ../hybrid
sed "s|@model@|$M4GN_HOME/models/beam.safetensors|; s/@solverSteps@/80/; s/@surrogateSteps@/4/" \
    "$M4GN_HOME/openfoam/tutorials/beam/system/surrogate" > system/functions
cp -r ../hybrid ../parallel
runs solidDisplacementFoam
# From the first time on: 0.001 s of start-up, 0.08 to 0.4 and 0.48 to 0.8
decided "two jumps of four steps" "len(of('handed_back', strides=4)) == 2" surrogate
[ ! -d 0.1 ] && [ -d 0.16 ] || fail "expected the surrogate's times, found: $(echo 0.*)"
for time in 0.16 0.4 0.46 0.72; do
    below "$(difference ../full/$time/D $time/D)" 0.1 "D at $time against the solver alone"
done

# Two ranks, until just after a jump that begins at 0.02: each of the solver's time steps is thousands of messages
cd ../parallel
set_entries system/functions solverSteps 20
control endTime 0.345
solve
keep serial 0.34
clean_case
solve 2
runs reconstructPar
close_to ../serial 1e-3 0.34/D

cd ..
runs m4gn compare full hybrid --patch clamp --probe-patch tip --json compare.json
below "$(sed -n 's/.*"point_error_max": *\([^,]*\).*/\1/p' compare.json)" 0.05 "largest error of the tip, of its amplitude"
# solids4foam writes the solid's velocity as U: that makes no flow of it
for time in full/[0-9]* hybrid/[0-9]*; do
    if [ -f "$time/D" ]; then sed 's/object  *D;/object U;/' "$time/D" > "$time/U"; fi
done
cp log.run log.compare
runs m4gn compare full hybrid --patch clamp --probe-patch tip --json again.json
cmp compare.json again.json || fail "a solid's case with a field U is compared in another way"
cp log.compare log.run
grep -q 'replaced 7' log.run || fail "expected seven tenths of the time to be replaced"
