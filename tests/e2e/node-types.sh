#!/usr/bin/env bash
# What boundary faces stand for: conditions that let go of the value (inletOutlet, freestreamVelocity), the table at the
# start, patches that are not handled.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
sed -i 's/^endTime .*/endTime 0.03;/' system/controlDict
cp -r 0 ../start
function_object m4gnSurrogate "mode observe; model \"$small_model\"; timeStart 0.01; rolloutSteps 3;"
# says PATCH TYPE WHY: a line of the table of node types
says() { grep -q "^    $1: $2 ($3)" log.run || { grep -A 6 'node types' log.run; fail "expected $1: $2 ($3)"; }; }

runs icoFoam
says inlet inlet 'U fixedProfile'
says outlet outlet 'U zeroGradient, p fixedValue'
says cylinder wall 'patch type wall'

outlet() {
    clean_case
    rm -rf 0 && cp -r ../start 0
    python3 - 0/U "$1" 0/p "$2" <<'PYTHON'
import re, sys
for file, entries in zip(sys.argv[1::2], sys.argv[2::2]):
    text = open(file).read()
    text, n = re.subn(r"(\n    outlet\s*\{)[^}]*\}", lambda m: m[1] + " " + entries + " }", text)
    assert n == 1, file
    open(file, "w").write(text)
PYTHON
}
outlet 'type inletOutlet; inletValue uniform (0 0 0); value uniform (0 0 0);' 'type fixedValue; value uniform 0;'
runs icoFoam
says outlet outlet 'U inletOutlet, flow leaves'
sed -i 's/timeStart 0.01/timeStart 0/' system/functions
clean_case
runs icoFoam
says outlet outlet 'U inletOutlet, flow leaves'

outlet 'type freestreamVelocity; freestreamValue uniform (1 0 0); value uniform (1 0 0);' \
    'type freestreamPressure; freestreamValue uniform 0; value uniform 0;'
runs icoFoam
says outlet outlet 'U freestreamVelocity, flow leaves'
says inlet inlet 'U fixedProfile'

# Two ranks, one of them without the outlet
outlet 'type inletOutlet; inletValue uniform (0 0 0); value uniform (0 0 0);' 'type fixedValue; value uniform 0;'
on_two_ranks icoFoam
says outlet outlet 'U inletOutlet, flow leaves'

# Said otherwise
function_object m4gnSurrogate "mode observe; model \"$small_model\"; nodeTypes { outlet inlet; }"
clean_case
runs icoFoam
says outlet inlet 'entry nodeTypes'

# Told by the flow at the start, and kept by a run that is carried on, whatever the flow does by then
outlet 'type inletOutlet; inletValue uniform (0 0 0); value uniform (0 0 0);' 'type fixedValue; value uniform 0;'
function_object m4gnSurrogate "mode replace; model \"$small_model\"; solverSteps 2; surrogateSteps 2;"
runs icoFoam
says outlet outlet 'U inletOutlet, flow leaves'
sed -i 's/^startFrom .*/startFrom latestTime;/; s/^endTime .*/endTime 0.08;/' system/controlDict
runs icoFoam
says outlet outlet 'entry nodeTypes'
sed -i 's/^startFrom .*/startFrom startTime;/; s/^endTime .*/endTime 0.06;/' system/controlDict

# A recording says it as well
function_object m4gnRecorder
clean_case
runs icoFoam
says outlet outlet 'U inletOutlet, flow leaves'
m4gn info postProcessing/test/0/trajectory.h5 > ../info
grep -q '^patch  *outlet .*outlet' <(sed 's/^patch  *outlet/& /' ../info) || { cat ../info; fail "another type was recorded"; }

# A patch that no node type helps is refused at once
mkdir -p ../wedge/0 ../wedge/system && cp -r constant ../wedge && rm -rf ../wedge/constant/polyMesh
cp system/fvSchemes system/fvSolution system/controlDict system/functions ../wedge/system && cd ../wedge
wedge '8 4 1'
echo "$(header U volVectorField) dimensions [0 1 -1 0 0 0 0]; internalField uniform (0 0 0);
boundaryField { inlet { type fixedValue; value uniform (1 0 0); } outlet { type zeroGradient; } wall { type noSlip; }
front { type wedge; } back { type wedge; } axis { type empty; } }" > 0/U
echo "$(header p volScalarField) dimensions [0 2 -2 0 0 0 0]; internalField uniform 0;
boundaryField { inlet { type zeroGradient; } outlet { type fixedValue; value uniform 0; } wall { type zeroGradient; }
front { type wedge; } back { type wedge; } axis { type empty; } }" > 0/p
function_object m4gnRecorder
refused 'Patch back is of type wedge, which m4gn does not handle' icoFoam
! grep -q 'nodeTypes {' log.run || { cat log.run; fail "a node type is advised that does not help"; }
echo "node-types: passed"
