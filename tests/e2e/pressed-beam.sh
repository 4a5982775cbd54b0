#!/usr/bin/env bash
# The example of a host of one's own: it builds by itself, its beam bends as finite elements say, and what it cannot do it says.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

cmake -S "$M4GN_HOME/examples/pressed_beam" -B build > log.cmake && cmake --build build >> log.cmake || fail "$(tail -n 20 log.cmake)"
mkdir states
build/pressed_beam "$M4GN_HOME/models/deforming-beam.safetensors" states > log || fail "pressed_beam ended with status $?"
cat log

# examples/pressed_beam/reference.py: FElupe's tip is down by 26.56 mm after 50 steps and by 47.77 mm after 100.
awk '
    function off(found, expected) { return found/expected - 1 > 0.1 || found/expected - 1 < -0.1 }
    $1 == 50 && NF == 5 { ++rows; if (off($3, -26.56)) bad = 1 }
    $1 == 100 && NF == 5 { ++rows; if (off($3, -47.77)) bad = 1 }
    $1 ~ /^[0-9]+$/ && NF == 5 && $5 < -0.01 { bad = 1 }
    END { exit bad || rows != 2 }' log || fail "the tip is not where FElupe has it, or the cylinder is in the beam"
[ "$(ls states | wc -l)" = 11 ] || fail "states: $(ls states)"
# 1560 points, each with a finite displacement.
awk 'found && NF == 3 && $1 + 0 == $1 { ++n } /^VECTORS D/ { found = 1 } END { exit n != 1560 }' states/state-100.vtk \
    || fail "state-100.vtk does not have 1560 displacements"

# Refused with a message, not with a crash.
refused() {
    local status=0
    build/pressed_beam "${@:2}" > log 2>&1 || status=$?
    [ "$status" = 1 ] || fail "status $status of pressed_beam ${*:2}: $(cat log)"
    grep -q "$1" log || fail "expected '$1': $(cat log)"
}
refused 'no-such-file' no-such-file
refused 'contact' "$M4GN_HOME/models/cylinder-flow.safetensors"
refused 'cannot write' "$M4GN_HOME/models/deforming-beam.safetensors" no-such-folder
echo "pressed-beam: passed"
