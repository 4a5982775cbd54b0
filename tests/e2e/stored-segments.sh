#!/usr/bin/env bash
# m4gnSegment is computed once: decomposePar, parallel runs, reconstructPar, restarts, renumberMesh and redistributePar
# keep it.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
echo 'libs (m4gnFoam);' >> system/controlDict
function_object m4gnSurrogate "mode observe; model \"$small_model\"; writeControl writeTime; segments { stored keep; }"
printf 'type m4gnSegments; libs (m4gnFoam); modes no; segments { model "%s"; method metis; stored keep; }\n' "$small_model" \
    > system/m4gnSegments

# span TIME START: end and start (startTime or latestTime) of the run
span() { sed -i "s/^endTime .*/endTime $1;/; s/^startFrom .*/startFrom $2;/" system/controlDict; }
reads() { grep -q "segments read from .*$1" log.run || { grep segments log.run; fail "no segments were read from $1"; }; }
computes() { ! grep -q 'segments read' log.run || fail "segments were read where none should be stored"; }
table() { awk '!/^#/' postProcessing/test/"$1"/surrogateError.dat; }
same_table() {
    paste <(echo "$1") <(echo "$2") | awk '
        NF < 10 || NF % 2 { exit 1 }
        { for (i = 1; i <= NF/2; ++i) { d = ($i - $(i + NF/2))/($i + 1e-12); if (d*d > 1e-8) exit 1 } }' ||
        { echo "$1"; echo "$2"; fail "$3"; }
}
parallel() { runs mpirun -np 2 "$@" -parallel; }

# The surrogate begins one solver step after the start and reports its error a stride later: one row a run
span 0.014 startTime
runs icoFoam
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
span 0.024 latestTime
runs icoFoam
reads 0/m4gnSegment
second=$(table 0.01)
span 0.034 latestTime
runs icoFoam
reads 0/m4gnSegment
third=$(table 0.02)
echo "restart in serial: kept"

# decomposePar of the latest time alone: the processors' folders have no segments, the undecomposed case has
for format in ascii binary; do
    rm -rf ../next-$format && cp -r ../next ../next-$format && cd ../next-$format
    sed -i "s/^writeFormat .*/writeFormat $format;/" system/controlDict
    runs foamFormatConvert
    span 0.024 latestTime
    runs decomposePar -latestTime
    [ ! -e processor0/0/m4gnSegment ] || fail "time 0 was decomposed"
    parallel icoFoam
    reads "next-$format/0/m4gnSegment"
    same_table "$second" "$(table 0.01)" "$format: two ranks found other errors"
done
runs reconstructPar -latestTime
sed -i "s/^writeFormat .*/writeFormat ascii;/" system/controlDict
span 0.034 latestTime
rm -r processor*
runs icoFoam
reads 0/m4gnSegment
same_table "$third" "$(table 0.02)" "serial after parallel: other errors"
echo "serial, decomposePar, parallel, reconstructPar, serial: kept"

# Computed in parallel: the undecomposed case has them at once
cd ../case
clean_case
span 0.014 startTime
runs decomposePar
parallel icoFoam
computes
if [ ! -f 0/m4gnSegment ] || [ ! -f processor1/0/m4gnSegment ]; then fail "the segments were not stored"; fi
same_table "$own" "$(table 0)" "computed in parallel: other errors than computed in serial"
span 0.024 latestTime
parallel icoFoam
reads 0/m4gnSegment
runs reconstructPar
rm -r processor*
span 0.034 latestTime
runs icoFoam
reads 0/m4gnSegment
echo "parallel, restart, reconstructPar, serial: kept"

# Begun at a later time
rm 0/m4gnSegment
span 0.044 latestTime
runs decomposePar -latestTime
parallel icoFoam
computes
[ -f processor0/0.03/m4gnSegment ] || fail "the segments were not stored in the folder of the start time"
[ -f 0.03/m4gnSegment ] || fail "the undecomposed case has no segments"
span 0.054 latestTime
parallel icoFoam
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
span 0.004 startTime
runs icoFoam
reads 0/m4gnSegment
decompose_dict() {
    echo "FoamFile { version 2.0; format ascii; class dictionary; object x; } numberOfSubdomains $1; method m4gn;" \
        > system/decomposeParDict
}
decompose_dict 2
runs decomposePar -force -time 0
decompose_dict 3
runs mpirun -np 3 redistributePar -parallel -overwrite
reads 0/m4gnSegment
for p in processor*; do labels "$p/0/m4gnSegment"; done > ../found
[ "$(wc -l < ../found)" -eq "$(values 0/m4gnSegment | sort -u | wc -l)" ] || fail "redistributePar tore segments"
echo "renumberMesh, redistributePar: kept"
echo "stored-segments: passed"
