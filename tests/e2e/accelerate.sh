#!/usr/bin/env bash
# The linear solver m4gnPredicted and the function object m4gnPredictor, without libm4gn.so: less work, the same answer.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
# The accelerators load where there is no core
mkdir "$work/accelerators" && cp "$M4GN_HOME/lib/libm4gnAccelerators.so" "$work/accelerators"
whole=$LD_LIBRARY_PATH
export LD_LIBRARY_PATH=${whole//"$M4GN_HOME/lib"/"$work/accelerators"}
sed -i 's/^functions/libs (m4gnAccelerators);\nfunctions/; s/endTime  *0.06/endTime 0.1/' system/controlDict
cp system/fvSolution ../plain
runs icoFoam
mkdir ../alone && cp -r 0.1 ../alone

# with LINEAR_SOLVER PREDICTOR: the pressure is solved for that way. Where a time step begins from another guess, its answer
# differs by what the tolerance leaves.
with() { sed "s/\\(^ *\\)solver  *GAMG;/\\1solver m4gnPredicted; linearSolver $1; predictor $2;/" ../plain > system/fvSolution; }
iterations() { awk '/Solving for p,/ { s += $NF } END { print s }' log.run; }

plain=$(iterations)
for predictor in none linear quadratic auto; do
    clean_case
    with GAMG $predictor
    runs icoFoam
    used=$(iterations)
    echo "$predictor: $used iterations for p, $plain without"
    case $predictor in
    none)
        for field in U p phi; do
            cmp 0.1/$field ../alone/0.1/$field || fail "predictor none has changed $field"
        done ;;
    *)
        [ "$used" -lt "$plain" ] || fail "predictor $predictor saves no iterations: $used, without it $plain"
        below "$(difference 0.1/U ../alone/0.1/U)" 1e-8 "difference of U with predictor $predictor" ;;
    esac
done
grep -q 'GAMG:\(linear\|quadratic\):  Solving for p' log.run || fail "the log does not name the guess"

mv 0.1 ../serial
clean_case
on_two_ranks icoFoam
reconstructPar -time 0.1 > log.reconstruct 2>&1 || fail "reconstructPar"
below "$(difference 0.1/U ../serial/U)" 1e-8 "difference of U on two ranks"

with GAMG cubic
refused 'Entry predictor is cubic; expected linear, none, quadratic, auto' icoFoam
with m4gnPredicted auto
refused 'Entry linearSolver is m4gnPredicted itself' icoFoam
sed '/linearSolver/s/linearSolver GAMG;//' <(with GAMG auto; cat system/fvSolution) > ../missing
cp ../missing system/fvSolution
refused 'linearSolver' icoFoam
cp ../plain system/fvSolution
echo 'test { type m4gnPredictor; libs (m4gnAccelerators); }' > system/functions
refused 'needs a displacement D, sigmaD, divSigmaExp' icoFoam
export LD_LIBRARY_PATH=$whole
# A solid: the displacement from which the correctors of a time step begin
cd "$work"
make_beam beam
sed -i 's/compactNormalStress.*;/compactNormalStress no; nCorrectors 500; D 1e-5;/' system/fvSolution
sed -i 's/endTime  *0.255/endTime 0.1/; s/deltaT  *0.005/deltaT 0.002/; s/writeInterval 1;/writeInterval 50;/' system/controlDict
correctors() { grep -c 'Solving for Dx' log.run; }
runs solidDisplacementFoam
mkdir ../alone-beam && mv 0.1 ../alone-beam
plain=$(correctors)
for predictor in none linear quadratic auto; do
    clean_case
    echo "test { type m4gnPredictor; libs (m4gnAccelerators); predictor $predictor; }" > system/functions
    runs solidDisplacementFoam
    used=$(correctors)
    echo "$predictor: $used correctors, $plain without"
    case $predictor in
    none) cmp 0.1/D ../alone-beam/0.1/D || fail "predictor none has changed D" ;;
    *) [ $((4*used)) -lt $((3*plain)) ] || fail "predictor $predictor takes more than three quarters of the correctors" ;;
    esac
    below "$(difference 0.1/D ../alone-beam/0.1/D)" 5e-3 "difference of D with predictor $predictor"
done
grep -q '^m4gn: D by predictor: .* linear: .* correctors' log.run || { tail log.run; fail "no report of the work"; }

mv 0.1 ../serial-beam
clean_case
cp "$M4GN_HOME/openfoam/tutorials/beam/system/decomposeParDict" system
on_two_ranks solidDisplacementFoam
reconstructPar -time 0.1 > log.reconstruct 2>&1 || fail "reconstructPar"
below "$(difference 0.1/D ../serial-beam/D)" 5e-3 "difference of D on two ranks"

echo 'test { type m4gnPredictor; libs (m4gnFoam); } last { type m4gnHarvest; libs (m4gnFoam); fields (D); }' > system/functions
clean_case
refused 'Function object last comes after test of type m4gnPredictor' solidDisplacementFoam
function_object m4gnPredictor ''
sed -i 's/nCorrectors 500;//' system/fvSolution
refused 'nCorrectors of stressAnalysis in fvSolution is 1' solidDisplacementFoam
echo "accelerate: passed"
