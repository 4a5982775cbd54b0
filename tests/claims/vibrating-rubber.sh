#!/usr/bin/env bash
# Takes minutes.
# README, results: the rows of three rubber beams in vibration, on the first draw of their command and to 4 s.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam
draw=(--family vibrating-rubber --end 4)
echo 'dmd { snapshotInterval 0.06; }' >FILE
hybrid "${draw[@]}" --variant dmd=FILE
claim dmd displacement 1 0.2
# With the same folder the solver alone is not run again
hybrid "${draw[@]}" --model "$M4GN_HOME/models/vibrating-rubber.safetensors"
claim hybrid displacement 1.5 0.8
