#!/usr/bin/env bash
# Stored segments that are not those the model wants: of another method, of another mesh, interpolated. They are computed
# anew, refused, or kept, as the entry stored says.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
sed -i 's/^endTime .*/endTime 0.02;/' system/controlDict
echo 'libs (m4gnFoam);' >> system/controlDict
surrogate() { function_object m4gnSurrogate "mode observe; model \"$small_model\"; $*"; }
table() { awk '!/^#/' postProcessing/test/0/surrogateError.dat; }
again() { clean_case; rm -rf 0/m4gn*; }
reads() { grep -q 'segments read from' log.run || { cat log.run; fail "$1: the segments were not read"; }; }
anew() {
    grep -q "segments stored in .* are not taken: .*$1" log.run || { cat log.run; fail "not said: $1"; }
    [ "$(table)" = "$own" ] || { echo "$own"; table; fail "other errors than with the model's own segments: $1"; }
}

surrogate
runs icoFoam
own=$(table)
[ -f 0/m4gnSegmentDict ] || fail "how the segments were made was not stored"
# OpenFOAM tools that read all fields end after remeshing, and name the file
grep -q "after remeshing remove this file" 0/m4gnSegment || fail "the header of 0/m4gnSegment does not say what to do after remeshing"
runs icoFoam
reads "the model's own"
[ "$(table)" = "$own" ] || fail "the model's own segments give other errors when they are read"

# By the command line, with its own defaults
again
: > system/functions
runs m4gn segment . --segments 20
surrogate
cp -r 0 ../by-command
runs icoFoam
anew 'count is 20 there'
runs icoFoam
reads "segments that were computed anew"

# What the dictionary says about them
restore() { again && cp -r ../by-command/. 0; }
restore
surrogate 'segments { stored refuse; }'
refused 'are not those wanted: .*count is 20 there' icoFoam
grep -q 'stored keep' log.run || fail "no remedy"
restore
cmp 0/m4gnSegment ../by-command/m4gnSegment || fail "a refused run changed the segments"
surrogate 'segments { stored perhaps; }'
refused 'Entry stored is perhaps; expected one of recompute, refuse, keep' icoFoam
surrogate 'segments { stored keep; count 20; }'
runs icoFoam
reads "stored keep"
[ "$(table)" != "$own" ] || fail "the test does not see which segments are used"

# By decomposePar with nothing said
again
surrogate
cp system/decomposeParDict ..
echo "$(header x) numberOfSubdomains 2; method m4gn;" > system/decomposeParDict
runs decomposePar -force
cp ../decomposeParDict system
[ -f 0/m4gnSegmentDict ] || fail "decomposePar stored no record"
runs mpirun -np 2 icoFoam -parallel
grep -q 'segments stored in .* are not taken' log.run || { cat log.run; fail "segments of decomposePar were taken"; }
paste <(echo "$own") <(table) | awk '{ for (i = 1; i <= NF/2; ++i) { d = ($i - $(i + NF/2))/($i + 1e-12); if (d*d > 1e-8) exit 1 } }' ||
    { echo "$own"; table; fail "after decomposePar: other errors"; }
runs mpirun -np 2 icoFoam -parallel
reads "two ranks, a second time"

# Nothing that says how they were made
again
surrogate
runs icoFoam
rm 0/m4gnSegmentDict
rm -rf postProcessing
runs icoFoam
anew 'nothing is stored with them'

# A finer mesh: neither the run nor decomposePar with the method m4gn ends; modes of the old mesh go
again
runs m4gn segment .
[ -f 0/m4gnMode1 ] || fail "no modes were written"
cp -r . ../finer && cd ../finer
sed -i 's/0\.058/0.05/' mesh.geo
{ gmsh -nt 1 -3 -format msh2 -o mesh.msh mesh.geo && gmshToFoam mesh.msh && changeDictionary -constant; } > log.mesh 2>&1 ||
    fail "the finer mesh"
cp -r 0 ../stale
runs icoFoam
grep -q 'are not taken: they are of another mesh: [0-9]* values for [0-9]* cells' log.run || { cat log.run; fail "not said: another mesh"; }
[ ! -e 0/m4gnMode1 ] || fail "modes of another mesh were left"
runs icoFoam
reads "finer mesh"
rm -rf 0 && cp -r ../stale 0
echo "$(header x) numberOfSubdomains 2; method m4gn;" > system/decomposeParDict
runs decomposePar -force
surrogate 'segments { stored keep; }'
rm -rf 0 && cp -r ../stale 0
refused 'they are of another mesh' icoFoam
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
surrogate
rm -rf 0 && cp -r ../case/0 0 && rm -f 0/m4gn*
echo "$(header m4gnSegment volScalarField) dimensions [0 0 0 0 0 0 0]; internalField uniform 0;
boundaryField { \".*\" { type zeroGradient; } frontAndBack { type empty; } }" > 0/m4gnSegment
runs mapFields ../case -consistent -sourceTime 0
grep -q 'm4gnSegment' log.run || { cat log.run; fail "mapFields did not map the segments"; }
values 0/m4gnSegment | grep -q '\.' || fail "mapFields gave whole numbers: the test shows nothing"
runs icoFoam
grep -q 'are not taken: one of them is [0-9.]*, and labels of segments are whole numbers' log.run || { cat log.run; fail "interpolated labels were taken"; }
surrogate 'segments { stored keep; }'
rm -rf postProcessing
refused 'labels of segments are whole numbers' icoFoam
echo "segment-record: passed"
