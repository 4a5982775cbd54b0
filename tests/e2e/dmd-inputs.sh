#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd) and boundary values that are prescribed in time: an inlet that pulsates or has gusts is jumped, and so is a
# wall that turns by a table; one that goes beyond what was seen is left to the solver in time, and values that nobody can say beforehand are refused.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 3 deltaT 0.004 writeInterval 1.5
set_entries system/fvSolution tolerance 1e-7 relTol 0.05
# inlet ENTRIES: its condition
inlet() { foamDictionary -entry boundaryField/inlet -set "{ $* }" 0/U > log.set 2>&1 || { cat log.set; fail foamDictionary; }; }
# Slow enough that no wake sheds: all that moves is driven from the inlet
pulsating='uniformValue { type sine; frequency 2; amplitude 0.1; scale (1 0 0); level (0.2 0 0); } value uniform (0.2 0 0);'
inlet "type uniformFixedValue; $pulsating"
plain 1.5 3

dmd='mode replace; surrogates (dmd); dmd { snapshotInterval 0.04; maxJump 20; minSnapshots 24; jumpTolerance 0.05; fitTolerance 0.05; }'
ride "$dmd"
replaces 0.1 'a pulsating inlet'
# 1.5 s and 3 s are three periods apart: over what the field is
close_to ../plain 0.1 3/U

# Gusts: a number by chance each 0.12 s, known beforehand and never seen before
gusts() { awk -v form="$3" -v level="$1" -v size="$2" 'BEGIN { srand(3); for (t = 0; t < 6.1; t += .12) printf "(%.2f " form ") ", t, level + size*(2*rand() - 1) }'; }
control endTime 6
inlet "type uniformFixedValue; uniformValue table ($(gusts 0.2 0.02 '(%.6f 0 0)')); value uniform (0.2 0 0);"
plain 3 6
ride "$dmd"
expect_log 'inputs that are known beforehand: U at inlet' ', 1 input: its last 10 states'
replaces 0.4 'an inlet with gusts'
close_to ../plain 0.04 3/U 6/U
decided 'a fit with an input is used' "[d for d in of('fit', decision='used') if d['inputs'] == 1]"
# Carried on, in a jump or between two, the run is the same, and the inputs are those of all ranks
keep whole postProcessing 3 6
carry_on 3
close_to ../whole 1e-9 6/U
control startTime 0
# A scheme that looks at an old level, which lies before the last state of a jump where nothing else looks
ddt_scheme backward
plain 3 6
ride "$dmd"
expect_log ', 1 input: its last 10 states'
replaces 0.2 'an inlet with gusts, backward'
close_to ../plain 0.06 6/U
ddt_scheme Euler
control endTime 3
clean_case
solve 2
runs reconstructPar
# The solver's own rounding decides between fits that are as good
close_to ../whole 0.01 3/U
control endTime 6

# A cylinder that turns by a table, in a steady inlet; the table ends with the run
clean_case
echo "($(gusts 0 1 %.6f))" > constant/turns
inlet 'type fixedValue; value uniform (0.2 0 0);'
cp 0/U U
sed -i "/cylinder/,/}/c\\    walls { type noSlip; } cylinder { type rotatingWallVelocity; origin (0.31 0.212 0); axis (0 0 1); omega tableFile; omegaCoeffs { file \"<constant>/turns\"; outOfBounds error; } value uniform (0 0 0); }" 0/U
plain 3 6
ride "$dmd"
expect_log 'inputs that are known beforehand: U at cylinder'
replaces 0.25 'a cylinder that turns'
close_to ../plain 0.04 3/U 6/U
mv U 0/U
control endTime 3

# Constant, and from 1.4 s on another: no stride over the change
inlet 'type uniformFixedValue; uniformValue table ((0 (0.2 0 0)) (1.4 (0.2 0 0)) (1.5 (0.25 0 0)) (9 (0.25 0 0))); value uniform (0.2 0 0);'
plain 1.5 3
ride "$dmd"
expect_log 'the input U at inlet will be other'
close_to ../plain 0.01 3/U

# With a state of its own, which is no field
clean_case
inlet 'type fixedValue; value uniform (0.2 0 0);'
cp 0/p p
foamDictionary -entry boundaryField/outlet -set '{ type plenumPressure; gamma 1.4; R 287.04; rho 1; supplyMassFlowRate 0; supplyTotalTemperature 300;
    plenumVolume 1; plenumDensity 1.1624; plenumTemperature 300; inletAreaRatio 1; inletDischargeCoefficient 1; timeScale 1e-4; value uniform 1e5; }' 0/p > log.set
refused 'p at outlet plenum' icoFoam
mv p 0/p

# By chance
clean_case
inlet 'type turbulentInlet; referenceField uniform (0.2 0 0); fluctuationScale (0.02 0.01 0.01); value uniform (0.2 0 0);'
refused 'Nobody can say beforehand what the condition turbulentInlet of U at the patch inlet' icoFoam

# A table over the radius is none over time
clean_case
control endTime 0.02
inlet 'type swirlInletVelocity; origin (0 0.2 0); axis (1 0 0); axialVelocity table ((0 0.2) (1 0.2)); radialVelocity constant 0;
    tangentialVelocity constant 0; value uniform (0.2 0 0);'
ride "$dmd"
expect_silence 'inputs that are known beforehand'
