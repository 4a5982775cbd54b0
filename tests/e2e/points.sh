#!/usr/bin/env bash
# Nodes at points: recordings of point fields, on one rank and on several, however the cells are dealt to them.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

mkdir -p case/constant case/system case/0 && cd case
{ header blockMeshDict; cat <<'EOD'; } > system/blockMeshDict
vertices ((0 0 0) (0.6 0 0) (0.7 0.2 0) (0 0.3 0) (0 0 0.2) (0.6 0 0.25) (0.7 0.2 0.2) (0 0.3 0.2));
blocks (hex (0 1 2 3 4 5 6 7) (12 5 4) simpleGrading (2 1 1));
boundary
(
    clamp { type patch; faces ((0 4 7 3)); }
    plane { type symmetryPlane; faces ((0 3 2 1)); }
    sides { type patch; faces ((1 2 6 5) (0 1 5 4) (3 7 6 2) (4 5 6 7)); }
);
EOD
control_dict none 3 1 timeStep 1 12
{ header fvSchemes; echo 'ddtSchemes {} gradSchemes { default Gauss linear; } divSchemes {} interpolationSchemes { default linear; }
laplacianSchemes { default Gauss linear corrected; } snGradSchemes { default corrected; }'; } > system/fvSchemes
header fvSolution > system/fvSolution
runs blockMesh
points=$(awk '/^[0-9]+$/ { print; exit }' constant/polyMesh/points)
for time in 0 1 2 3; do
    mkdir -p $time
    { header pointD pointVectorField; cat <<EOD; } > $time/pointD
dimensions [0 1 0 0 0 0 0];
internalField nonuniform List<vector> $points ($(awk "BEGIN { for (i = 0; i < $points; ++i) print \"(\" sin(i + $time), cos(3*i), i*$time \")\" }"));
boundaryField
{
    clamp { type fixedValue; value uniform (0 0 0); }
    plane { type symmetryPlane; }
    sides { type calculated; }
}
EOD
done

file=postProcessing/test/0/trajectory.h5
recorder 'fields (pointD); location points;'
eigenvalues() { m4gn segment "$1" --method slic-md --segments 6 --modes 8 --json "$2" > log.segment; }
numbers() { sed -n '/"eigenvalues"/,/]/p' "$1" | grep -E '^ *[0-9]'; }
runs postProcess -time '1:'
content $file
content $file | grep -q "^mesh  *$points cells, .* solved in xyz" || fail "expected $points nodes"
# Points that two patches share: the handle first, then the symmetry plane
content $file | grep -q 'clamp  *30 faces, handle' || fail "expected 30 nodes of the clamp"
content $file | grep -q 'plane  *72 faces, symmetry' || fail "expected 72 nodes of the plane"
content $file | grep -q '^frames  *3 from 1 to 3 s' || fail "expected 3 frames"
mv $file ../serial.h5
eigenvalues ../serial.h5 ../serial.json

# Slabs, and cells dealt at random: then ranks have edges of other ranks' nodes, and nodes without all of their cells
{ header cells labelList; echo "240 ($(awk 'BEGIN { srand(5); for (i = 0; i < 240; ++i) print int(4*rand()) }'))"; } > constant/cells
for method in 'simple; coeffs { n (3 1 1); }' 'manual; coeffs { dataFile "cells"; }'; do
    ranks=3; case $method in manual*) ranks=4 ;; esac
    decomposition $ranks "${method%%;*}" "${method#*;}"
    rm -rf processor* postProcessing
    runs decomposePar -time '0:'
    runs mpirun -np $ranks postProcess -parallel -time '1:'
    diff <(content ../serial.h5) <(content $file) || fail "$ranks ranks recorded something else than one"
    eigenvalues $file ../parallel.json
    below "$(paste <(numbers ../serial.json) <(numbers ../parallel.json) |
        awk '{ d = $1/$2 - 1; if (d < 0) d = -d; if (d > m) m = d; n += NF == 2 } END { print (n > 5) ? m + 0 : "too few" }')" \
        1e-10 "eigenvalues, $ranks ranks (${method%%;*})"
done

recorder 'fields (pointD); location nodes;'
refused 'expected cells or points' postProcess -time '1:'
rm -r processor* postProcessing
recorder 'fields (D); location points;'
refused 'nor stored at time 1 as a pointScalarField or pointVectorField' postProcess -time '1:'
