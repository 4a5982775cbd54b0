#!/usr/bin/env bash
# What boundary faces stand for: conditions that let go of the value (inletOutlet, freestreamVelocity), the table at the
# start, patches that are not handled.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 0.03
cp -r 0 ../start
# says PATCH TYPE WHY: a line of the table of node types
says() { expect_log "^    $1: $2 ($3)"; }

ride "mode observe; $small timeStart 0.01; rolloutSteps 3;"
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
leaves='type inletOutlet; inletValue uniform (0 0 0); value uniform (0 0 0);'
outlet "$leaves" 'type fixedValue; value uniform 0;'
solve
says outlet outlet 'U inletOutlet, flow leaves'
ride "mode observe; $small timeStart 0; rolloutSteps 3;"
says outlet outlet 'U inletOutlet, flow leaves'

outlet 'type freestreamVelocity; freestreamValue uniform (1 0 0); value uniform (1 0 0);' \
    'type freestreamPressure; freestreamValue uniform 0; value uniform 0;'
solve
says outlet outlet 'U freestreamVelocity, flow leaves'
says inlet inlet 'U fixedProfile'

# Two ranks, one of them without the outlet
outlet "$leaves" 'type fixedValue; value uniform 0;'
solve 2
says outlet outlet 'U inletOutlet, flow leaves'

# As the dictionary has it
ride "mode observe; $small nodeTypes { outlet inlet; }"
says outlet inlet 'entry nodeTypes'

# By the flow at the start, also in a run that is carried on, whatever the flow does by then
outlet "$leaves" 'type fixedValue; value uniform 0;'
ride "mode replace; $small solverSteps 2; surrogateSteps 2;"
says outlet outlet 'U inletOutlet, flow leaves'
control startFrom latestTime endTime 0.08
solve
says outlet outlet 'entry nodeTypes'
control startFrom startTime endTime 0.06

# A recording says it as well
record
says outlet outlet 'U inletOutlet, flow leaves'
m4gn info postProcessing/test/0/trajectory.h5 > ../info
grep -q '^patch  *outlet .*outlet' <(sed 's/^patch  *outlet/& /' ../info) || { cat ../info; fail "another type was recorded"; }

# A patch that no node type helps is refused at once
mkdir -p ../wedge/0 ../wedge/system && cp -r constant ../wedge && rm -rf ../wedge/constant/polyMesh
cp system/fvSchemes system/fvSolution system/controlDict system/functions ../wedge/system && cd ../wedge
wedge '8 4 1'
others='front { type wedge; } back { type wedge; } axis { type empty; }'
field U volVectorField '0 1 -1 0 0 0 0' '(0 0 0)' "inlet { type fixedValue; value uniform (1 0 0); } outlet { type zeroGradient; }
    wall { type noSlip; } $others"
field p volScalarField '0 2 -2 0 0 0 0' 0 "outlet { type fixedValue; value uniform 0; } \"inlet|wall\" { type zeroGradient; } $others"
recorder
refused 'Patch back is of type wedge, which m4gn does not handle' icoFoam
# A node type would not help
expect_silence 'nodeTypes {'
