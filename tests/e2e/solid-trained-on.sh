#!/usr/bin/env bash
# A model of a solid knows the material, the load and the scheme of its data, and says at the start of a run what is different.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_beam case endTime 0.1
stress yes 50 1e-4
properties=constant/mechanicalProperties
cp $properties ../properties
cp 0/D ../D

# What m4gnRecorder writes of the case goes through the training into the model.
mkdir ../data
record 'fields (D ddt(D)); file "../data/a.h5"; writeControl timeStep; writeInterval 5; provenance { split train; }'
m4gn info ../data/a.h5 | tr -d ' \n' > log.run
expect_log 'solidE10000001000000' 'nu0.30.3' 'traction5050' 'schemesEuler'
network 0.025 0 'count = 4; modes = 3' 'batch_size = 1; learning_rate = 1e-3; decay_steps = 1' '{ name = "D", input = true, output = "delta" }' \
    '{ name = "ddt(D)", input = true, output = "delta" }' > ../tiny.toml
runs m4gn train --data ../data --config ../tiny.toml --out ../tiny.safetensors --steps 1 --backend native

good="mode observe; model \"$work/tiny.safetensors\"; timeStart 0.05; rolloutSteps 1;"

# The case of the data
ride "$good outOfRange refuse;"
expect_silence 'was trained on'

# Another material, and another load: in the first time step, though the surrogate starts ten steps later
sed 's/value 1e6;/value 4e6;/' ../properties > $properties
clean_case
expect_error "Young's modulus is 4.000e6 Pa, and the model was trained on 1.000e6 Pa" "$good outOfRange refuse;"
! grep -q '^Iteration: 0.01$' log.run || fail "it is not said in the first time step"
cp ../properties $properties
sed 's/(0 50 0)/(0 20 0)/; s/pressure uniform 0/pressure uniform 100/' ../D > 0/D
ride "$good"
expect_log "the largest traction is 1.020e2 Pa, and the model was trained on 5.000e1 Pa"
[ "$(grep -c 'and the model was trained on' log.run)" = 1 ] || { cat log.run; fail "more than the load is reported, or it is said twice"; }
ride "$good solid { traction (50 50); }"
expect_silence 'was trained on'
expect_error 'solid.E: expected the lowest and the highest value, found \[2, 1\]' "$good solid { E (2 1); }"
cp ../D 0/D

# Two ranks say what one does, in the first time step.
control endTime 0.01
sed 's/value 1000;/value 2000;/' ../properties > $properties
clean_case
surrogate "$good"
solve 2
[ "$(grep -c 'the density is 2.000e3 kg/m^3, and the model was trained on 1.000e3' log.run)" = 1 ] || { cat log.run; fail "two ranks do not say it once"; }
