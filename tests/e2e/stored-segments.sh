#!/usr/bin/env bash
# m4gnSegment is computed once: decomposePar, parallel runs, reconstructPar, restarts and renumberMesh keep it.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
function_object m4gnSurrogate "mode observe; model \"$small_model\"; writeControl writeTime;"
sed -i 's/^writeFormat .*/writeFormat binary;/; s/^writeInterval .*/writeInterval 0.01;/' system/controlDict
echo 'libs (m4gnFoam);' >> system/controlDict

# until TIME [from TIME]: end and start of the run
until() { sed -i "s/^endTime .*/endTime $1;/; s/^startFrom .*/startFrom ${2:-startTime};/" system/controlDict; }
stores() { ! grep -q 'segments read' log.run || fail "$1: segments were read, though none should be stored"; }
reads() { grep -q "segments read from .*$1" log.run || { grep segments log.run; fail "$2: no segments were read from $1"; }; }
segments() { runs foamFormatConvert -time "$1"; values "$1/m4gnSegment"; }

# Serial, then in parallel from the latest time, of which decomposePar decomposes nothing else
until 0.01
runs icoFoam
stores "serial run"
runs foamFormatConvert -noConstant -time 0
