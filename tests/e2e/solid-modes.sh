#!/usr/bin/env bash
# Segments of a solid are those of its elastic modes: the same from m4gnSegments, from a recording and in a session, on
# any number of ranks.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_beam case endTime 0.01
stress yes 20 1e-6
segments='segments { count 8; modes 4; }'
# with OBJECT ENTRIES: the run with this function object
with() { clean_case && function_object "$@" && solve; }

# Plane stress, 8 times as long as high: Euler-Bernoulli's 1.596 Hz, four cells across
with m4gnSegments "$segments"
hertz=$(sed -n 's/.*eigenvalue 1 = .* 1\/s^2, \(.*\) Hz/\1/p' log.run)
below "$(off "$hertz" 1.596)" 0.03 "first frequency $hertz Hz, deviation"
grep -q 'class *volVectorField' 0/m4gnMode4 || fail "mode 4 is no displacement"
mv 0/m4gnSegment ../serial && rm 0/m4gnMode*
[ "$(labels ../serial | wc -l)" -eq 8 ] || fail "not 8 segments"

with m4gnSegments 'segments { count 8; modes 4; operator laplacian; }'
grep -q 'class *volScalarField' 0/m4gnMode1 || fail "a mode of the Laplacian is no scalar"
[ "$(values ../serial)" != "$(values 0/m4gnSegment)" ] || fail "the Laplacian's segments are the elastic ones"
rm 0/m4gnMode*

# The same on ranks, and without solver and D in memory
for ranks in 2 3; do
    decomposition $ranks simple "coeffs { n ($ranks 1 1); }"
    with m4gnSegments "$segments"
    [ "$(difference ../serial 0/m4gnSegment)" = 0 ] || fail "other segments on $ranks ranks"
done
ranks=1
clean_case
: > system/functions
echo "type m4gnSegments; libs (m4gnFoam); $segments" > system/m4gnSegments
runs postProcess -func m4gnSegments -time 0
[ "$(difference ../serial 0/m4gnSegment)" = 0 ] || fail "other segments in post-processing"
rm 0/m4gnMode* system/m4gnSegments && clean_case

# A recording has the modes with it, whatever the number of ranks
for ranks in 1 2; do
    decomposition $ranks simple "coeffs { n ($ranks 1 1); }"
    record 'fields (D ddt(D)); modes 5;'
    mv postProcessing/test/0/trajectory.h5 ../$ranks.h5
    (cd .. && runs m4gn segment $ranks.h5 --segments 8 --modes 4 --json $ranks.json --vtu $ranks.segments.vtu)
done
ranks=1
python3 - ../serial ../1 ../2 <<'PYTHON' || fail "a recording gives other segments"
import base64, re, struct, sys, xml.etree.ElementTree as xml
lines = open(sys.argv[1]).read().split("internalField")[1].split("(")[1].split(")")[0].split()
for name in sys.argv[2:]:
    data = base64.b64decode(xml.parse(name + ".segments.vtu").getroot().find("UnstructuredGrid/Piece/PointData")[0].text)
    labels = struct.unpack(f"<{len(lines)}f", data[8:])
    assert list(labels) == [float(v) for v in lines], name
PYTHON
(cd .. && refused '7 elastic modes: the mesh has 5' m4gn segment 1.h5 --segments 8 --modes 7)

# The material that a recorder is told of is that of the command in its case
for young in 1e6 4e6; do
    recorder "fields (D); material { E $young; nu 0.3; rho 1000; }"
    runs m4gn segment . --modes 4 --no-write --json ../$young.json
done
python3 -c '
import json
a, b = (json.load(open(f"../{young}.json"))["eigenvalues"][0] for young in ("1e6", "4e6"))
assert abs(b/a - 4) < 1e-4, (a, b)' || fail "the eigenvalues do not grow with the modulus"

# A run of a model that was trained with elastic modes takes the same
with m4gnSurrogate "mode observe; model \"$M4GN_HOME/tests/e2e/solid.safetensors\";"
expect_log '4 modes of the elastic body'
[ "$(difference ../serial 0/m4gnSegment)" = 0 ] || fail "a run makes other segments"
