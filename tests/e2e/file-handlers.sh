#!/usr/bin/env bash
# -fileHandler collated and masterUncollated: two ranks look for segments, store them and find them again.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 0.04
errors=postProcessing/test/0/surrogateError.dat
# parallel HANDLER COMMAND...
parallel() { runs mpirun -np 2 "${@:2}" -parallel -fileHandler "$1"; }
ride "mode observe; $small timeStart 0.01;"
serial=$(rows $errors)

for handler in masterUncollated collated; do
    for segments in computed stored; do
        clean_case
        # Beside decomposePar the fields are the same, and the undecomposed case has no segments
        runs decomposePar -force -fileHandler $handler
        # Only the undecomposed case has them
        [ $segments = computed ] || cp ../m4gnSegment ../m4gnSegmentDict 0
        parallel $handler icoFoam
        if [ $segments = stored ]; then
            expect_log 'segments read from'
        else
            [ -f 0/m4gnSegment ] || fail "$handler: the undecomposed case has no segments"
            cp 0/m4gnSegment 0/m4gnSegmentDict ..
        fi
        same_rows "$serial" "$(rows $errors)"
        # The ranks' own, at a restart
        control startFrom latestTime endTime 0.042
        parallel $handler icoFoam
        expect_log 'segments read from'
        control startFrom startTime endTime 0.04
        echo "$handler, segments $segments: the same"
    done
    printf "type m4gnSegments; libs (m4gnFoam); recompute yes; segments { count 9; }\n" > system/m4gnSegments
    parallel $handler postProcess -func m4gnSegments -time 0
done

# The state of a hybrid run, at a time within a jump (0.02 to 0.04); restart.sh has all kinds of times
control writeFormat binary endTime 0.06
surrogate "mode replace; $small timeStart 0.02; solverSteps 8; surrogateSteps 2; control { tolerance 1000; relTol 1000; }"
for handler in masterUncollated collated; do
    clean_case
    runs decomposePar -force -fileHandler $handler
    parallel $handler icoFoam
    keep whole processor*
    rm -rf processor*/0.06
    control startTime 0.03
    parallel $handler icoFoam
    expect_log 'goes on from its state at time 0.03'
    for folder in processor*; do
        [ ! -d ../whole/$folder/0.06 ] || cmp $folder/0.06/U ../whole/$folder/0.06/U || fail "$handler: another U, restarted at 0.03"
    done
    control startTime 0
    echo "$handler: restarted with the same bytes"
done
