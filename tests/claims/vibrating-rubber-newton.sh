#!/usr/bin/env bash
# README, results: the row of rubber beams in vibration with Newton-Krylov, on the first draw of its command and to 3.1 s.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam
# shellcheck source=tests/e2e/_newton.sh
. "$M4GN_HOME/tests/e2e/_newton.sh"
needs_newton
echo 'dmd { snapshotInterval 0.06; }' >FILE
hybrid --family vibrating-rubber --end 3.1 --set algorithm=newton-krylov --set tolerance=1e-8 --variant dmd=FILE,tolerance=1e-4,anderson=off
claim dmd displacement 0.2 0.15
