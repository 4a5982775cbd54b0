#!/usr/bin/env bash
# m4gnRecorder: serial, parallel, over stored times; nothing half-written.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
file=postProcessing/test/0/trajectory.h5
# frames FILE FRAMES TIMES: what the recording holds
frames() { m4gn info "$1" | grep -qE "^frames  *$2 from $3" || { m4gn info "$1"; fail "expected $2 frames from $3 in $1"; }; }

# While the solver runs: a frame each 5 of 30 steps
record 'writeControl timeStep; writeInterval 5; split test; provenance { note "a test"; seed 3; }'
content $file
frames $file 6 '0.01 to 0.06 s'
cp $file serial.h5

# A file that exists is not overwritten
refused 'exist' icoFoam

# Two ranks write the same mesh in the same order
clean_case
solve 2
diff <(content serial.h5) <(content $file) || fail "two ranks recorded something else than one"

# A recording whose times the run does not reach says so
clean_case
recorder 'timeStart 1;'
solve
expect_log 'test has recorded no frame'
[ ! -e $file ] || fail "a recording without a frame left $file"

# Over stored times: with the solver's fields, and with those that are read
: > system/functions
clean_case
solve
beside="other { type m4gnSurrogate; libs (m4gnFoam); $jump }"
recorder
for command in 'icoFoam -postProcess' postProcess; do
    # shellcheck disable=SC2086
    runs $command -time '0.02:'
    expect_log 'other does nothing on stored times'
    frames $file 5 '0.02 to 0.06 s'
    rm -r postProcessing
done
unset beside

# A field that becomes one of another class
cp 0.05/p 0.05/q
cp 0.06/U 0.06/q
recorder 'fields (q);'
refused 'Field q has 3 components at time 0.06 and had 1 before' postProcess -time '0.05:'
rm -r 0.0*/q postProcessing

recorder 'timeEnd 0.051;'
runs postProcess -time '0.02:'
frames $file 4 '0.02 to 0.05 s'
rm -r postProcessing

recorder 'executeControl writeTime; writeControl writeTime;'
runs postProcess -time '0.02:'
frames $file 5 '0.02 to 0.06 s'
rm -r postProcessing

# A run that is killed leaves none
clean_case
recorder
control endTime 100
# Empty at once: what the run before said must not be found
: > log.run
icoFoam > log.run 2>&1 &
solver=$!
until grep -q '^Time = 0.03$' log.run; do kill -0 $solver || fail "the run ended before it was killed"; sleep 0.1; done
# Meanwhile another run records to the same file: it is refused, and leaves the recording alone
cp -r . ../other
(
    cd ../other
    control endTime 0.01
    function_object m4gnRecorder "file \"$work/case/$file\";"
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
frames $file 5 '0.002 to 0.01 s'
# So is what the killed run had recorded
frames "${file%.h5}-killed.h5" '[0-9]*' '0.002 to (0\.(0[3-9]|[1-9])|[1-9])'
grep -q 'was killed' ../other/log.run || fail "the log does not say that a recording was killed"

# A disk that is full (a limit on the size of files is the same to the program)
clean_case
control endTime 0.06 writeInterval 10
refused 'm4gnRecorder cannot' bash -c 'trap "" XFSZ; ulimit -f 120; exec icoFoam'
[ ! -e $file ] || fail "a full disk left $file"
left=$(find postProcessing -type f 2> /dev/null | wc -l)
[ "$left" -eq 0 ] || fail "a full disk left $(find postProcessing -type f)"
