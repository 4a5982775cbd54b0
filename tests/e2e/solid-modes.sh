#!/usr/bin/env bash
# Segments of a solid are those of its elastic modes: the same from m4gnSegments, from a recording and in a session, on
# any number of ranks.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_beam case
solid_model=$M4GN_HOME/tests/e2e/solid.safetensors
sed -i 's/^endTime .*/endTime 0.01;/' system/controlDict
sed -i 's/compactNormalStress.*;/compactNormalStress yes; nCorrectors 20; D 1e-6;/' system/fvSolution

# Plane stress, 8 times as long as high: Euler-Bernoulli's 1.596 Hz, four cells across
segments='segments { count 8; modes 4; }'
function_object m4gnSegments "$segments"
runs solidDisplacementFoam
hertz=$(sed -n 's/.*eigenvalue 1 = .* 1\/s^2, \(.*\) Hz/\1/p' log.run)
below "$(awk "BEGIN { d = $hertz/1.596 - 1; print d < 0 ? -d : d }")" 0.03 "first frequency $hertz Hz, deviation"
grep -q 'class *volVectorField' 0/m4gnMode4 || fail "mode 4 is no displacement"
mv 0/m4gnSegment ../serial && rm 0/m4gnMode* && clean_case
[ "$(labels ../serial | wc -l)" -eq 8 ] || fail "not 8 segments"

function_object m4gnSegments 'segments { count 8; modes 4; operator laplacian; }'
runs solidDisplacementFoam
grep -q 'class *volScalarField' 0/m4gnMode1 || fail "a mode of the Laplacian is no scalar"
[ "$(values ../serial)" != "$(values 0/m4gnSegment)" ] || fail "the Laplacian's segments are the elastic ones"
rm 0/m4gnMode* && clean_case

# The same on ranks, and without solver and D in memory
for ranks in 2 3; do
    sed "s/numberOfSubdomains.*/numberOfSubdomains $ranks;/; s/(2 1 1)/($ranks 1 1)/" \
        "$M4GN_HOME/openfoam/tutorials/cylinder/system/decomposeParDict" > system/decomposeParDict
    function_object m4gnSegments "$segments"
    runs decomposePar -force
    runs mpirun -np $ranks solidDisplacementFoam -parallel
    [ "$(difference ../serial 0/m4gnSegment)" = 0 ] || fail "other segments on $ranks ranks"
    rm -r processor* && clean_case
done
: > system/functions
echo "type m4gnSegments; libs (m4gnFoam); $segments" > system/m4gnSegments
runs postProcess -func m4gnSegments -time 0
[ "$(difference ../serial 0/m4gnSegment)" = 0 ] || fail "other segments in post-processing"
rm 0/m4gnMode* system/m4gnSegments && clean_case

# A recording has the modes with it, whatever the number of ranks
function_object m4gnRecorder 'fields (D ddt(D)); modes 5;'
runs solidDisplacementFoam
mv postProcessing/test/0/trajectory.h5 ../serial.h5 && clean_case
cp "$M4GN_HOME/openfoam/tutorials/cylinder/system/decomposeParDict" system
on_two_ranks solidDisplacementFoam
mv postProcessing/test/0/trajectory.h5 ../ranks.h5 && rm -r processor* && clean_case
for file in serial ranks; do
    (cd .. && runs m4gn segment $file.h5 --segments 8 --modes 4 --json $file.json --vtu $file.segments.vtu)
done
python3 - ../serial ../serial ../ranks <<'PYTHON' || fail "a recording gives other segments"
import base64, re, struct, sys, xml.etree.ElementTree as xml
lines = open(sys.argv[1]).read().split("internalField")[1].split("(")[1].split(")")[0].split()
for name in sys.argv[2:]:
    data = base64.b64decode(xml.parse(name + ".segments.vtu").getroot().find("UnstructuredGrid/Piece/PointData")[0].text)
    labels = struct.unpack(f"<{len(lines)}f", data[8:])
    assert list(labels) == [float(v) for v in lines], name
PYTHON
(cd .. && refused '7 elastic modes: the mesh has 5' m4gn segment serial.h5 --segments 8 --modes 7)

# A session of a model that was trained with elastic modes takes the same, and says so where it cannot
function_object m4gnSurrogate "mode observe; model \"$solid_model\";"
runs solidDisplacementFoam
grep -q '4 modes of the elastic body' log.run || fail "the session did not solve for the body's modes"
[ "$(difference ../serial 0/m4gnSegment)" = 0 ] || fail "a session makes other segments"
clean_case
echo "solid-modes: passed"
