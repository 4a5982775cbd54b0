#!/usr/bin/env bash
# Fields that m4gn makes, as inputs of a model: the size of the cells, of a recording's mesh or of the solver's, and the viscosity, of a
# recording's provenance or of the solver's transportProperties; the same serially and on two ranks.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case

data=$work/case/postProcessing/test/0/trajectory.h5
record() { function_object m4gnRecorder "writeControl timeStep; writeInterval 5; provenance { nu 1e-3; } fields ($1);"; }
surrogate() { function_object m4gnSurrogate "mode replace; timeStart 0.02; solverSteps 5; surrogateSteps 2; outOfRange ignore; $1"; }

record 'U p'
runs icoFoam
cp "$data" ../without.h5

# check FIELD DIMENSIONS: recorded, its range is that of a model which learned from a recording without it
check() {
    local name file
    clean_case
    record "U p $1"
    runs icoFoam
    m4gn info "$data" | grep "^field *$1 " | grep -qF "scalar [$2]" || { m4gn info "$data"; fail "$1 is not recorded"; }
    with_input "$1" > ../given.toml
    for name in recorded without; do
        file=$data
        [ $name = recorded ] || file=$work/without.h5
        runs m4gn train --from "$small_model" --steps 0 --data "$file" --config ../given.toml --out "$work/$name.safetensors"
    done
    cmp "$work/recorded.safetensors" "$work/without.safetensors" || fail "the solver's $1 and the recording's differ"

    # Weights that are not zero, so that a wrong value is seen
    runs m4gn train --from "$work/without.safetensors" --steps 20 --data "$work/without.h5" --config ../given.toml \
        --out "$work/given-$1.safetensors"
    clean_case
    surrogate "model \"$work/given-$1.safetensors\";"
    runs icoFoam
    grep -q '^m4gn: jumped 2 steps' log.run || { cat log.run; fail "no jump"; }
    rm -rf ../serial
    cp -r 0.04 ../serial
    clean_case
    on_two_ranks icoFoam
    runs reconstructPar -time 0.04
    below "$(difference ../serial/U 0.04/U)" 1e-4 "U on two ranks, with $1"
}
check cellSize '0 1 0 0 0 0 0'
check nu '0 2 -1 0 0 0 0'

# Another viscosity than the model has seen is said
clean_case
sed -i 's/1e-3/2e-3/' constant/transportProperties
function_object m4gnSurrogate "mode replace; timeStart 0.02; solverSteps 5; surrogateSteps 2; model \"$work/given-nu.safetensors\";"
runs icoFoam
grep -q 'nu is 2.000e-3' log.run || { cat log.run; fail "another viscosity is not said"; }
echo "given-fields: passed"
