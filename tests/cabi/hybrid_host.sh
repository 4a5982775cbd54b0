#!/usr/bin/env bash
# examples/hybrid_host: a host without OpenFOAM replaces, observes, is controlled, and is carried on from within a jump.
#   hybrid_host.sh PROGRAM MODEL
set -euo pipefail
program=$1 model=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
host() { "$program" "$model" "$@"; }
fail() { echo "hybrid_host: $*" >&2; exit 1; }
last() { tail -n 1 "$1"; }

free='"mode": "replace", "name": "host", "solver_steps": 10, "surrogate_steps": 4, "time_start": 0.1'
host "{$free}" 0.4 > whole
grep -q 'm4gn: jumped 4 steps of 0.01 s' whole || fail "no jump"
# In the first jump, and between two
for at in 0.12 0.152; do
    host "{$free}" 0.4 state $at > stored
    [ "$(last stored)" = "$(last whole)" ] || fail "a state that is written changes the run"
    host "{$free}" 0.4 state $at resume > carried
    grep -q 'host goes on from its state' carried || fail "no state was taken up"
    [ "$(last carried)" = "$(last whole)" ] || fail "carried on at $at: $(last carried), expected $(last whole)"
done

# A network of random weights is kept from jumping, and the run is the solver's own
host '{"mode": "observe", "rollout_steps": 5}' 0.4 > observed
grep -q 'mean rms errors of the surrogate' observed || fail "nothing was observed"
host "{$free, \"control\": {\"tolerance\": 0.01, \"fields\": [\"p\"]}}" 0.4 > strict
[ "$(last strict)" = "$(last observed)" ] || fail "a run in which nothing jumps is another one"
[ "$(grep -c 'no jump at time' strict)" -gt 5 ] || fail "it was not refused"

printf 'x' | dd of=state bs=1 seek=100 conv=notrunc 2> /dev/null
if host "{$free}" 0.4 state 0.152 resume > refused 2>&1; then fail "a damaged state was taken up"; fi
grep -q 'checksum' refused || fail "$(cat refused)"
echo "hybrid_host: passed"
