#!/usr/bin/env bash
# m4gn check: a case that fits, with and without a network; one that is refused, in the words of its run; cases without a mesh, decomposed, broken.
# The case stays as it is.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# check STATUS ARGUMENTS...: of the case here; log.check has what it says. Steps end it, whatever time they take.
check() {
    local expected=$1 status=0
    shift
    m4gn check --seconds "${seconds:-1000}" "$@" > ../log.check 2>&1 || status=$?
    [ $status -eq "$expected" ] || { cat ../log.check; fail "m4gn check $*: status $status, expected $expected"; }
}
# says TEXT...: each in one of its lines
says() { expect_in ../log.check "$@"; }
# unfit TEXT [ARGUMENTS...]: the case does not fit, and why
unfit() { check 1 . "${@:2}" && says "$1"; }
# sums: of all that the case has
sums() { find . -type f -exec md5sum {} + | sort; }

make_case case endTime 0.6
{ drag forces; surrogate 'mode replace; surrogates (dmd);'; cat system/functions; } > own && mv own system/functions
# A file from beside the case
cp constant/transportProperties ../shared
{ header transportProperties; echo '#include "../../shared"'; } > constant/transportProperties
before=$(sums)
check 0 . --model "$small_model" --json ../check.json
[ "$(sums)" = "$before" ] || fail "the case is not what it was"
says '^dmd: fits' 'handed over *U, p, phi$' '^network: fits' "case's own test is left out" 'suggested *dmd { snapshotInterval' \
    'cylinder *obstacle (wall)\|cylinder *wall (wall)'
python3 - <<'EOD'
import json
dmd, network = json.load(open("../check.json"))["findings"]
for finding in (dmd, network):
    report = finding["report"]
    assert finding["why"] is None and report["jumped"] and report["steps_after"] > 1, finding
assert network["report"]["handed_over"] and dmd["report"]["numbers"] > 0 and dmd["report"]["watched"] > 0
EOD
echo "fits: $(grep suggested ../log.check)"

# What controlDict includes from elsewhere in the case, and a step of more digits than a dictionary writes
cp system/controlDict ../controlDict
sed -i 's/^application .*/#include "$FOAM_CASE\/solver"/; s/^deltaT .*/deltaT 0.00199999449;/' system/controlDict
echo 'application icoFoam;' > solver
check 0 . --json ../check.json
says '^dmd: fits'
python3 -c 'import json; r = json.load(open("../check.json"))["findings"][0]["report"]; assert abs(r["delta_t"] - 0.00199999449) < 1e-15, r'
rm solver && mv ../controlDict system

# A mesh that fields are mapped to is not one that is solved on
mkdir constant/coarse system/coarse
cp -r constant/polyMesh constant/coarse && cp system/fvSchemes system/fvSolution system/coarse
cp system/functions ../functions
echo 'map { type mapFields; libs (fieldFunctionObjects); mapRegion coarse; mapMethod cellVolumeWeight; consistent yes; fields (U); log no; }' >> system/functions
check 0 .
says '^dmd: fits'
rm -r constant/coarse system/coarse && mv ../functions system

# A network of a configuration, made from the case's own steps
network 0.01 0 'method = "metis"; count = 4' 'seed = 1; batch_size = 2; steps = 100' '{ name = "U", input = true, output = "delta" }' \
    '{ name = "p", input = true, output = "value" }' > ../network.toml
check 0 . --config ../network.toml
says "^network: fits"
echo 'fields = 3' > ../wrong.toml
unfit "no network can be made of the configuration .*\[model\]" --config ../wrong.toml

# What a run refuses is refused in its words
ddt_scheme steadyState
unfit 'does not fit: The dmd surrogate does not handle the time scheme steadyState of ddtSchemes'
why=$(sed -n 's/^dmd: does not fit: //p' ../log.check)
expect_error "${why%% of ddtSchemes*}" 'mode replace; surrogates (dmd);'
echo "refused: $why"
ddt_scheme Euler

# By hand, beside entries that a window of a few states does not go with
ride 'mode check; report "../own.json"; seconds 1000; surrogates (dmd); dmd { minSnapshots 24; cutTransient yes; }'
grep -q '"jumped": *true' ../own.json || { cat ../own.json; fail "mode check did not jump"; }
: > system/functions
clean_case

# Of a decomposed case that is all there is, its ranks run
runs decomposePar -force
mv constant/polyMesh 0 ..
check 0 .
says "on 2 ranks"
echo "decomposed: $(grep '^  run' ../log.check)"
rm -r processor*
unfit 'it has no mesh, and no blockMeshDict'
mv ../polyMesh constant
unfit 'icoFoam itself ended in an error, before any jump: .*cannot find file'
mv ../0 .

# Solvers that are not there, that break down at once, that do not speak to function objects
cp system/controlDict ../controlDict
control application noSuchFoam
unfit 'noSuchFoam not found in PATH'
mkdir ../bin
printf '#!/bin/sh\nkill -11 $$\n' > ../bin/crashFoam
printf '#!/bin/sh\necho Time = 1\n' > ../bin/idleFoam
chmod +x ../bin/*
PATH=$work/bin:$PATH
control application crashFoam
unfit 'crashFoam itself ended in an error, before any jump: .*signal: 11'
control application idleFoam
unfit 'idleFoam executes no function objects'
control application blockMesh
check 1 .
sed '/^application/d' ../controlDict > system/controlDict
unfit 'has no entry application'
echo 'application { deltaT "' > system/controlDict
unfit 'system/controlDict: '
cp ../controlDict system
check 2 . --model nowhere
seconds=0 check 2 .
chmod -R a-w . && check 0 . && chmod -R u+w .

# A mesh that blockMesh makes, of the first fields that a tutorial has
cd "$work"
make_beam beam
stress yes 1 1e-6
rm -rf constant/polyMesh && mv 0 0.orig
check 0 .
says 'made ready by blockMesh' 'handed over *D'
[ ! -e constant/polyMesh ] && [ ! -e 0 ] || fail "the case is not what it was"

# By its script, with a file that a command names; lines that are no such commands are told
mkdir geometry && mv system/blockMeshDict geometry/blocks
# shellcheck disable=SC2016  # not of this shell
printf '%s\n' 'runApplication blockMesh -dict geometry/blocks' 'touch made' 'runApplication $(getApplication)' > Allrun
check 0 .
says 'made ready by blockMesh -dict geometry/blocks; lines of its script that were left out: touch made'
# The script takes them when it has made the mesh
# shellcheck disable=SC2016  # not of this shell
printf '%s\n' 'runApplication blockMesh -dict geometry/blocks' 'restore0Dir' 'runApplication $(getApplication)' > Allrun
check 0 .
says 'made ready by blockMesh -dict geometry/blocks, cp -rT 0.orig 0'
