#!/usr/bin/env bash
# examples/hybrid_host: a host without OpenFOAM replaces, observes, is controlled, needs no model with a fit, and is carried on from within
# a jump and between two.
#   hybrid_host.sh PROGRAM MODEL
set -euo pipefail
program=$1 model=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
fail() { echo "hybrid_host: $*" >&2; exit 1; }
last() { tail -n 1 "$1"; }

# carried_on MODEL OPTIONS END AT...: the run goes on from its states as if it had not stopped.
carried_on() {
    local host=("$program" "$1" "$2" "$3") at
    "${host[@]}" > whole
    grep -q 'm4gn: jumped' whole || fail "no jump: $2"
    for at in "${@:4}"; do
        rm -f snapshots*
        "${host[@]}" state "$at" > stored
        [ "$(last stored)" = "$(last whole)" ] || fail "a state that is written changes the run: $2"
        "${host[@]}" state "$at" resume > carried
        grep -q 'host goes on from its state' carried || fail "no state was taken up"
        [ "$(last carried)" = "$(last whole)" ] || fail "carried on at $at: $(last carried), expected $(last whole): $2"
    done
}

free='"mode": "replace", "name": "host", "solver_steps": 10, "surrogate_steps": 4, "time_start": 0.1'
carried_on "$model" "{$free}" 0.4 0.12 0.152
grep -q 'm4gn: jumped 4 steps of 0.01 s' whole || fail "$(cat whole)"

# A time that does not come
if "$program" "$model" "{$free}" 0.4 unsaved.state 1 > unsaved 2>&1; then fail "no state, and no word of it"; fi
grep -q 'no state was written' unsaved || fail "$(cat unsaved)"

# A network of random weights is kept from jumping, and the run is the solver's own
"$program" "$model" '{"mode": "observe", "rollout_steps": 5}' 0.4 > observed
grep -q 'mean rms errors of the surrogate' observed || fail "nothing was observed"
"$program" "$model" "{$free, \"control\": {\"tolerance\": 0.01, \"fields\": [\"p\"]}}" 0.4 > strict
[ "$(last strict)" = "$(last observed)" ] || fail "a run in which nothing jumps is another one"
[ "$(grep -c 'no jump at time' strict)" -gt 5 ] || fail "it was not refused"

printf 'x' | dd of=state bs=1 seek=100 conv=notrunc 2> /dev/null
if "$program" "$model" "{$free}" 0.4 state 0.152 resume > refused 2>&1; then fail "a damaged state was taken up"; fi
grep -q 'checksum' refused || fail "$(cat refused)"

# A fit needs no model: it takes most of the run, and what comes of it is the solver's own to 1 %
fit='"mode": "replace", "name": "host", "surrogates": ["dmd"], "states": "snapshots"'
carried_on - "{$fit}" 12 3 9
"$program" - "{$fit, \"time_start\": 1e9}" 12 > alone
sum() { last "$1" | sed 's/.*squares //'; }
awk -v a="$(sum whole)" -v b="$(sum alone)" 'BEGIN { exit !(a != b && (a - b)^2 < (0.01*b)^2) }' \
    || fail "$(last whole), alone $(last alone)"
echo "hybrid_host: passed"
