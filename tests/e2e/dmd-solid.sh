#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd) in a solver of second order in time: a beam that vibrates. The solver carries on from a
# displacement and its old level, which is a state at its own time step before.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_beam case
sed -i 's/^endTime .*/endTime 2.5;/; s/^writeInterval .*/writeInterval 250;/' system/controlDict
sed -i 's/compactNormalStress.*;/compactNormalStress yes; nCorrectors 20; D 1e-7;/' system/fvSolution
plain solidDisplacementFoam 1.25 2.5

function_object m4gnSurrogate 'mode replace; surrogates (dmd); dmd { snapshotInterval 0.025; minSnapshots 24; fitTolerance 0.025; }'
runs solidDisplacementFoam
grep -q '^m4gn: the dmd surrogate advances D and, with them, .*divSigmaExp, .*sigmaD' log.run || fail "the stress is not handed over"
replaces 0.4 'a beam'
# Over what half of the run changes
hold=$(difference ../plain/2.5/D ../plain/1.25/D)
below "$(difference ../plain/2.5/D 2.5/D)" "$(awk "BEGIN { print 0.05*$hold }")" "largest error of D"
for time in 1.25 2.5; do
    for field in sigma sigmaEq; do
        below "$(difference "../plain/$time/$field" "$time/$field")" 0.1 "$field at $time, in the run's jumps"
    done
done

# Carried on in a jump and behind one: the old levels are part of what is written
mkdir ../whole && cp -r 1.25 2.5 postProcessing ../whole
clean_case
rm -rf postProcessing
cp -r ../whole/1.25 ../whole/postProcessing .
sed -i 's/^startTime .*/startTime 1.25;/' system/controlDict
runs solidDisplacementFoam
grep -q 'm4gn: test goes on from its state at time 1.25' log.run || fail "the state was not read"
below "$(difference ../whole/2.5/D 2.5/D)" 1e-3 "D carried on"
