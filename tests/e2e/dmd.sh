#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd): no model; against the plain run, on two ranks, carried on, refused where it cannot be.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
sed -i 's/^endTime .*/endTime 4;/; s/^writeInterval .*/writeInterval 0.25;/; s/^writeFormat .*/writeFormat binary;/' system/controlDict
sed -i 's/tolerance  *1e-10/tolerance 1e-7/; s/relTol  *0;/relTol 0.05;/' system/fvSolution
# Files of time 4 as text
ascii() {
    sed -i 's/^writeFormat .*/writeFormat ascii;/' system/controlDict
    foamFormatConvert -time 4 -noFunctionObjects > log.ascii 2>&1 || { tail -n 5 log.ascii; fail "foamFormatConvert"; }
    sed -i 's/^writeFormat .*/writeFormat binary;/' system/controlDict
}
largest() { awk '/^time step continuity errors/ { sub(",", "", $9); if ($9 > m) m = $9 } END { print m + 0 }' "$1"; }

runs icoFoam
plain=$(largest log.run)
mkdir ../plain && cp -r 4 2 ../plain

dmd() { function_object m4gnSurrogate "mode replace; surrogates (dmd); timeStart 2; dmd { snapshotInterval 0.05; minSnapshots 24; fitTolerance 0.025; $* }"; }
dmd
clean_case
runs icoFoam
grep -q '^m4gn: the dmd surrogate advances U, p, phi' log.run || { grep m4gn log.run; fail "the fields are not named"; }
# A pressure without an equation in time is carried: the noise of its tolerance is none of the fit's
grep -q 'of the variation: U [^,]*); it is used' log.run || { grep 'fit of' log.run; fail "the fit is not made of U alone"; }
replaces 0.2 icoFoam
jumps=$(grep -vc '^#' postProcessing/test/0/surrogate.dat)
# What is handed back is as free of divergence as the solver's own, and so is the solver's next step
below "$(largest log.run)" "$(awk "BEGIN { print 1.5*$plain }")" "largest continuity error"
mkdir ../whole && cp -r [0-9]* postProcessing ../whole
# Over what the wake changes
cp -r 4 4.hybrid && rm -rf 4 && cp -r ../plain/4 4 && ascii && cp 4/U ../U.plain
rm -rf 4 && cp -r ../plain/2 4 && ascii && cp 4/U ../U.hold
rm -rf 4 && mv 4.hybrid 4 && ascii && cp 4/U ../U.hybrid
hold=$(difference ../U.plain ../U.hold)
below "$(difference ../U.plain ../U.hybrid)" "$(awk "BEGIN { print 0.2*$hold }")" "largest error of U after $jumps jumps"

# Carried on behind a step of the solver, and in a jump
for time in 2.25 3; do
    clean_case
    rm -rf postProcessing
    cp -r "../whole/$time" ../whole/postProcessing .
    sed -i "s/^startTime .*/startTime $time;/" system/controlDict
    runs icoFoam
    grep -q "m4gn: test goes on from its state at time $time" log.run || { cat log.run; fail "$time: the state was not read"; }
    for file in U p phi; do
        cmp "4/$file" "../whole/4/$file" || { grep m4gn log.run; fail "carried on at $time: other bytes of $file"; }
    done
done
sed -i 's/^startTime .*/startTime 0;/' system/controlDict

# Two ranks
clean_case
on_two_ranks icoFoam
runs reconstructPar -latestTime
ascii
below "$(difference ../U.hybrid 4/U)" 1e-2 "U on two ranks"

# What cannot be
dmd 'maxJump 5;'
refused 'maxJump from initialJump to' icoFoam
dmd 'snapshotIntervall 0.05;'
refused 'interval' icoFoam
