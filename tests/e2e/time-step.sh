#!/usr/bin/env bash
# deltaT as an input of a model: recorded, given to a model that had it not, and the solver's own in jumps, whose steps
# are the surrogate's.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case

function_object m4gnRecorder 'fields (U p deltaT); writeControl timeStep; writeInterval 5;'
runs icoFoam
data=$work/case/postProcessing/test/0/trajectory.h5
m4gn info "$data" | grep -q 'deltaT  *scalar \[0 0 1 0 0 0 0\], last frame 0.002000 to 0.002000' || { m4gn info "$data"; fail "deltaT is not recorded"; }

# The small model with deltaT as an input more, whose weights are zero
with_input deltaT > ../more.toml
runs m4gn train --from "$small_model" --steps 0 --data "$data" --config ../more.toml --out "$work/more.safetensors"

surrogate() { function_object m4gnSurrogate "mode replace; timeStart 0.02; solverSteps 5; surrogateSteps 2; outOfRange ignore; $1"; }
clean_case
surrogate "model \"$small_model\";"
runs icoFoam
mkdir ../before && cp -r 0.* ../before

# With it the answer is the same, and the field holds the solver's step in the jump from 0.02 to 0.04
clean_case
surrogate "model \"$work/more.safetensors\";"
echo 'seen { type writeObjects; libs (utilityFunctionObjects); objects (deltaT); writeOption anyWrite; writeControl writeTime; }' \
    >> system/functions
runs icoFoam
grep -q '^m4gn: jumped 2 steps' log.run || { cat log.run; fail "no jump"; }
for time in 0.02 0.03 0.04 0.05; do
    grep -q '^internalField *uniform 0.002;' $time/deltaT || { sed -n 15,25p $time/deltaT; fail "deltaT at $time"; }
done
for name in U p; do
    below "$(difference ../before/0.04/$name 0.04/$name)" 1e-6 "$name after the jump"
done
cp -r 0.04 ../serial

clean_case
on_two_ranks icoFoam
runs reconstructPar -time 0.04
below "$(difference ../serial/U 0.04/U)" 1e-4 "U on two ranks"

# Where the model knows other time steps, the run says so
sed -i 's/^deltaT .*/deltaT 0.001;/' system/controlDict
clean_case
surrogate "model \"$work/more.safetensors\"; outOfRange warn;"
runs icoFoam
grep -q 'deltaT is' log.run || { grep -A3 'trained on' log.run; fail "another time step is not told"; }
echo "time-step: passed"
