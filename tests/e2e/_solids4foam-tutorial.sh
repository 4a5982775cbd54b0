# shellcheck shell=bash
# Tutorials of solids4foam for tests and measurements. Sourced behind common.sh and needs_solids4foam.
tutorials=$SOLIDS4FOAM_DIR/tutorials/solids
if [ ! -d "$tutorials" ]; then skip "SOLIDS4FOAM_DIR ($SOLIDS4FOAM_DIR) has no tutorials/solids"; fi

# solids4foam_tutorial TUTORIAL STEPS FOLDER [CELLS]: its mesh, or one of so many cells of its one block, 20x20; and a run of so many time steps, all
# of which are written; changes to FOLDER. step is the length of a time step.
solids4foam_tutorial() {
    local setting file
    cp -r "$tutorials/$1" "$3"
    cd "$3" || fail "no folder $3"
    # What solids4foam's own convertCaseFormat does for this OpenFOAM
    find . -type f -print0 | xargs -0 sed -i 's/symmetryPlane\b/symmetry/g'
    if [ -f constant/polyMesh/blockMeshDict ]; then mv constant/polyMesh/blockMeshDict system; fi
    for file in system/blockMeshDict.*.m4; do
        if [ -f "$file" ]; then m4 "$file" > system/blockMeshDict; fi
    done
    foamDictionary -entry functions -remove system/controlDict > /dev/null 2>&1 || true
    step=$(awk '$1 == "deltaT" { print $2 + 0 }' system/controlDict)
    for setting in "endTime $(calc "$2*$step")" 'writeControl timeStep' 'writeInterval 1' 'writeFormat ascii' 'writePrecision 14' \
        'writeCompression off' 'runTimeModifiable no'; do
        foamDictionary -entry "${setting% *}" -set "${setting#* }" system/controlDict > /dev/null
    done
    # shellcheck disable=SC2016  # not of the shell
    echo 'functions { #include "functions" }' >> system/controlDict
    : > system/functions
    if [ -n "${4:-}" ]; then
        sed -i -E "s/^( *hex \([0-9 ]+\)) \([0-9]+ [0-9]+ 1\)/\1 (${4/x/ } 1)/" system/blockMeshDict
        grep -qF "(${4/x/ } 1)" system/blockMeshDict || fail "$1 has no block whose cells could be set"
    fi
    if [ -f system/blockMeshDict ]; then runs blockMesh; else runs fluentMeshToFoam ./*.msh; fi
    if [ -f system/changeDictionaryDict.openfoam ]; then runs changeDictionary -dict system/changeDictionaryDict.openfoam -constant; fi
    if [ -f batch.setSet ]; then
        runs setSet -batch batch.setSet
        runs setsToZones
    fi
}
