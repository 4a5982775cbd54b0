#!/usr/bin/env bash
# Bad input of the function objects: a clear message, an exit status that is not 0.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case

good="mode replace; solverSteps 5; surrogateSteps 2;"
surrogate() { function_object m4gnSurrogate "$*"; }

surrogate "$good model \"$small_model\"; tua 3;"
refused 'tua: unknown entry, expected one of backend,' icoFoam
grep -q 'Other entries that it may have: .*solverSteps' log.run || fail "the valid entries are not named"
surrogate "$good model \"$small_model\"; segments { cuont 3; }"
refused 'segments.cuont: unknown entry, .*is count meant?' icoFoam
surrogate "$good model \"$small_model\"; nodeTypes { inlt inlet; }"
refused 'fit no patch' icoFoam
surrogate "$good model \"$small_model\"; nodeTypes { inlet inlt; }"
refused 'the type inlt' icoFoam
surrogate "mode replace; model \"$small_model\"; surrogateSteps 2;"
refused 'solverSteps' icoFoam
surrogate "mode replce; model \"$small_model\";"
refused 'mode: expected observe or replace, found replce; is replace meant' icoFoam
surrogate "mode accelerate; model \"$small_model\";"
refused 'mode: expected observe or replace, found accelerate' icoFoam
function_object m4gnSurrogate "mode replace; surrogates (dmd); dmd { keep no; file states; }"
refused 'dmd has no entry file' icoFoam
surrogate "$good model missing.safetensors;"
refused 'There is no model' icoFoam

head -c 9000 "$small_model" > half.safetensors
surrogate "$good model half.safetensors;"
refused 'half.safetensors' icoFoam
# Two ranks end as well
runs decomposePar -force
refused 'half.safetensors' timeout 120 mpirun -np 2 icoFoam -parallel
rm -r processor*

# Same length, so that the offsets in the header stay right
sed 's/\\"name\\":\\"p\\"/\\"name\\":\\"T\\"/' "$small_model" > other.safetensors
surrogate "$good model other.safetensors;"
refused 'for the field T' icoFoam
sed 's/\[0,2,-2,0,0,0,0\]/[1,0,-1,0,0,0,0]/; s/\[0,2,-2,0,0,0,0\]/[1,0,-1,0,0,0,0]/' "$small_model" > units.safetensors
cmp -s units.safetensors "$small_model" && fail "the test did not change the units"
surrogate "$good model units.safetensors;"
refused 'with the dimensions' icoFoam
surrogate "$good model \"$small_model\"; nodeTypes { cylinder obstacle; }"
refused 'obstacle' icoFoam
surrogate "$good model \"$small_model\"; segments { count 100000; }"
refused '100000' icoFoam
surrogate "$good model \"$small_model\"; segments { method slic-mdodx; }"
refused 'segments.method: expected one of metis, .*, slic-mdode, found slic-mdodx; is slic-mdode meant' icoFoam
surrogate "$good model \"$small_model\"; segments { tau -2; }"
refused 'segments.tau: expected a finite number that is not negative' icoFoam
surrogate "$good model \"$small_model\"; segments { method slic-mdode; obstacles (cylnder); }"
refused 'cylnder: expected some of the patches' icoFoam
surrogate "$good model \"$small_model\"; segments { connected maybe; }"
refused 'segments.connected: expected yes or no' icoFoam
surrogate "$good model \"$small_model\"; nThreads two;"
refused 'nThreads: expected a whole number' icoFoam
cp system/controlDict controlDict
sed -i 's/^deltaT .*/deltaT 0.02;/' system/controlDict
surrogate "$good model \"$small_model\";"
refused 'shorter than' icoFoam
cp controlDict system/controlDict
cp system/fvSchemes fvSchemes
sed -i '/ddtSchemes/,/}/s/default .*/default CrankNicolson 0.9;/' system/fvSchemes
refused 'Handled: Euler, backward' icoFoam
cp fvSchemes system/fvSchemes

function_object m4gnRecorder 'field (U p);'
refused 'field: unknown entry, expected one of path' icoFoam
function_object m4gnRecorder 'split trian;'
refused 'split: expected one of train, valid, test, found trian; is train meant?' icoFoam
function_object m4gnRecorder 'fields (U T);'
refused 'Field T is neither' icoFoam
[ ! -e postProcessing/test/0/trajectory.h5 ] || fail "a refused recording left a file"

# A patch type that is not handled
cp -r 0 0.keep
cp constant/polyMesh/boundary boundary
sed -i '/^ *inlet$/,/}/s/type  *patch;/type mappedPatch; sampleMode nearestPatchFace; sampleRegion region0; samplePatch outlet; offsetMode uniform; offset (0 0 0);/' \
    constant/polyMesh/boundary
function_object m4gnRecorder
refused 'Patch inlet is of type mappedPatch' icoFoam
cp boundary constant/polyMesh/boundary
echo "bad-input: passed"
