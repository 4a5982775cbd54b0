#!/usr/bin/env bash
# Stored segments that are not those the model wants: of another method, of another mesh, interpolated. They are computed
# anew, refused, or kept, as the entry stored says.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 0.02
echo 'libs (m4gnFoam);' >> system/controlDict
observe="mode observe; $small"
table() { rows postProcessing/test/0/surrogateError.dat; }
again() { clean_case; rm -rf 0/m4gn*; }
reads() { solve && expect_log 'segments read from'; }
# anew WHY: the run computes the model's own, whose errors it has
anew() {
    solve
    expect_log "segments stored in .* are not taken: .*$1"
    [ "$(table)" = "$own" ] || { echo "$own"; table; fail "other errors than with the model's own segments: $1"; }
}

surrogate "$observe"
solve
own=$(table)
[ -f 0/m4gnSegmentDict ] || fail "how the segments were made was not stored"
# OpenFOAM tools that read all fields end after remeshing, and name the file
grep -q "after remeshing remove this file" 0/m4gnSegment || fail "the header of 0/m4gnSegment does not say what to do after remeshing"
reads
[ "$(table)" = "$own" ] || fail "the model's own segments give other errors when they are read"

# By the command line, with its own defaults
again
: > system/functions
runs m4gn segment . --segments 20
surrogate "$observe"
cp -r 0 ../by-command
anew 'count is 20 there'
reads

# A full disk leaves what was there
printf 'type m4gnSegments; libs (m4gnFoam); modes no; recompute yes; segments { count 9; method metis; }\n' > system/m4gnSegments
cp 0/m4gnSegment 0/m4gnSegmentDict ..
echo 'writeCompression on;' >> system/controlDict
for compression in on off; do
    control writeCompression $compression
    refused 'the disk is full' bash -c "set -o pipefail; (trap '' XFSZ; ulimit -f 0; exec postProcess -func m4gnSegments -time 0 2>&1) | cat"
    for file in m4gnSegment m4gnSegmentDict; do cmp "../$file" "0/$file" || fail "a full disk has left another $file"; done
done

# What the dictionary says about them
restore() { again && cp -r ../by-command/. 0; }
restore
expect_error 'are not those wanted: .*count is 20 there' "$observe segments { stored refuse; }"
# What can be done
expect_log 'stored keep'
restore
cmp 0/m4gnSegment ../by-command/m4gnSegment || fail "a refused run changed the segments"
expect_error 'Entry stored is perhaps; expected one of recompute, refuse, keep' "$observe segments { stored perhaps; }"
surrogate "$observe segments { stored keep; count 20; }"
reads
[ "$(table)" != "$own" ] || fail "the test does not see which segments are used"

# By decomposePar with nothing said
again
surrogate "$observe"
cp system/decomposeParDict ..
decomposition 2 m4gn
runs decomposePar -force
cp ../decomposeParDict system
[ -f 0/m4gnSegmentDict ] || fail "decomposePar stored no record"
runs mpirun -np 2 icoFoam -parallel
expect_log 'segments stored in .* are not taken'
same_rows "$own" "$(table)"
runs mpirun -np 2 icoFoam -parallel
expect_log 'segments read from'

# Nothing that says how they were made
again
solve
rm -r 0/m4gnSegmentDict postProcessing
anew 'nothing is stored with them'

# A finer mesh: neither the run nor decomposePar with the method m4gn ends; modes of the old mesh go
again
runs m4gn segment .
[ -f 0/m4gnMode1 ] || fail "no modes were written"
cp -r . ../finer && cd ../finer
sed -i 's/0\.058/0.05/' mesh.geo
mesh_of_the_cylinder
cp -r 0 ../stale
solve
expect_log 'are not taken: they are of another mesh: [0-9]* values for [0-9]* cells'
[ ! -e 0/m4gnMode1 ] || fail "modes of another mesh were left"
reads
rm -rf 0 && cp -r ../stale 0
decomposition 2 m4gn
runs decomposePar -force
rm -rf 0 && cp -r ../stale 0
expect_error 'they are of another mesh' "$observe segments { stored keep; }"
# With another method OpenFOAM reads all fields of cells and ends. It names the file, and the file has the remedy.
cp ../decomposeParDict system
while [ -n "$(find 0 -name m4gnSegment -o -name 'm4gnMode*')" ]; do
    refused 'file: .*/0/m4gn' decomposePar -force
    stale=$(sed -n 's/^file: .*\/0\/\(m4gn[A-Za-z0-9]*\) .*/\1/p' log.run)
    grep -q 'note .*after remeshing remove this file' "0/$stale" || { head -15 "0/$stale"; fail "no remedy in 0/$stale"; }
    rm "0/$stale"
done
runs decomposePar -force

# Interpolated by mapFields
surrogate "$observe"
rm -rf 0 && cp -r ../case/0 0 && rm -f 0/m4gn*
echo "$(header m4gnSegment volScalarField) dimensions [0 0 0 0 0 0 0]; internalField uniform 0;
boundaryField { \".*\" { type zeroGradient; } frontAndBack { type empty; } }" > 0/m4gnSegment
runs mapFields ../case -consistent -sourceTime 0
expect_log 'm4gnSegment'
values 0/m4gnSegment | grep -q '\.' || fail "mapFields gave whole numbers: the test shows nothing"
solve
expect_log 'are not taken: one of them is [0-9.]*, and labels of segments are whole numbers'
rm -rf postProcessing
expect_error 'labels of segments are whole numbers' "$observe segments { stored keep; }"
