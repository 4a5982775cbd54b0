#!/usr/bin/env bash
# examples/body_host: the beam bends as finite elements say (FElupe: the tip is down by 26.56 mm after 50 steps and by 47.77 after 100), and
# a model of another domain is refused.
#   body_host.sh PROGRAM MODELS
set -euo pipefail
program=$1 models=$2
fail() { echo "body_host: $*" >&2; exit 1; }

found=$("$program" "$models/deforming-beam.safetensors")
awk '
    function near(found, expected) { return found/expected > 0.9 && found/expected < 1.1 }
    $1 == 50 && near($3, -26.56) || $1 == 100 && near($3, -47.77) { ++rows }
    END { exit rows != 2 }' <<< "$found" || fail "the tip is not where FElupe has it: $found"

status=0
message=$("$program" "$models/cylinder-flow.safetensors" 2>&1) || status=$?
[ "$status" = 1 ] && grep -q contact <<< "$message" || fail "status $status of a model of flows: $message"
