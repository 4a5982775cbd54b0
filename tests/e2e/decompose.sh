#!/usr/bin/env bash
# Segments, modes and ranks: the same segments and eigenvalues for any decomposition, every segment on one rank with
# method m4gn, and constraints that hold.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# decompose_by RANKS METHOD ENTRIES: processor folders of the case. The log is log.run.
decompose_by() { decomposition "$@" && runs decomposePar -force -cellDist; }

# Every cell somewhere else than its neighbours
scatter() {
    local cells=$1 np=$2
    {
        header scattered labelList
        seq 0 $((cells - 1)) | awk -v np="$np" -v n="$cells" 'BEGIN { print n "\n(" } { print ($1*7919)%np } END { print ")" }'
    } > constant/scattered
}

eigenvalues() { sed -n 's/^m4gn: eigenvalue .* = \(.*\) 1\/m^2/\1/p' log.run; }

# Number of segments with cells in more than one processor folder
straddling() { for p in processor*; do labels "$p/0/m4gnSegment"; done | sort | uniq -d | wc -l; }

# The serial answer, kept in ../serial
reference() {
    rm -rf 0/m4gn* processor*
    runs postProcess -func m4gnSegments -time 0
    eigenvalues > ../eigenvalues
    [ "$(wc -l < ../eigenvalues)" -ge 6 ] || { cat log.run; fail "expected six eigenvalues"; }
    keep serial 0/m4gn*
}

# same_answer NP WHAT: computes on the processor folders, and compares
same_answer() {
    local np=$1 what=$2
    rm -f 0/m4gn* processor*/0/m4gn*
    runs mpirun -np "$np" postProcess -parallel -func m4gnSegments -time 0
    expect_log 'segments computed'
    paste ../eigenvalues <(eigenvalues) | awk '
        NF != 2 { m = 1; next } { d = $2/$1 - 1; if (d*d > m) m = d*d } END { printf "%.1e", sqrt(m); exit !(m <= 1e-16) }' \
        > ../worst || { paste ../eigenvalues <(eigenvalues); fail "$what: other eigenvalues than in serial"; }
    # The undecomposed case has them without reconstructPar, and after it
    cmp <(values ../serial/m4gnSegment) <(values 0/m4gnSegment) || fail "$what: other segments than in serial"
    runs reconstructPar -withZero -fields '(m4gnSegment m4gnMode1 m4gnMode4)'
    cmp <(values ../serial/m4gnSegment) <(values 0/m4gnSegment) || fail "$what: other segments after reconstructPar"
    for mode in 1 4; do
        below "$(difference ../serial/m4gnMode$mode 0/m4gnMode$mode)" 1e-5 "$what: mode $mode" > ../log
    done
    echo "$what: the same segments, eigenvalues to $(cat ../worst)"
}

# all_decompositions NAME SEGMENTS RANKS: of segments with these entries
all_decompositions() {
    local np=$3 cells
    echo "type m4gnSegments; libs (m4gnFoam); recompute yes; segments { modes 6; $2 }" > system/m4gnSegments
    grep -q '^libs' system/controlDict || echo 'libs (m4gnFoam);' >> system/controlDict
    reference
    cells=$(values ../serial/m4gnSegment | wc -l)
    decompose_by "$np" simple "coeffs { n ($np 1 1); }"
    same_answer "$np" "$1, simple, $np ranks"
    scatter "$cells" 3
    decompose_by 3 manual 'manualCoeffs { dataFile scattered; }'
    same_answer 3 "$1, manual (scattered), 3 ranks"

    # Segments that are stored
    cp ../serial/m4gnSegment 0
    decompose_by "$np" m4gn "m4gnCoeffs { $2 }"
    expect_log 'segments read from 0/m4gnSegment'
    [ "$(straddling)" -eq 0 ] || fail "$1, $np ranks: segments on several ranks"
    same_answer "$np" "$1, m4gn, $np ranks"
    # Segments that the method itself computes
    rm -f 0/m4gn*
    decompose_by 3 m4gn "m4gnCoeffs { $2 }"
    cmp <(values ../serial/m4gnSegment) <(values 0/m4gnSegment) || fail "decomposePar stored other segments"
    [ "$(straddling)" -eq 0 ] || fail "segments on several ranks"
}

make_case cylinder
# The method that looks at all: modes, and distances to an obstacle
all_decompositions cylinder 'count 16; method slic-mdode; obstacles (cylinder); distanceScale 0.1;' 4
cd "$work"
cp -r "$M4GN_HOME/tests/e2e/igloo" igloo
mkdir igloo/0 igloo/constant
cd igloo
runs blockMesh
runs snappyHexMesh -overwrite
runs checkMesh
[ "$(sed -n 's/^ *polyhedra: *//p' log.run)" -gt 300 ] || fail "the igloo has no polyhedra"
all_decompositions igloo 'count 24;' 3
