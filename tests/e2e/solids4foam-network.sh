#!/usr/bin/env bash
# The shipped networks of solids4foam's families are near the solver, with m4gnAnderson beside them as without it: the state that a
# network begins a jump from is that of its time. Needs solids4foam, see solids4foam.sh.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam

# Beams of rubber that vibrate, at points and at cells
shipped_model_is_near vibrating-points 0.03
rm -rf hybrid
: > off
runs m4gn hybrid --family vibrating-rubber --model "$M4GN_HOME/models/vibrating-rubber.safetensors" --count 1 --seed 99 --end 1 --baseline none \
    --variant off=off,anderson=off --out hybrid --json hybrid.json
# displacement RUN
displacement() {
    python3 -c 'import json, sys; print(json.load(open("hybrid.json"))["cases"][0]["runs"][sys.argv[1]]["score"]["displacement"])' "$1"
}
below "$(displacement off)" 0.03 'vibrating-rubber: error of D over its root mean square'
below "$(displacement hybrid)" "$(awk "BEGIN { print 1.5*$(displacement off) }")" 'vibrating-rubber: the same beside m4gnAnderson'
