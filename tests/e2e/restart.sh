#!/usr/bin/env bash
# Takes minutes.
# m4gnSurrogate, restart: a run that is carried on from a write time, wherever in its schedule that lies, has the bytes of the run that
# was not interrupted, on one rank and on two; so has a run that is killed again and again.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
RANDOM=7
make_case case endTime 1.2 writeInterval 0.05 writeFormat binary
# Bytes are compared, so a loose tolerance is as good
set_entries system/fvSolution tolerance 1e-6 relTol 0.05

# The surrogate jumps from 0.5 to 0.75 and from 0.83 to 1.08: write times lie before the first jump, where it begins, in it, where it ends,
# and between the two
surrogate() {
    function_object m4gnSurrogate "mode replace; model cylinder-flow.safetensors; timeStart 0.5; solverSteps 40; surrogateSteps 5;
        $*"
}
# same FOLDER WHAT: the fields at 1.2 are those of this run
same() {
    local file
    for file in U p phi; do
        cmp "$1/1.2/$file" "../whole/$1/1.2/$file" || fail "$2: $file at 1.2 is not that of the uninterrupted run"
    done
}
# forget FOLDER...: the times that a run has written there
forget() { find "$@" -maxdepth 1 -name '[0-9]*' ! -name 0 -exec rm -rf {} +; }
anew() { clean_case; control startTime 0; }
# from TIME FOLDER...: carry on from there in the folders, . or those of the ranks
from() {
    local time=$1 folder
    shift
    forget "$@"
    for folder in "$@"; do
        cp -r "../whole/$folder/$time" "$folder"
    done
    control startTime "$time"
}

for control in '' 'control { tolerance 0.09; relTol 1000; }'; do
    surrogate "$control"
    anew
    runs icoFoam
    # The solver's first write times after the jump that ends at 1.08
    [ -n "$control" ] || { [ -d 1.1 ] && [ -d 1.15 ]; } || { ls; fail "write times after a jump are lost"; }
    keep whole [0-9]*
    steps=$(entry surrogate_steps 0)
    replaced=$(entry replaced_fraction 0)
    [ "$steps" -ge 4 ] || fail "the test's run has $steps surrogate steps only: $control"
    # With control, one in a jump and one between two
    times='0.45 0.5 0.6 0.75 0.8 1.15'
    [ -z "$control" ] || times='0.6 0.8'
    for time in $times; do
        from $time .
        runs icoFoam
        expect_log "m4gn: test goes on from its state at time $time"
        same . "restarted at $time, $control"
        [ "$(entry surrogate_steps $time)" = "$steps" ] || fail "restarted at $time, $control: not $steps surrogate steps"
        holds "($replaced - $(entry replaced_fraction $time))^2 < 1e-12" "restarted at $time, $control: share that is replaced"
    done
    echo "restarted, ${control:-no control}: the same bytes, $steps surrogate steps"
done

# Without its state, the schedule begins anew, and the log says where it could go on
from 0.8 .
cp -r ../whole/0.75 .
rm 0.8/uniform/test.state
runs icoFoam
expect_log 'no state of test' 'last one .* 0.75'
# That of another model is not taken up
from 0.8 .
function_object m4gnSurrogate "mode replace; model \"$small_model\"; timeStart 0.5; solverSteps 40; surrogateSteps 5;"
runs icoFoam
expect_log 'had another model'
# A damaged one ends the run with its name
surrogate ''
from 0.8 .
echo 'left maybe' > 0.8/uniform/test.state
refused 'is not the state of a run' icoFoam
cp ../whole/0.8/uniform/test.state . && head -c 900 test.state > 0.8/uniform/test.state
refused 'test.state' icoFoam

# Two ranks
surrogate 'control { tolerance 0.09; relTol 1000; }'
anew
solve 2
keep whole processor0 processor1
for time in 0.5 0.6 0.8; do
    from $time processor0 processor1
    runs mpirun -np 2 icoFoam -parallel
    same processor0 "2 ranks, restarted at $time"
    same processor1 "2 ranks, restarted at $time"
done
# Serial, from what two ranks have written
from 0.6 processor0 processor1
runs reconstructPar -time 0.6
runs icoFoam
expect_log 'written by 2 ranks'
mkdir ../serial && cp -r 1.2 ../serial
rm -rf [1-9]* 0.*
cp -r ../whole/processor[01] .
runs reconstructPar -time 1.2
control writeFormat ascii
for folder in . ../serial; do
    (mkdir -p "$folder/as_text" && cp -r constant system "$folder/1.2" "$folder/as_text" && cd "$folder/as_text" && : > system/functions &&
        runs foamFormatConvert -time 1.2)
done
for field in U p; do
    below "$(difference as_text/1.2/$field ../serial/as_text/1.2/$field)" 1e-4 "$field at 1.2, serial from 2 ranks at 0.6"
done
control writeFormat binary

# killed TIMES SECONDS FOLDERS RUN...: killed again and again at random moments of the first so many seconds, and carried on from
# the last time that is whole
# shellcheck disable=SC2086  # several folders
killed() {
    local most=$1 limit=$2 folders=$3 kills=0 whole time folder pid
    shift 3
    forget $folders
    control startTime 0
    while [ $kills -lt "$most" ]; do
        setsid "$@" > log.run 2>&1 &
        pid=$!
        sleep "$(awk -v r=$RANDOM -v l="$limit" 'BEGIN { print 0.3 + l*r/32768 }')"
        # The session: mpirun gives its ranks process groups of their own
        if pkill -9 -s $pid; then
            wait $pid 2> log.kill || true
            while pgrep -s $pid > log.kill; do sleep 0.05; done
            kills=$((kills + 1))
        elif wait $pid; then
            for folder in $folders; do same "$folder" "killed $kills times"; done
            finished=$((finished + 1))
            forget $folders
        else
            tail -n 20 log.run
            fail "a run that was carried on after $kills kills failed"
        fi
        # Complete where the first rank has its state
        whole=0
        for time in $(ls "${folders%% *}" | grep '^[0-9][0-9.]*$' | sort -g); do
            [ ! -f "${folders%% *}/$time/uniform/test.state" ] || whole=$time
        done
        for folder in $folders; do
            for time in $(ls "$folder" | grep '^[0-9][0-9.]*$'); do
                awk "BEGIN { exit !($time > $whole) }" && rm -rf "${folder:?}/$time"
            done
        done
        control startTime "$whole"
    done
    runs "$@"
    for folder in $folders; do same "$folder" "killed $kills times"; done
    echo "killed $kills times, $finished runs came to the end before: the same bytes"
}
finished=0
# Where the surrogate's times are not write times, those of a run that starts there are others: OpenFOAM counts them from its start
sed -i 's/solverSteps 40/solverSteps 25/' system/functions
anew
solve 2
keep whole processor0 processor1
killed 3 1 'processor0 processor1' mpirun -np 2 icoFoam -parallel
anew
runs icoFoam
keep whole [0-9]*
killed 5 0.4 . icoFoam
# A fit, and its states in a file of their own that grows
function_object m4gnSurrogate 'mode replace; surrogates (dmd); timeStart 0.5; control { tolerance 1000; relTol 1000; }
    dmd { snapshotInterval 0.01; window 30; minSnapshots 24; maxJump 15; jumpTolerance 0.5; fitTolerance 0.5; }'
for ranks in 1 2; do
    anew
    decomposition $ranks simple "coeffs { n ($ranks 1 1); }"
    folders=. run=icoFoam
    if [ $ranks -gt 1 ]; then
        runs decomposePar
        folders=$(echo processor*) run="mpirun -np $ranks icoFoam -parallel"
    fi
    # shellcheck disable=SC2086  # several words
    runs $run
    steps=$(entry surrogate_steps 0)
    [ "$steps" -ge 20 ] || fail "the dmd surrogate took $steps strides only"
    # shellcheck disable=SC2046,SC2086
    keep whole $([ $ranks -eq 1 ] && echo [0-9]* || echo $folders)
    # shellcheck disable=SC2086
    killed 3 0.$((3*ranks)) "$folders" $run
done
# All ranks refuse in words what one of them cannot take up: states of the fit that are damaged, or of another run, and a state that is none
# shellcheck disable=SC2086
ends() {
    refused "$1" $run
    ! grep 'internal error' log.run || fail "an error of one rank is taken for one of the program"
}
# shellcheck disable=SC2086
from 1.1 $folders
truncate -s $(($(stat -c %s postProcessing/test/states.1)/2)) postProcessing/test/states.1
ends 'states.1: record [0-9]* is damaged'
rm processor0/1.1/uniform/test.state && mkdir processor0/1.1/uniform/test.state
ends 'expected a plain file, found a folder'
# shellcheck disable=SC2086
forget $folders
control startTime 0
# Another run under the same conditions
sed -i 's/^internalField .*/internalField uniform (0.1 0 0);/' processor*/0/U
# shellcheck disable=SC2086
runs $run
# shellcheck disable=SC2086
from 1.1 $folders
ends 'found those of another'
