#!/usr/bin/env bash
# README, results: the rows of rubber beams in vibration with Newton-Krylov, on the first draw of their command and to 3.1 s.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam
# shellcheck source=tests/e2e/_newton.sh
. "$M4GN_HOME/tests/e2e/_newton.sh"
needs_newton
echo 'dmd { snapshotInterval 0.06; }' >FILE
hybrid --family vibrating-rubber --end 3.1 --set algorithm=newton-krylov --set tolerance=1e-8 --variant dmd=FILE,tolerance=1e-4,anderson=off \
    --baseline newton-2=tolerance=1e-2 --baseline newton-4=tolerance=1e-4
claim dmd displacement 0.2 0.15
below "$(figure newton-2 displacement)" 2 'newton-2, the best plain solver beside a network: error of D, % of its root mean square'
below "$(figure newton-4 displacement)" 0.02 'newton-4, the best plain solver beside dmd: the same'
