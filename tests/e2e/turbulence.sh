#!/usr/bin/env bash
# A network of all fields of a turbulence model: from a recording and a training of few steps into the solver's place. What is positive stays
# so, no wall function is evaluated outside of the model, and a field that nobody predicts is refused.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_square case
turbulence kOmegaSST nutkWallFunction
control endTime 0.25 writeInterval 0.01

# A recording of turbulence is one to take the solver's place with
record 'fields (U p k omega nut); timeStart 0.1; writeControl timeStep; writeInterval 5; file "square.h5";'
expect_silence WARNING
mkdir data && mv square.h5 data && clean_case

# model NAME STEPS FIELDS...
model() {
    network 0.005 0 'method = "metis"; count = 4' 'batch_size = 1; learning_rate = 1e-3; normaliser_steps = 20; normaliser_warmup = 5' \
        "${@:3}" > "$1.toml"
    runs m4gn train --data data --config "$1.toml" --steps "$2" --out "$1.safetensors"
}
flow=('{ name = "U", input = true, output = "delta" }' '{ name = "p", input = true, output = "value" }')
model laminar 5 "${flow[@]}"
model all 40 "${flow[@]}" '{ name = "k", input = true, output = "delta", floor = 1e-7 }' \
    '{ name = "omega", input = true, output = "value", floor = 1e-2 }' '{ name = "nut", input = true, output = "value", floor = 1e-9 }'
model some 5 "${flow[@]}" '{ name = "k", input = true, output = "delta", floor = 1e-7 }' \
    '{ name = "omega", input = true, output = "delta", floor = 1e-2 }'

# one_jump MODEL: of the model, from 0.15 s
one_jump() { echo "mode replace; model \"$PWD/$1.safetensors\"; timeStart 0.15; timeEnd 0.17; solverSteps 1; surrogateSteps 4; outOfRange ignore;"; }
# positive WHAT: at the time within the jump and at the end; omega at the walls is that of their cells
positive() {
    jumped + 4
    # A field that has left its bounds
    expect_silence '[Bb]ounding' '[Ww]arning\|WARNING'
    for time in 0.16 0.25; do
        for name in k omega nut; do
            below "$(values $time/$name | awk 'NR == 1 || $1 < least { least = $1 } END { print (least > 0 ? 0 : 1) }')" 0 "$1: $name at $time below 0"
        done
    done
}
for name in all some; do
    ride "$(one_jump $name)"
    positive "$name"
    ! grep -q 'not advanced' 0.16/{k,omega,nut} || fail "$name: a field was left behind"
done
# Behind the jump
control endTime 0.18
same_on_two_ranks 1e-3 0.16/{U,k,omega,nut}

clean_case
expect_error 'equations in time for k, omega, which the model' "$(one_jump laminar)"
