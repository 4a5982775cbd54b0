#!/usr/bin/env bash
# README, results: the rows of rubber beams in vibration with Newton-Krylov, on the first draw of their command and to 3.1 s; and its refusal where
# solids4foam has none.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam

# has_newton FOLDER: is this solids4foam of the branch feature-petsc-snes?
has_newton() { grep -qs foamPetscSnesHelper "$1"/{,lib/}libsolids4FoamModels.so; }

# What SOLIDS4FOAM_INST_DIR names, else what 'setup/solids4foam.sh SOURCE ~/.cache/m4gn/solids4foam-snes' made
if ! has_newton "$SOLIDS4FOAM_INST_DIR"; then
    refused 'newton-krylov needs solids4foam.s branch feature-petsc-snes' m4gn generate vibrating-rubber --set algorithm=newton-krylov --count 1 --out data
    folder=$M4GN_CACHE/solids4foam-snes
    has_newton "$folder" || skip "there is no solids4foam with Newton-Krylov in $folder (setup/solids4foam.sh SOURCE $folder)"
    export SOLIDS4FOAM_INST_DIR=$folder
    unset SOLIDS4FOAM_DIR SOLIDS4FOAM_LIB_DIR
    solids4foam_environment
fi
echo 'dmd { snapshotInterval 0.06; }' >FILE
hybrid --family vibrating-rubber --end 3.1 --set algorithm=newton-krylov --set tolerance=1e-8 --variant dmd=FILE,tolerance=1e-4,anderson=off \
    --baseline newton-2=tolerance=1e-2 --baseline newton-4=tolerance=1e-4
claim dmd displacement 0.2 0.15
below "$(figure newton-2 displacement)" 2 'newton-2, the best plain solver beside a network: error of D, % of its root mean square'
below "$(figure newton-4 displacement)" 0.02 'newton-4, the best plain solver beside dmd: the same'
