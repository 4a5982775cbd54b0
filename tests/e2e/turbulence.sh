#!/usr/bin/env bash
# A network of all fields of a turbulence model: from a recording and a training of few steps into the solver's place. What is positive stays
# so, no wall function is evaluated outside of the model, and a field that nobody predicts is refused.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_square case
turbulence kOmegaSST nutkWallFunction
cp "$M4GN_HOME/openfoam/tutorials/cylinder/system/decomposeParDict" system
sed -i 's/^endTime .*/endTime 0.25;/; s/^writeInterval .*/writeInterval 0.01;/' system/controlDict

function_object m4gnRecorder 'fields (U p k omega nut); timeStart 0.1; writeControl timeStep; writeInterval 5; file "square.h5";'
runs pimpleFoam
! grep 'WARNING' log.run || fail "a recording of turbulence is one to take the solver's place with"
mkdir data && mv square.h5 data && clean_case

# model NAME STEPS FIELDS...
model() {
    { network 0.005 0 "${@:3}"
      echo "[segments]"; echo "method = \"metis\""; echo "count = 4"
      echo "[training]"; echo "batch_size = 1"; echo "learning_rate = 1e-3"; echo "normaliser_steps = 20"; echo "normaliser_warmup = 5"; } > "$1.toml"
    runs m4gn train --data data --config "$1.toml" --steps "$2" --out "$1.safetensors"
}
flow=('{ name = "U", input = true, output = "delta" }' '{ name = "p", input = true, output = "value" }')
model laminar 5 "${flow[@]}"
model all 40 "${flow[@]}" '{ name = "k", input = true, output = "delta", floor = 1e-7 }' \
    '{ name = "omega", input = true, output = "value", floor = 1e-2 }' '{ name = "nut", input = true, output = "value", floor = 1e-9 }'
model some 5 "${flow[@]}" '{ name = "k", input = true, output = "delta", floor = 1e-7 }' \
    '{ name = "omega", input = true, output = "delta", floor = 1e-2 }'

# surrogate MODEL [ENTRIES]: one jump, from 0.15 s
surrogate() {
    clean_case
    function_object m4gnSurrogate "mode replace; model \"$PWD/$1.safetensors\"; timeStart 0.15; timeEnd 0.17; solverSteps 1; surrogateSteps 4;
        outOfRange ignore; ${2:-}"
}
# positive WHAT: at the time within the jump and at the end; omega at the walls is that of their cells
positive() {
    grep -q '^m4gn: jumped 4 steps' log.run || fail "$1: no jump"
    ! grep -i 'bounding\|warning' log.run || fail "$1: a field has left its bounds"
    for time in 0.16 0.25; do
        for name in k omega nut; do
            below "$(values $time/$name | awk 'NR == 1 || $1 < least { least = $1 } END { print (least > 0 ? 0 : 1) }')" 0 "$1: $name at $time below 0"
        done
    done
}
for name in all some; do
    surrogate $name
    runs pimpleFoam
    positive "$name"
    ! grep -q 'not advanced' 0.16/{k,omega,nut} || fail "$name: a field was left behind"
    rm -rf ../serial && mkdir ../serial && mv 0.16 0.17 0.25 ../serial
done
on_two_ranks pimpleFoam
runs reconstructPar
for name in U k omega nut; do
    below "$(difference ../serial/0.16/$name 0.16/$name)" 1e-3 "$name within the jump, 1 and 2 ranks"
done

surrogate laminar
refused 'equations in time for k, omega, which the model' pimpleFoam
