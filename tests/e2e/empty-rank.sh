#!/usr/bin/env bash
# A rank without cells, as a decomposition by hand or redistributePar may leave one: recording, observing and replacing work, and the
# answer is that of one rank.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
record='record { type m4gnRecorder; libs (m4gnFoam); fields (U p); file "trajectory.h5"; }'
observe="observe { type m4gnSurrogate; libs (m4gnFoam); mode observe; model \"$small_model\"; }"
replace="replace { type m4gnSurrogate; libs (m4gnFoam); mode replace; model \"$small_model\"; solverSteps 10; surrogateSteps 2; }"

echo "$replace" > system/functions
runs icoFoam
mv 0.06 ../serial
clean_case

cells=$(sed -n 's/.*nCells: *\([0-9]*\).*/\1/p' constant/polyMesh/owner | head -n 1)
{
    header decompositionByHand labelList
    echo "$cells ("
    for ((i = 0; i < cells; ++i)); do echo $((i < cells/2 ? 0 : 2)); done
    echo ')'
} > constant/decompositionByHand
decomposition 3 manual 'manualCoeffs { dataFile "decompositionByHand"; }'
for functions in "$record $observe" "$replace"; do
    echo "$functions" > system/functions
    rm -rf processor*
    runs decomposePar
    grep -q 'Number of cells = 0' log.run || fail "no rank is without cells"
    runs mpirun -np 3 icoFoam -parallel
done
m4gn info trajectory.h5 > info || fail "the recording cannot be read"
grep -q 'frames' info || fail "the recording has no frames"
reconstructPar -time 0.06 > log.reconstruct 2>&1 || fail "reconstructPar"
below "$(difference 0.06/U ../serial/U)" 1e-5 "difference of U with a rank without cells"

# The first rank reads the model: the others may see another disk
echo "observe { type m4gnSurrogate; libs (m4gnFoam); mode observe; model cylinder-flow.safetensors; }" > system/functions
rm -rf processor*
control endTime 0.01
runs decomposePar
runs mpirun -np 1 icoFoam -parallel : -np 2 env M4GN_HOME=/nowhere icoFoam -parallel
expect_log 'm4gn: model .*ready in'
