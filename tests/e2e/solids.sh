#!/usr/bin/env bash
# Solid data sets: the environment by its own script, the Python package's tests, small sets made, resumed, stopped.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

"$M4GN_HOME/setup/solids.sh"
python=$M4GN_CACHE/solids/bin/python
export PYTHONDONTWRITEBYTECODE=1
(cd "$M4GN_HOME/tools" && "$python" -m unittest discover -q -t . m4gn_solids) || fail "the tests of m4gn_solids"

# What the unit tests read is what the package writes now
PYTHONPATH=$M4GN_HOME/tools "$python" -m m4gn_solids.fixture bar.h5
runs m4gn info bar.h5
"$python" - "$M4GN_HOME/tests/data/solid.h5" <<'PY' || fail "tests/data/solid.h5 is not what m4gn_solids.fixture writes"
import sys, h5py, numpy
now, kept = h5py.File("bar.h5"), h5py.File(sys.argv[1])
arrays = []
kept.visititems(lambda name, item: arrays.append(name) if getattr(item, "dtype", None) is not None and item.dtype.kind in "fiu" else None)
assert any(name.split("/")[-1] == "D" or "/D/" in f"/{name}/" for name in arrays), arrays
for name in arrays:
    a, b = now[name][()], kept[name][()]
    assert a.shape == b.shape and abs(a - b).max(initial=0) <= 1e-3 * abs(b).max(initial=1e-9), name
PY

for family in deforming-plate deforming-beam; do
    generate="m4gn generate $family --points 150 --frames 10 --seed 5 --count 2 --jobs 2 --out $family"
    runs $generate --json figures.json
    grep -q '2 trajectories made' log.run || fail "$family was not made"
    [ "$(ls $family)" = "$(printf '0000.h5\n0001.h5')" ] || fail "$family holds other files: $(ls $family)"
    runs $generate
    grep -q '2 there before' log.run || fail "$family was made again"
    runs m4gn info $family
    grep -q 'redraws, worst gap' log.run || fail "info does not count redraws"
done
# Whatever the family
refused 'frames 10 instead of 9' ${generate/frames 10/frames 9}
refused 'about 150 points instead of 160' ${generate/points 150/points 160}
rm $family/0001.h5
runs $generate
grep -q '1 trajectories made' log.run || fail "$family does not go on"
refused 'family "deforming-beam" instead of' m4gn generate deforming-plate --count 2 --seed 5 --out deforming-beam

# Interrupted: nothing half is left, and the same command goes on
m4gn generate deforming-plate --count 1 --seed 5 --out stopped > log.stop 2>&1 &
for _ in $(seq 100); do [ -e stopped/cases/0000/trajectory.h5 ] && break; sleep 0.2; done
kill -INT $!
if wait $!; then fail "an interrupted run ended with status 0"; fi
grep -q 'the same command goes on' log.stop || { cat log.stop; fail "the interruption is not told"; }
[ -z "$(ls stopped)" ] || fail "left behind: $(ls stopped)"

# A draw that cannot be simulated: a stand-in for gmsh that fails
mkdir bin && printf '#!/bin/sh\nexit 1\n' > bin/gmsh && chmod +x bin/gmsh
PATH=$PWD/bin:$PATH refused 'none of 20 draws' m4gn generate deforming-plate --count 1 --out broken
M4GN_CACHE=$PWD/none refused "'setup/solids.sh' makes it" m4gn generate deforming-beam --count 1 --out absent
[ ! -e absent ] || fail "a folder was made for nothing"
