#!/usr/bin/env bash
# Fields that m4gn makes, as inputs of a model: the size of the cells, of a recording's mesh or of the solver's; the viscosity, of a
# recording's provenance or of the solver's transportProperties; deltaT, in jumps that of the solver. The same serially and on two ranks.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
data=$work/case/postProcessing/test/0/trajectory.h5
recorded() { record "writeControl timeStep; writeInterval 5; provenance { nu 1e-3; } fields ($1);"; }
jumps() { ride "mode replace; timeStart 0.02; solverSteps 5; surrogateSteps 2; outOfRange $1; model \"$2\";"; }
# train FROM STEPS DATA OUT: with ../given.toml
train() { runs m4gn train --from "$1" --steps "$2" --data "$3" --config ../given.toml --out "$4"; }

recorded 'U p'
cp "$data" ../without.h5

# check FIELD DIMENSIONS: recorded, its range is that of a model which learned from a recording without it
check() {
    recorded "U p $1"
    m4gn info "$data" | grep "^field *$1 " | grep -qF "scalar [$2]" || { m4gn info "$data"; fail "$1 is not recorded"; }
    with_input "$1" > ../given.toml
    rm -f ../recorded.safetensors ../without.safetensors
    train "$small_model" 0 "$data" "$work/recorded.safetensors"
    train "$small_model" 0 "$work/without.h5" "$work/without.safetensors"
    cmp "$work/recorded.safetensors" "$work/without.safetensors" || fail "the solver's $1 and the recording's differ"

    # Weights that are not zero, so that a wrong value is seen
    train "$work/without.safetensors" 20 "$work/without.h5" "$work/given-$1.safetensors"
    jumps ignore "$work/given-$1.safetensors"
    jumped + 2
    same_on_two_ranks 1e-4 0.04/U
}
check cellSize '0 1 0 0 0 0 0'
check nu '0 2 -1 0 0 0 0'

# Another viscosity than the model has seen is said
set_entries constant/transportProperties nu 2e-3
jumps warn "$work/given-nu.safetensors"
expect_log 'nu is 2.000e-3'

# The solver's step: recorded, and with weights of zero as without it; the field holds it in the jump from 0.02 to 0.04, whose steps are the
# surrogate's
set_entries constant/transportProperties nu 1e-3
recorded 'U p deltaT'
m4gn info "$data" | grep -q 'deltaT  *scalar \[0 0 1 0 0 0 0\], last frame 0.002000 to 0.002000' || { m4gn info "$data"; fail "deltaT is not recorded"; }
with_input deltaT > ../given.toml
train "$small_model" 0 "$data" "$work/deltaT.safetensors"
jumps ignore "$small_model"
keep before 0.04
beside='seen { type writeObjects; libs (utilityFunctionObjects); objects (deltaT); writeOption anyWrite; writeControl writeTime; }'
jumps ignore "$work/deltaT.safetensors"
jumped + 2
for time in 0.02 0.03 0.04 0.05; do
    grep -q '^internalField *uniform 0.002;' $time/deltaT || { sed -n 15,25p $time/deltaT; fail "deltaT at $time"; }
done
close_to ../before 1e-6 0.04/{U,p}
same_on_two_ranks 1e-4 0.04/U
# Where the model knows other time steps, the run says so
control deltaT 0.001
jumps warn "$work/deltaT.safetensors"
expect_log 'deltaT is'
