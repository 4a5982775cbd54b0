#!/usr/bin/env bash
# Takes minutes.
# README, results: the rows of three rubber beams in vibration, on the first draw of their command and to 3.4 s.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam
draw=(--family vibrating-rubber --end 3.4)
echo 'dmd { snapshotInterval 0.06; }' >FILE
hybrid "${draw[@]}" --variant dmd=FILE
claim dmd displacement 1 0.2
: >off
hybrid "${draw[@]}" --model "$M4GN_HOME/models/vibrating-rubber.safetensors" --variant off=off,anderson=off
expect_silence '^0000  full '
claim hybrid displacement 1.5 0.8
# The state that a network begins a jump from is that of its time, also where m4gnAnderson is a time step ahead
below "$(figure hybrid displacement)" "$(calc "1.5*$(figure off displacement)")" 'beside m4gnAnderson, at most 1.5 times the error without'
