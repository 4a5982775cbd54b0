#!/usr/bin/env bash
# -fileHandler collated and masterUncollated: two ranks look for segments, store them and find them again.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
function_object m4gnSurrogate "mode observe; model \"$small_model\"; timeStart 0.01;"
runs icoFoam
table() { awk '!/^#/' postProcessing/test/"$1"/surrogateError.dat; }
serial=$(table 0)
# same TABLE WHAT: to seven digits, whatever the number of ranks
same() {
    paste <(echo "$serial") <(echo "$1") | awk '
        NF < 10 || NF % 2 { exit 1 }
        { for (i = 1; i <= NF/2; ++i) { d = ($i - $(i + NF/2))/($i + 1e-12); if (d*d > 1e-8) exit 1 } }' ||
        { echo "$serial"; echo "$1"; fail "$2: other errors than in serial"; }
}

for handler in masterUncollated collated; do
    for segments in computed stored; do
        clean_case
        rm -rf processor*
        # Beside decomposePar the fields are the same, and the undecomposed case has no segments
        runs decomposePar -force -fileHandler $handler
        if [ $segments = stored ]; then
            # Only the undecomposed case has them
            cp ../m4gnSegment ../m4gnSegmentDict 0
        fi
        runs mpirun -np 2 icoFoam -parallel -fileHandler $handler
        if [ $segments = stored ]; then
            grep -q 'segments read from' log.run || { cat log.run; fail "$handler: the segments were not read"; }
        else
            [ -f 0/m4gnSegment ] || fail "$handler: the undecomposed case has no segments"
            cp 0/m4gnSegment 0/m4gnSegmentDict ..
        fi
        same "$(table 0)" "$handler, $segments"
        # The ranks' own, at a restart
        sed -i 's/^startFrom .*/startFrom latestTime;/; s/^endTime .*/endTime 0.062;/' system/controlDict
        runs mpirun -np 2 icoFoam -parallel -fileHandler $handler
        grep -q 'segments read from' log.run || { cat log.run; fail "$handler: a restart did not read the segments"; }
        sed -i 's/^startFrom .*/startFrom startTime;/; s/^endTime .*/endTime 0.06;/' system/controlDict
        echo "$handler, segments $segments: the same"
    done
    printf "type m4gnSegments; libs (m4gnFoam); recompute yes; segments { count 9; }\n" > system/m4gnSegments
    runs mpirun -np 2 postProcess -parallel -fileHandler $handler -func m4gnSegments -time 0
done

# The state of a hybrid run, at a time within a jump (0.02 to 0.04) and one after it
sed -i 's/^writeFormat .*/writeFormat binary;/' system/controlDict
function_object m4gnSurrogate "mode replace; model \"$small_model\"; timeStart 0.02; solverSteps 8; surrogateSteps 2; control { tolerance 1000; relTol 1000; }"
for handler in masterUncollated collated; do
    clean_case
    rm -rf processor*
    runs decomposePar -force -fileHandler $handler
    runs mpirun -np 2 icoFoam -parallel -fileHandler $handler
    rm -rf ../whole && mkdir ../whole && cp -r processor* ../whole
    for time in 0.03 0.05; do
        rm -rf processor* && cp -r ../whole/processor* .
        rm -rf processor*/0.06
        sed -i "s/^startTime .*/startTime $time;/" system/controlDict
        runs mpirun -np 2 icoFoam -parallel -fileHandler $handler
        grep -q "goes on from its state at time $time" log.run || { cat log.run; fail "$handler: the state was not found at $time"; }
        for folder in processor*; do
            [ ! -d ../whole/$folder/0.06 ] || cmp $folder/0.06/U ../whole/$folder/0.06/U || fail "$handler: another U, restarted at $time"
        done
    done
    sed -i 's/^startTime .*/startTime 0;/' system/controlDict
    echo "$handler: restarted with the same bytes"
done
echo "file-handlers: passed"
