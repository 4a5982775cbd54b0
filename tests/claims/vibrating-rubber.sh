#!/usr/bin/env bash
# Takes minutes.
# README, results: the rows of twelve rubber beams in vibration, by the commands of docs/tutorials/solids4foam-beam.md, on the first of its draws and to
# 3.1 s, without the row of a4. The plain run is beside m4gnAnderson: the solver's own answer (tests/e2e/solids4foam-anderson.sh) in a third of the time.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam
ln -s "$M4GN_HOME/models" models
: >off
follow solids4foam-beam 's/--count 3/--count 1 --end 3.1 --set anderson=on/; s/--baseline a4=[^ ]*/--baseline none/; s/--variant dmd=dmd.txt/& --json dmd.json/
    s/--html/--variant off=off,anderson=off --json network.json &/'
[ "$(grep -c '^0000  full ' log.run)" -eq 1 ] || fail 'the plain run is not there for the second command'
for column in D stress; do grep -q "$column %" run/rubber.html || fail "the report has no column $column %"; done
mv dmd.json hybrid.json
claim dmd displacement 1 0.15
mv network.json hybrid.json
claim hybrid displacement 1.5 0.8
# The state that a network begins a jump from is that of its time, also where m4gnAnderson is a time step ahead
below "$(figure hybrid displacement)" "$(calc "1.5*$(figure off displacement)")" 'beside m4gnAnderson, at most 1.5 times the error without'
