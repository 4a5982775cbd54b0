#!/usr/bin/env bash
# The function object m4gnPredictor, without libm4gn.so: less work, the same answer.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
# The accelerators load where there is no core
mkdir "$work/accelerators" && cp "$M4GN_HOME/lib/libm4gnAccelerators.so" "$work/accelerators"
whole=$LD_LIBRARY_PATH
export LD_LIBRARY_PATH=${whole//"$M4GN_HOME/lib"/"$work/accelerators"}
echo 'test { type m4gnPredictor; libs (m4gnAccelerators); }' > system/functions
refused 'needs a displacement D, sigmaD, divSigmaExp' icoFoam
# A solid: the displacement from which the correctors of a time step begin
cd "$work"
make_beam beam
sed -i 's/compactNormalStress.*;/compactNormalStress no; nCorrectors 500; D 1e-5;/' system/fvSolution
sed -i 's/endTime  *0.255/endTime 0.1/; s/deltaT  *0.005/deltaT 0.002/; s/writeInterval 1;/writeInterval 10;/' system/controlDict
correctors() { grep -c 'Solving for Dx' log.run; }
runs solidDisplacementFoam
mkdir ../alone-beam && mv 0.1 ../alone-beam
plain=$(correctors)
for predictor in linear quadratic; do
    clean_case
    echo "test { type m4gnPredictor; libs (m4gnAccelerators); predictor $predictor; }" > system/functions
    runs solidDisplacementFoam
    ! grep -q 'ended at nCorrectors' log.run || fail "a time step that converged is said to have ended at nCorrectors"
    used=$(correctors)
    echo "$predictor: $used correctors, $plain without"
    [ $((4*used)) -lt $((3*plain)) ] || fail "predictor $predictor takes more than three quarters of the correctors"
    below "$(difference 0.1/D ../alone-beam/0.1/D)" 5e-3 "difference of D with predictor $predictor"
done
mv 0.02 ../serial-beam
clean_case
control endTime 0.02
cp "$M4GN_HOME/openfoam/tutorials/cylinder/system/decomposeParDict" system
solve 2
reconstructPar -time 0.02 > log.reconstruct 2>&1 || fail "reconstructPar"
below "$(difference 0.02/D ../serial-beam/D)" 5e-3 "difference of D on two ranks"
# Time steps that end before the tolerance begin elsewhere, and end elsewhere
clean_case
sed -i 's/nCorrectors 500;/nCorrectors 5;/' system/fvSolution
runs solidDisplacementFoam
grep -q 'ended at nCorrectors 5 with a residual of .*; expected less than entry D of stressAnalysis, 1e-05' log.run ||
    fail "nothing says that time steps end at nCorrectors"
grep -q '^m4gn: [1-9][0-9]* time steps ended at nCorrectors, and have another result' log.run || fail "nothing at the end of the run"
sed -i 's/nCorrectors 5;/nCorrectors 500;/' system/fvSolution

export LD_LIBRARY_PATH=$whole
echo 'test { type m4gnPredictor; libs (m4gnFoam); } last { type m4gnRecorder; libs (m4gnFoam); fields (D); }' > system/functions
clean_case
refused 'Function object last comes after test of type m4gnPredictor' solidDisplacementFoam
function_object m4gnPredictor 'predictor cubic;'
refused 'Entry predictor is cubic; expected linear or quadratic' solidDisplacementFoam
function_object m4gnPredictor ''
sed -i 's/nCorrectors 500;//' system/fvSolution
refused 'nCorrectors of stressAnalysis in fvSolution is 1' solidDisplacementFoam
