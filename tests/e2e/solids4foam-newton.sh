#!/usr/bin/env bash
# Takes minutes.
# Newton-Krylov of solids4foam's branch feature-petsc-snes as a row of 'm4gn hybrid', with the dmd surrogate beside it, and its refusal
# where the solver has none.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam

# shellcheck source=tests/e2e/_newton.sh
. "$M4GN_HOME/tests/e2e/_newton.sh"
has_newton "$SOLIDS4FOAM_INST_DIR" ||
    refused 'newton-krylov needs solids4foam.s branch feature-petsc-snes' m4gn generate vibrating-rubber --set algorithm=newton-krylov --count 1 --out data
needs_newton

# The beam of the family in larger time steps; the solver alone solves each time step as well
echo 'dmd { snapshotInterval 0.04; minSnapshots 25; }' > dmd
runs m4gn hybrid --family vibrating-rubber --count 1 --end 2 --set algorithm=newton-krylov --set step=5e-3 --set tolerance=1e-6 \
    --variant "dmd=dmd,tolerance=1e-3" --baseline newton=tolerance=1e-2 --out hybrid --json hybrid.json
# figure RUN FIGURE
figure() { python3 -c 'import json, sys; print(json.load(open("hybrid.json"))["cases"][0]["runs"][sys.argv[1]]["score"][sys.argv[2]])' "$@"; }
below "$(figure newton displacement)" 0.001 "Newton-Krylov: error of D over its root mean square"
below "$(figure dmd displacement)" 0.01 "dmd beside it: error of D over its root mean square"
holds "$(figure dmd replaced) > 0.2"
