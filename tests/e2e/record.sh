#!/usr/bin/env bash
# m4gnRecorder: serial, parallel, over stored times; nothing half-written.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case

# What a trajectory holds, without what says where it came from

# While the solver runs: a frame each 5 of 30 steps
function_object m4gnRecorder 'writeControl timeStep; writeInterval 5; split test; provenance { note "a test"; seed 3; }'
runs icoFoam
file=postProcessing/test/0/trajectory.h5
[ -f $file ] || fail "no $file"
content $file
content $file | grep -q '^frames  *6 from 0.01 to 0.06 s' || fail "expected 6 frames from 0.01 to 0.06 s"
cp $file serial.h5

# A file that exists is kept
refused 'exist' icoFoam

# Two ranks write the same mesh in the same order
clean_case
on_two_ranks icoFoam
[ -f $file ] || fail "no $file of the parallel run"
diff <(content serial.h5) <(content $file) || fail "two ranks recorded something else than one"

# Over stored times: with the solver's fields, and with those that are read
clean_case
: > system/functions
runs icoFoam
function_object m4gnRecorder
for command in 'icoFoam -postProcess' postProcess; do
    # shellcheck disable=SC2086
    runs $command -time '0.02:'
    content $file | grep -q '^frames  *5 from 0.02 to 0.06 s' || fail "$command: expected 5 frames from 0.02 to 0.06 s"
    rm -r postProcessing
done

# A run that is killed leaves none
clean_case
sed -i 's/^endTime .*/endTime 100;/' system/controlDict
# Empty at once: what the run before said must not be found
: > log.run
icoFoam > log.run 2>&1 &
solver=$!
for ((i = 0; i < 600; ++i)); do
    grep -q '^Time = 0.03$' log.run && break
    sleep 0.1
done
# Meanwhile another run records to the same file: it is refused, and leaves the recording alone
cp -r . ../other
(
    cd ../other
    function_object m4gnRecorder "file \"$work/case/$file\";"
    sed -i 's/^endTime .*/endTime 0.01;/' system/controlDict
    refused 'is being written by another recording' icoFoam
)
partial=$(find postProcessing -name '.*.partial')
[ -n "$partial" ] || fail "the recording of the first run has gone"
kill -9 $solver
wait $solver 2> /dev/null || true
[ ! -e $file ] || fail "a killed run left $file"
# What it left is in nobody's way
cd ../other
runs icoFoam
cd ../case
m4gn info $file | grep -q '^frames  *5 from 0.002 to 0.01 s' || { m4gn info $file; fail "no recording after the killed one"; }
kept=${file%.h5}-killed.h5
m4gn info "$kept" | grep -qE '^frames  *[0-9]* from 0.002 to 0\.(0[3-9]|[1-9])' || { m4gn info "$kept"; fail "what the killed run had recorded is gone"; }
grep -q 'was killed' ../other/log.run || fail "the log does not say that a recording was killed"

# A disk that is full (a limit on the size of files is the same to the program)
clean_case
sed -i 's/^endTime .*/endTime 0.06;/; s/^writeInterval .*/writeInterval 10;/' system/controlDict
refused 'm4gnRecorder cannot' bash -c 'trap "" XFSZ; ulimit -f 120; exec icoFoam'
[ ! -e $file ] || fail "a full disk left $file"
left=$(find postProcessing -type f 2> /dev/null | wc -l)
[ "$left" -eq 0 ] || fail "a full disk left $(find postProcessing -type f)"
echo "record: passed"
