#!/usr/bin/env bash
# m4gnAnderson in solidDisplacementFoam, without libm4gn.so: a fraction of the correctors, the same answer.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
# The accelerators load where there is no core
mkdir "$work/accelerators" && cp "$M4GN_HOME/lib/libm4gnAccelerators.so" "$work/accelerators"
export LD_LIBRARY_PATH=${LD_LIBRARY_PATH//"$M4GN_HOME/lib"/"$work/accelerators"}
anderson='test { type m4gnAnderson; libs (m4gnAccelerators); }'
echo "$anderson" > system/functions
runs icoFoam
expect_log 'test leaves all time steps to the solver: neither solids4Foam nor solidDisplacementFoam solves for a solid'

cd "$work"
make_beam beam
sed -i 's/compactNormalStress.*;/compactNormalStress no; nCorrectors 500; D 1e-5;/' system/fvSolution
sed -i 's/endTime  *0.255/endTime 0.1/; s/deltaT  *0.005/deltaT 0.002/; s/writeInterval 1;/writeInterval 10;/' system/controlDict
# The solver's own, and those of steps that were solved ahead
correctors() { echo $(($(grep -c 'Solving for Dx' log.run) + $(sed -n 's/^m4gn: .* solved ahead in \([0-9]*\) correctors.*/\1/p' log.run))); }
for compact in no yes; do
    sed -i "s/compactNormalStress [a-z]*;/compactNormalStress $compact;/" system/fvSolution
    clean_case
    : > system/functions
    runs solidDisplacementFoam
    rm -rf ../plain && mkdir ../plain && mv 0.1 0.02 ../plain
    plain=$(grep -c 'Solving for Dx' log.run)
    clean_case
    echo "${anderson%\}*} compare no; }" > system/functions
    runs solidDisplacementFoam
    ! grep -q 'ended at nCorrectors' log.run || fail "a time step that converged is said to have ended at nCorrectors"
    grep -q '"time_steps_solved": 50, .*"time_steps_left": 0}' postProcessing/test/0/summary.json || fail "not all time steps were solved"
    used=$(correctors)
    echo "compactNormalStress $compact: $used correctors, $plain without"
    [ $((3*used)) -lt "$plain" ] || fail "m4gnAnderson takes more than a third of the correctors"
    below "$(difference 0.1/D ../plain/0.1/D)" 5e-3 "difference of D with compactNormalStress $compact"
done
clean_case
control endTime 0.02
cp "$M4GN_HOME/openfoam/tutorials/cylinder/system/decomposeParDict" system
solve 2
reconstructPar -time 0.02 > log.reconstruct 2>&1 || fail "reconstructPar"
below "$(difference 0.02/D ../plain/0.02/D)" 5e-3 "difference of D on two ranks"
# All components in one system
clean_case
sed -i 's/^solvers.*/solvers { D { type coupled; solver PBiCCCG; preconditioner DILU; tolerance (0 0 0); relTol (0.01 0.01 0.01); } }/' system/fvSolution
runs solidDisplacementFoam
below "$(difference 0.02/D ../plain/0.02/D)" 5e-3 "difference of D with a coupled solver"
# Time steps that end before the tolerance have another result
clean_case
echo "$anderson" > system/functions
sed -i 's/nCorrectors 500;/nCorrectors 5;/' system/fvSolution
control endTime 0.1
runs solidDisplacementFoam
grep -q "solver's last time step ended at nCorrectors 5 with a residual of .*; expected at most entry D of stressAnalysis, 1e-05" log.run ||
    fail "nothing says that time steps end at nCorrectors"
sed -i 's/nCorrectors 5;//' system/fvSolution
clean_case
runs solidDisplacementFoam
expect_log 'leaves all time steps to the solver: nCorrectors of stressAnalysis in fvSolution is 1'
