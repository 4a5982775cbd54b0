#!/usr/bin/env bash
# m4gnSegment is computed once: decomposePar, parallel runs, reconstructPar, restarts, renumberMesh and redistributePar
# keep it.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
echo 'libs (m4gnFoam);' >> system/controlDict
surrogate "mode observe; $small writeControl writeTime; segments { stored keep; }"
printf 'type m4gnSegments; libs (m4gnFoam); modes no; segments { model "%s"; method metis; stored keep; }\n' "$small_model" \
    > system/m4gnSegments

# reads FILE: the segments of the run; computes: its own
reads() { expect_log "segments read from .*$1"; }
computes() { expect_silence 'segments read'; }
table() { rows "postProcessing/test/$1/surrogateError.dat"; }
# to TIME [START]: the run goes on to there, on one rank, or on those of the processors' folders
to() {
    control endTime "$1" startFrom "${2:-latestTime}"
    if [ -d processor0 ]; then parallel icoFoam; else solve; fi
}
parallel() { runs mpirun -np 2 "$@" -parallel; }

# The surrogate begins one solver step after the start and reports its error a stride later: one row a run
to 0.014 startTime
own=$(table 0)
runs postProcess -func m4gnSegments -time 0
reads 0/m4gnSegment
clean_case
# Segments that the model would not compute itself: wherever they are lost, the errors differ
runs postProcess -func m4gnSegments -time 0
computes
cp 0/m4gnSegment ../m4gnSegment
# A label that no mesh has cells for: refused before room is made for as many segments
awk '/^\($/ { inside = 1; print; next } inside { print "100000000000"; inside = 0; next } { print }' \
    ../m4gnSegment > 0/m4gnSegment
cmp -s 0/m4gnSegment ../m4gnSegment && fail "the test did not change a label"
refused 'labels of segments are whole numbers from 0 that are less than the number of cells' icoFoam
cp ../m4gnSegment 0/m4gnSegment
runs icoFoam
reads 0/m4gnSegment
[ "$(table 0 | wc -l)" -eq 1 ] || { table 0; fail "expected one row"; }
[ "$(table 0)" != "$own" ] || fail "the test does not see which segments are used"
cp -r . ../next
to 0.024
reads 0/m4gnSegment
second=$(table 0.01)
to 0.034
reads 0/m4gnSegment
third=$(table 0.02)
echo "restart in serial: kept"

# decomposePar of the latest time alone: the processors' folders have no segments, the undecomposed case has
for format in ascii binary; do
    rm -rf ../next-$format && cp -r ../next ../next-$format && cd ../next-$format
    control writeFormat $format startFrom latestTime
    runs foamFormatConvert
    runs decomposePar -latestTime
    [ ! -e processor0/0/m4gnSegment ] || fail "time 0 was decomposed"
    to 0.024
    reads "next-$format/0/m4gnSegment"
    same_rows "$second" "$(table 0.01)"
done
runs reconstructPar -latestTime
control writeFormat ascii
rm -r processor*
to 0.034
reads 0/m4gnSegment
same_rows "$third" "$(table 0.02)"
echo "serial, decomposePar, parallel, reconstructPar, serial: kept"

# Computed in parallel: the undecomposed case has them at once
cd ../case
clean_case
control startFrom startTime
runs decomposePar
to 0.014 startTime
computes
if [ ! -f 0/m4gnSegment ] || [ ! -f processor1/0/m4gnSegment ]; then fail "the segments were not stored"; fi
same_rows "$own" "$(table 0)"
to 0.024
reads 0/m4gnSegment
runs reconstructPar
rm -r processor*
to 0.034
reads 0/m4gnSegment
echo "parallel, restart, reconstructPar, serial: kept"

# Begun at a later time
rm 0/m4gnSegment
runs decomposePar -latestTime
to 0.044
computes
[ -f processor0/0.03/m4gnSegment ] || fail "the segments were not stored in the folder of the start time"
[ -f 0.03/m4gnSegment ] || fail "the undecomposed case has no segments"
to 0.054
reads 0.03/m4gnSegment
echo "begun at a later time: kept"

# Cells in another order, and on other processors
rm -rf processor* 0.*
cp ../m4gnSegment 0
runs postProcess -func writeCellCentres -time 0
sort_cells() { paste <(values 0/C) <(values 0/m4gnSegment) | sort; }
sort_cells > ../before
runs renumberMesh -overwrite
sort_cells > ../after
cmp ../before ../after || fail "renumberMesh lost the segments"
to 0.004 startTime
reads 0/m4gnSegment
decomposition 2 m4gn
runs decomposePar -force -time 0
decomposition 3 m4gn
runs mpirun -np 3 redistributePar -parallel -overwrite
reads 0/m4gnSegment
for p in processor*; do labels "$p/0/m4gnSegment"; done > ../found
[ "$(wc -l < ../found)" -eq "$(values 0/m4gnSegment | sort -u | wc -l)" ] || fail "redistributePar tore segments"
echo "renumberMesh, redistributePar: kept"
