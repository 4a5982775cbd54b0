#!/usr/bin/env bash
# Bad input of flows: what was expected, found, where, what to do; two ranks end as one; no half files.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
good="mode replace; solverSteps 5; surrogateSteps 2;"
own="$good $small"

expect_error 'tua: unknown entry, expected one of backend,' "$own tua 3;"
expect_log 'Other entries that it may have: .*solverSteps'
expect_errors <<EOD
mode replce; $small => mode: expected observe or replace, found replce; is replace meant
mode replace; surrogates (dmd); dmd { keep no; file states; } => dmd.file: unknown entry
$good model missing.safetensors; => There is no model
$own nodeTypes { cylinder obstacle; } => obstacle
$own segments { count 100000; } => 100000
$own segments { method slic-mdode; obstacles (cylnder); } => cylnder: expected some of the patches
EOD

head -c 9000 "$small_model" > half.safetensors
expect_error 'half.safetensors' "$good model half.safetensors;"
# Two ranks end as well
runs decomposePar -force
refused 'half.safetensors' timeout 120 mpirun -np 2 icoFoam -parallel
rm -r processor*

# Same length, so that the offsets in the header stay right
sed 's/\\"name\\":\\"p\\"/\\"name\\":\\"T\\"/' "$small_model" > other.safetensors
expect_error 'for the field T' "$good model other.safetensors;"
sed 's/\[0,2,-2,0,0,0,0\]/[1,0,-1,0,0,0,0]/; s/\[0,2,-2,0,0,0,0\]/[1,0,-1,0,0,0,0]/' "$small_model" > units.safetensors
cmp -s units.safetensors "$small_model" && fail "the test did not change the units"
expect_error 'with the dimensions' "$good model units.safetensors;"
control deltaT 0.02
expect_error 'shorter than' "$own"
control deltaT 0.002
ddt_scheme 'CrankNicolson 0.9'
refused 'Handled: Euler, backward' icoFoam
ddt_scheme Euler

expect_errors m4gnRecorder <<'EOD'
field (U p); => field: unknown entry; is fields meant
split trian; => split: expected one of train, valid, test, found trian; is train meant?
fields (U T); => Field T is neither
EOD
[ ! -e postProcessing/test/0/trajectory.h5 ] || fail "a refused recording left a file"

# A patch type that is not handled
sed -i '/^ *inlet$/,/}/s/type  *patch;/type mappedPatch; sampleMode nearestPatchFace; sampleRegion region0; samplePatch outlet; offsetMode uniform; offset (0 0 0);/' \
    constant/polyMesh/boundary
recorder
refused 'Patch inlet is of type mappedPatch' icoFoam
