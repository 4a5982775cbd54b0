#!/usr/bin/env bash
# m4gn segment: figures, fields that OpenFOAM's own tools read and a later run finds, the same answer from a recording.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case

for format in ascii binary; do
    control writeFormat $format
    runs m4gn segment . --segments 16 --json ../$format.json
    expect_log 'wrote m4gnSegment, m4gnMode1, .*m4gnMode6 in .*/case/0 (method slic-md, K 16'
    grep -q "format  *$format;" 0/m4gnSegment || fail "0/m4gnSegment is not $format"
    # OpenFOAM reads what was written
    rm -rf VTK && runs foamToVTK -time 0 -ascii
    expect_log m4gnSegment m4gnMode6
done
json ../ascii.json 'len(d["eigenvalues"]) == 6 and d["conductance"] > 0 and 0 < d["edge_cut_ratio"] < 1 and -1 <= d["silhouette"] <= 1' |
    grep -q True || fail "$(json ../ascii.json d)"
find . -name '*.unfinished' | grep . && fail "an unfinished file was left"

# What was written is found by a run, and by its two ranks
rm -rf VTK
surrogate "mode observe; $small segments { count 16; stored keep; }"
solve
expect_log 'segments read from 0/m4gnSegment'
clean_fields() { find . -maxdepth 1 -name '[0-9]*' ! -name 0 -exec rm -rf {} +; rm -rf postProcessing processor*; }
clean_fields
solve 2
expect_log 'segments read from 0/m4gnSegment'
grep -q 'decomposePar -fields' <(m4gn segment .) || fail "it is not said that the case is decomposed"
clean_fields

# They are the ones that a run computes, and the entries of the function object are the defaults
cp 0/m4gnSegment ../by-command && rm 0/m4gn*
control writeFormat ascii
solve
cp 0/m4gnSegment ../by-run && rm 0/m4gn*
runs m4gn segment .
# The function object's count
expect_log 'K 16'
[ "$(difference ../by-run 0/m4gnSegment)" = 0 ] || fail "a run computes other segments"
clean_fields

# The mesh of a recording is the mesh of the case
control endTime 0.01
recorder
solve
runs m4gn segment . --segments 16 --json ../case.json --no-write
(cd .. && runs m4gn segment case/postProcessing/test/0/trajectory.h5 --segments 16 --json data.json \
    --vtu trajectory.segments.vtu)
[ -f ../trajectory.segments.vtu ] || fail "no file for ParaView"
python3 - ../case.json ../data.json <<'PYTHON' || fail "the recording gives other figures than the case"
import json, sys
a, b = (json.load(open(f)) for f in sys.argv[1:])
assert all(abs(x - y) <= 1e-10 * x for x, y in zip(a["eigenvalues"], b["eigenvalues"])), (a, b)
assert a["method"] == b["method"] and a["edge_cut_ratio"] == b["edge_cut_ratio"], (a, b)
assert abs(a["silhouette"] - b["silhouette"]) < 1e-9, (a, b)
PYTHON
python3 - ../trajectory.segments.vtu <<'PYTHON' || fail "the .vtu is not what it should be"
import base64, struct, sys, xml.etree.ElementTree as xml
piece = xml.parse(sys.argv[1]).getroot().find("UnstructuredGrid/Piece")
n = int(piece.get("NumberOfPoints"))
names = [a.get("Name") for a in piece.find("PointData")]
assert names == ["m4gnSegment"] + [f"m4gnMode{i}" for i in range(1, 7)], names
data = base64.b64decode(piece.find("PointData")[0].text)
assert struct.unpack("<Q", data[:8])[0] == 4 * n == len(data) - 8
assert set(struct.unpack(f"<{n}f", data[8:])) == set(range(16))
PYTHON

# Algorithm 2 in plain Python, from METIS's segments, the modes and the places that are written, and the faces of the case's mesh
for method in metis slic-md slic-mdodl slic-mdode; do
    (cd .. && runs m4gn segment case/postProcessing/test/0/trajectory.h5 --segments 16 --method $method --set size=0.2 \
        --set tau=0.5 --set connected=false --set 'obstacles=["cylinder"]' --vtu $method.vtu)
done
python3 - .. constant/polyMesh <<'PYTHON' || fail "the segments are not those of Algorithm 2"
import base64, math, re, struct, sys, xml.etree.ElementTree as xml
folder, mesh = sys.argv[1:]
S, K, tau, margin = 0.2, 16, 0.5, 1e-5

def values(array, kind):
    data = base64.b64decode(array.text)[8:]
    return struct.unpack(f"<{len(data) // struct.calcsize(kind)}{kind}", data)

def read(method):
    piece = xml.parse(f"{folder}/{method}.vtu").getroot().find("UnstructuredGrid/Piece")
    labels, *modes = (values(a, "f") for a in piece.find("PointData"))
    x = values(piece.find("Points")[0], "d")
    return [int(l) for l in labels], modes, list(zip(x[::3], x[1::3]))

def text(name):
    return open(f"{mesh}/{name}").read()

number = r"[-+.0-9e]+"
points = [tuple(map(float, p)) for p in re.findall(rf"\(({number}) ({number}) ({number})\)", text("points"))]
faces = [[int(i) for i in f.split()] for f in re.findall(r"\d+\(([\d ]+)\)", text("faces"))]
patch = re.search(r"cylinder\s*\{(.*?)\}", text("boundary"), re.S).group(1)
n, first = (int(re.search(rf"{key}\s+(\d+)", patch).group(1)) for key in ("nFaces", "startFace"))
middle = lambda face: [sum(points[p][i] for p in face) / len(face) for i in (0, 1)]
cylinder = [middle(face) for face in faces[first : first + n]]

start, modes, places = read("metis")
cells = range(len(places))
distance = [min(math.dist(x, c) for c in cylinder) for x in places]
guides = {
    "slic-md": [[] for _ in cells],
    "slic-mdodl": [[S * math.log(d / S)] for d in distance],
    "slic-mdode": [[S * math.exp(-d / S)] for d in distance],
}
for method, guide in guides.items():
    f = [guide[i] + [S * phi[i] for phi in modes] for i in cells]
    labels = start
    for _ in range(20):
        members = [[i for i in cells if labels[i] == k] for k in range(K)]
        assert all(members), method
        mean = lambda rows, own: [sum(rows[i][c] for i in own) / len(own) for c in range(len(rows[0]))]
        centroids = [(mean(f, own), mean(places, own)) for own in members]
        after = []
        for i in cells:
            d = [math.dist(f[i], g) + tau * math.dist(places[i], y) for g, y in centroids]
            near = [v for v in d if v <= S and v < d[labels[i]] - margin * S]
            after.append(next(k for k in range(K) if d[k] in near and d[k] <= min(near) + margin * S) if near else labels[i])
        labels, before = after, labels
        if labels == before:
            break
    found = read(method)[0]
    apart, moved = (sum(a != b for a, b in zip(found, other)) for other in (labels, start))
    # Modes were written in single precision: a tie may be broken otherwise
    assert apart <= len(found) / 200 and moved > len(found) / 100, (method, apart, moved, len(found))
PYTHON

# Somebody without the right to write gets a message, and nothing is left behind
clean_fields
rm -f 0/m4gn*
# Where that somebody may read them, wherever the checkout is
mkdir "$work/bin"
cp "$(command -v m4gn)" "$M4GN_HOME"/lib/libm4gn*.so "$work/bin"
chmod -R go+rX "$work"
somebody=(setpriv --reuid=65534 --regid=65534 --clear-groups)
[ "$(id -u)" -eq 0 ] || { somebody=(); chmod a-w 0; }
refused 'Cannot write' "${somebody[@]}" "$work/bin/m4gn" segment . --segments 16
[ "$(ls 0)" = "$(printf 'U\np')" ] || { ls -la 0; fail "something was left in 0"; }
chmod u+w 0
refused '--vtu is for a trajectory' m4gn segment . --vtu ../segments.vtu
