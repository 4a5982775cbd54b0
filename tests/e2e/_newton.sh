# shellcheck shell=bash
# Sourced after needs_solids4foam by what runs Newton-Krylov of solids4foam's branch feature-petsc-snes.

# has_newton FOLDER: does this solids4foam have Newton-Krylov?
has_newton() { grep -qs foamPetscSnesHelper "$1"/{,lib/}libsolids4FoamModels.so; }

# needs_newton: what SOLIDS4FOAM_INST_DIR names, else what 'setup/solids4foam.sh SOURCE ~/.cache/m4gn/solids4foam-snes' made; or skips the test
needs_newton() {
    local folder=$M4GN_CACHE/solids4foam-snes
    has_newton "$SOLIDS4FOAM_INST_DIR" && return
    has_newton "$folder" || skip "there is no solids4foam with Newton-Krylov in $folder (setup/solids4foam.sh SOURCE $folder)"
    export SOLIDS4FOAM_INST_DIR=$folder
    unset SOLIDS4FOAM_DIR SOLIDS4FOAM_LIB_DIR
    solids4foam_environment
}
