#!/usr/bin/env bash
# The shipped network of solids4foam's family is near the solver on a draw that no training has had, with m4gnAnderson beside them as
# without it: the state that a network begins a jump from is that of its time. Needs solids4foam, see _solids4foam.sh.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam

# figure RUN FIGURE
figure() { python3 -c 'import json, sys; print(json.load(open("hybrid.json"))["cases"][0]["runs"][sys.argv[1]]["score"][sys.argv[2]])' "$@"; }

# near FAMILY OPTIONS...: its network beside the solver
near() {
    rm -rf hybrid
    runs m4gn hybrid --family "$1" --model "$M4GN_HOME/models/$1.safetensors" --count 1 --seed 99 --end 1 --baseline none \
        --out hybrid --json hybrid.json "${@:2}"
}

: > off
near vibrating-rubber --variant off=off,anderson=off
holds "$(figure hybrid replaced) > 0.75"
below "$(figure off displacement)" 0.03 'vibrating-rubber: error of D over its root mean square'
below "$(figure hybrid displacement)" "$(awk "BEGIN { print 1.5*$(figure off displacement) }")" 'vibrating-rubber: the same beside m4gnAnderson'
