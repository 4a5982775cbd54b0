#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd) in a solver of second order in time: a beam that vibrates. The solver carries on from a
# displacement and its old level, which is a state at its own time step before.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_beam case endTime 2.5 writeInterval 250
stress yes 20 1e-7
plain 1.25 2.5

ride 'mode replace; surrogates (dmd); dmd { snapshotInterval 0.025; minSnapshots 24; fitTolerance 0.025; }'
expect_log '^m4gn: the dmd surrogate advances D and, with them, .*divSigmaExp, .*sigmaD'
replaces 0.4 'a beam'
# The solver's first steps after a jump are counted
holds "$(entry jumps_watched) > 0"
# Over what half of the run changes
close_to ../plain "$(calc "0.05*$(difference ../plain/2.5/D ../plain/1.25/D)")" 2.5/D
close_to ../plain 0.1 {1.25,2.5}/{sigma,sigmaEq}

# Carried on in a jump and behind one: the old levels are part of what is written
keep whole 1.25 2.5 postProcessing
carry_on 1.25
close_to ../whole 1e-3 2.5/D
