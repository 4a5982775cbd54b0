#!/usr/bin/env bash
# m4gn verify: jumps of a run that writes them are what the solver makes of their first states, and the run carries on from where they begin; of a run
# that does not, from the times that there are; a field that is damaged is found; on two ranks; what cannot be verified.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 4 writeInterval 0.5 writeFormat binary
set_entries system/fvSolution tolerance 1e-7 relTol 0.05
dmd() { echo "mode replace; surrogates (dmd); timeStart 2; dmd { snapshotInterval 0.05; minSnapshots 24; fitTolerance 0.025; } $*"; }

# verify STATUS ARGUMENTS...: of the case here
verify() {
    local expected=$1 status=0
    shift
    m4gn verify . "$@" > ../log.verify 2>&1 || status=$?
    [ $status -eq "$expected" ] || { cat ../log.verify; fail "m4gn verify $*: status $status, expected $expected"; }
}
says() { expect_in ../log.verify "$1"; }
# shows WHAT EXPRESSION: of ../verify.json, with its jumps
shows() {
    python3 - "$2" <<'EOD' || { cat ../log.verify; fail "$1: not $2"; }
import json, sys
jumps = json.load(open("../verify.json"))["jumps"]
sys.exit(not eval(sys.argv[1]))
EOD
}
sums() { find . -type f -exec md5sum {} + | sort; }

# Jumps that are written
ride "$(dmd 'writeJumps yes;')"
jumps=$(grep -vc '^#' postProcessing/test/0/surrogate.dat)
before=$(sums)
verify 0 --jobs 2 --json ../verify.json --keep ../verified
[ "$(sums)" = "$before" ] || fail "the case is not what it was"
shows "all jumps, from begin to end" "len(jumps) == $jumps and all(abs(j['from'] - j['begun']) + abs(j['to'] - j['ended']) < 1e-6 for j in jumps)"
shows "errors within the tolerance, and none 0" "all(0 < j['worst'] < 0.05 and j['within'] and j['worst'] == j['errors']['U'] for j in jumps)"
shows "better than holding" "all(j['errors']['U'] < 0.5*j['holding']['U'] for j in jumps)"
cat ../log.verify
# The solver's fields are in the folder that was asked for, and no others differ
differ=$({ diff -rq . ../verified -x 'log.*' -x postProcessing || true; } | grep -c '/U ')
[ "$differ" -ge "$jumps" ] || fail "$differ fields U are the solver's, expected one a jump, $jumps"
diff -rq 0.5 ../verified/0.5
verify 1 --keep ../verified
says 'is there already'
verify 1 --tolerance 1e-5
says 'have an error above the tolerance'
verify 2 --tolerance -1

# A run that is carried on from where a jump begins has the bytes of the whole one
keep whole [0-9]* postProcessing
begun=$(json ../verify.json '"%g" % d["jumps"][-1]["from"]')
carry_on "$begun"
same_bytes ../whole 4/{U,p,phi}
control startTime 0

# A field that a jump has not made
ended=$(json ../verify.json '"%g" % d["jumps"][0]["to"]')
clean_case
cp -r ../whole/* .
cp 0.5/U "$ended/U"
verify 1 --json ../verify.json
shows "the jump that is wrong" "[j['within'] for j in jumps] == [False] + [True]*($jumps - 1)"

refused 'lies in the case' m4gn verify . --keep verified

# Without writeJumps, compressed
clean_case
control writeInterval 0.1
cp system/controlDict ../controlDict
sed -i 's/^writeFormat .*/writeFormat binary; writeCompression on;/' system/controlDict
surrogate "$(dmd)"
solve
verify 0 --jobs 2 --json ../verify.json
says 'writeJumps yes;'
shows "times that there are" "all(j['from'] <= j['begun'] + 1e-6 and j['to'] <= j['ended'] + 1e-6 for j in jumps if j['worst'])"
shows "what was compared" "any(j['worst'] for j in jumps) and all(j['worst'] < 0.05 for j in jumps if j['worst'])"
cat ../log.verify

# By a solver that begins with the step of the time that it starts from: its own, also from a time within a jump
sed -i 's/^deltaT .*/& adjustTimeStep yes;/' system/controlDict
verify 0 --json ../verify.json
shows "errors as of a solver with a fixed step" "any(j['worst'] for j in jumps) and all(j['worst'] < 0.05 for j in jumps if j['worst'])"
mv ../controlDict system/controlDict

# A network without error control, on two ranks: errors, and no tolerance
control endTime 0.06 writeInterval 0.01
clean_case
surrogate "$jump writeJumps yes;"
solve 2
verify 0 --jobs 2 --json ../verify.json
shows "errors alone" "all(j['worst'] > 0 and j['tolerance'] is None and j['within'] is None and abs(j['from'] - j['begun']) < 1e-6 for j in jumps)"
shows "the largest of all fields" "jumps and all(j['worst'] == max(j['errors'].values()) and len(j['errors']) == 2 for j in jumps)"
cat ../log.verify
rm -r processor*

# What is no run with jumps
clean_case
refused 'expected a finished run of m4gnSurrogate in mode replace' m4gn verify .
