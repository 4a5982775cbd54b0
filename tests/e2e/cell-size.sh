#!/usr/bin/env bash
# cellSize as an input of a model: made of the mesh of a recording, and of the solver's, the same serially and on two ranks.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case

function_object m4gnHarvest 'fields (U p); writeControl timeStep; writeInterval 5;'
runs icoFoam
data=$work/case/postProcessing/test/0/trajectory.h5
cp "$data" ../without.h5

# The solver's field is what the mesh of the recording says: recorded, its range is that of a model which learned from a
# recording without it
clean_case
function_object m4gnHarvest 'fields (U p cellSize); writeControl timeStep; writeInterval 5;'
runs icoFoam
recorded=$(m4gn info "$data" | grep 'cellSize')
grep -q 'scalar \[0 1 0 0 0 0 0\]' <<< "$recorded" || { m4gn info "$data"; fail "cellSize is not recorded"; }
with_input cellSize > ../sized.toml
for name in recorded without; do
    file=$data
    [ $name = recorded ] || file=$work/without.h5
    runs m4gn train --from "$small_model" --steps 0 --data "$file" --config ../sized.toml --out "$work/$name.safetensors"
done
cmp "$work/recorded.safetensors" "$work/without.safetensors" || fail "the solver's field and that of the recording's mesh differ"

# Weights that are not zero, so that a wrong size is seen
runs m4gn train --from "$work/without.safetensors" --steps 20 --data "$work/without.h5" --config ../sized.toml \
    --out "$work/sized.safetensors"
surrogate() { function_object m4gnSurrogate "mode replace; timeStart 0.02; solverSteps 5; surrogateSteps 2; outOfRange ignore; $1"; }
clean_case
surrogate "model \"$work/sized.safetensors\";"
runs icoFoam
grep -q '^m4gn: jumped 2 steps' log.run || { cat log.run; fail "no jump"; }
cp -r 0.04 ../serial
clean_case
on_two_ranks icoFoam
runs reconstructPar -time 0.04
below "$(difference ../serial/U 0.04/U)" 1e-4 "U on two ranks"
echo "cell-size: passed"
