#!/usr/bin/env bash
# README, results: the rows of the twelve wakes, on the first draw of their command and to 6 s.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
hybrid --seed 4321 --model "$M4GN_HOME/models/cylinder-flow.safetensors" --end 6 --baseline loose
claim dmd end 0.011 0.4
claim dmd-loose end 0.08 0.4
below "$(figure loose end)" 0.2 'loose, the best plain solver: end'
claim hybrid end 0.3 0.8

# No entry set: the interval is the run's own. A variant is dmd's where there is no model.
echo '#remove dmd' >FILE
hybrid --seed 4321 --variant auto=FILE --end 6
expect_silence '^0000  full '
claim auto end 0.03 0.2

# The answer: the plain solver, and dmd beside it, which end when they know
runs m4gn hybrid --answers --count 1 --seed 21 --set u0=1.5 --set radius=0.05 --end 8 --baseline none --out answers --json hybrid.json
below "$(figure plain ended)" 6 "the plain solver's end, s"
below "$(figure plain answer)" 1 "error of its figures, %"
below "$(figure plain outside)" 1 "figures outside of their interval, %"
below "$(figure dmd answer)" 5 "error of the figures with dmd, %"
