#!/usr/bin/env bash
# solidDisplacementFoam and a rigid obstacle: the beam bends around it as beams do, a state in touch with it is handed back, a model reads
# where it is and will be, on one rank and on two, what does not fit is refused, and the shipped model is near the solver.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# The beam of 'm4gn generate pressed-beam', the cylinder at 0.45 m of 0.6 m
cp -r "$M4GN_HOME/openfoam/templates/pressed-beam" case && cd case
cp "$M4GN_HOME/openfoam/tutorials/beam/system/decomposeParDict" system
sed -i 's/@x@/0.45/; s/@y@/0.081/; s/@radius@/0.05/; s/@frequency@/0.8/; s/@quarter@/0.3125/; s/@half@/0.01/g' constant/obstacles
sed -i 's/@tolerance@/5e-6/; s/nCorrectors .*/nCorrectors 5000;/' system/fvSolution
sed -i 's/@endTime@/0.38/; s/@deltaT@/0.001/; s/@writeInterval@/0.005/; s/^startFrom .*/startFrom startTime;/; s/writePrecision.*/writePrecision 14;/' \
    system/controlDict
: > system/functions
runs blockMesh
cp -r . ../whole

# A static beam, bent by a cylinder at a: what is at x behind it moves 1 + 1.5 (x/a - 1) times as far (Euler-Bernoulli)
sed -i 's/Euler/steadyState/' system/fvSchemes
sed -i 's/^endTime .*/endTime 0.002;/; s/^writeInterval .*/writeInterval 0.002;/' system/controlDict
sed -i '/motion/,/}/d; s/(0.45 /(0.4575 /' constant/obstacles    # above the middle of a face, where the gap is measured
sed -i 's/radius.*/& motion table ((0 (0 0 0)) (0.001 (0 -0.006 0)) (1 (0 -0.006 0)));/' constant/obstacles
runs solidDisplacementFoam
# moved X: mean displacement in y of the cells around the place, of 40 x 8 cells of 0.015 m
moved() { values 0.002/D | awk -v x="$1" '{ c = 0.015*((NR - 1) % 40 + 0.5) } c > x - 0.001 && c < x + 0.001 { s += $2; ++n } END { print s/n }'; }
below "$(awk "BEGIN { r = $(moved 0.5925)/$(moved 0.4575); e = r/(1 + 1.5*(0.5925/0.4575 - 1)) - 1; print e < 0 ? -e : e }")" 0.03 'the last cells over those under the cylinder, off the beam on paper'
below "$(awk "BEGIN { e = $(moved 0.4575)/-0.005 - 1; print e < 0 ? -e : e }")" 0.03 'displacement under the cylinder, off its own since it touches'
cd .. && rm -r case && cp -r whole case && cd case

# The fields are where the obstacle is, now and by `ahead` later
function_object m4gnRecorder 'fields (D ddt(D) obstacle obstacleAhead); writeControl timeStep; writeInterval 1;'
others='written { type writeObjects; libs (utilityFunctionObjects); objects (obstacle obstacleAhead ddt(D)); writeOption anyWrite; writeControl writeTime; }
    gradient { type grad; libs (fieldFunctionObjects); field D; executeControl timeStep; writeControl writeTime; }'
echo "$others" >> system/functions
runs solidDisplacementFoam
below "$(difference 0.24/obstacle 0.2/obstacleAhead)" 1e-12 'obstacleAhead at 0.2 s, off obstacle at 0.24 s'
below "$(difference 0.2/obstacle 0.2/obstacleAhead | awk '{ print 1/$1 }')" 100 'and obstacle at 0.2 s is another, its inverse'
cp postProcessing/test/0/trajectory.h5 ..
mkdir ../full && cp -r 0.* ../full

# The same on two ranks, to the tolerance of the solver
: > system/functions
on_two_ranks solidDisplacementFoam
runs reconstructPar -time 0.38
below "$(difference ../full/0.38/D 0.38/D)" 2e-4 'D on two ranks'
clean_case

# A surface from a file is the same obstacle
sed -i '/^punch/,$d' constant/obstacles && cp constant/obstacles ../settings
mkdir constant/triSurface
awk 'BEGIN {
    print "solid punch"
    split("0 0 0 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 1 1 1 0 1 1", u, " ")
    split("1 3 2 1 4 3 5 6 7 5 7 8 1 2 6 1 6 5 2 3 7 2 7 6 3 4 8 3 8 7 4 1 5 4 5 8", t, " ")
    for (i = 0; i < 12; ++i) {
        print "facet normal 0 0 0\nouter loop"
        for (k = 1; k <= 3; ++k) {
            p = 3*(t[3*i + k] - 1)
            printf "vertex %.3f %.3f %.3f\n", 0.4 + 0.1*u[p + 1], 0.04 + 0.1*u[p + 2], -1 + 2*u[p + 3]
        }
        print "endloop\nendfacet"
    }
    print "endsolid punch"
}' > constant/triSurface/punch.stl
record() { function_object m4gnRecorder 'fields (D obstacle); writeControl timeStep; writeInterval 1;'; echo "$others" >> system/functions; }
still() { { cat ../settings; echo "punch { $* motion table ((0 (0 0 0)) (1 (0.1 -0.02 0))); }"; } > constant/obstacles; }
sed -i 's/^endTime .*/endTime 0.01;/' system/controlDict
record
still 'type searchableBox; min (0.4 0.04 -1); max (0.5 0.14 1);'
runs solidDisplacementFoam
mkdir ../box && cp -r 0.01 ../box
clean_case && record
still 'type triSurfaceMesh; file "punch.stl";'
runs solidDisplacementFoam
below "$(difference ../box/0.01/obstacle 0.01/obstacle)" 1e-5 'a box from a file, off a searchableBox'

# What does not fit is refused before anything is solved
bad() {
    local text=$1
    shift
    { cat ../settings; echo "$*"; } > constant/obstacles
    clean_case && record
    refused "$text" solidDisplacementFoam
}
ball='type searchableSphere; centre (0.45 0.2 0.03); radius 0.05;'
bad 'The obstacle punch has no entry motion' "punch { $ball }"
bad 'the obstacle punch, a .*, is open' 'punch { type searchableDisk; origin (0.45 0.1 0.03); normal (0 1 0); radius 0.1; motion constant (0 0 0); }'
bad 'There is no obstacle in this file'
bad 'm inside of an obstacle' 'punch { type searchableSphere; centre (0.45 0.07 0.03); radius 0.05; motion constant (0 0 0); }'
sed -i 's/^range .*/range 0;/' ../settings
bad 'expected numbers above 0' "punch { $ball motion constant (0 0 0); }"
sed -i 's/^range .*/range 0.04;/' ../settings
rm constant/obstacles
refused 'There is no file "constant/obstacles"' solidDisplacementFoam
cd .. && rm -r case && cp -r whole case && cd case
sed -i 's/type  *obstacleTraction;/& penaltyFactor 0;/' 0/D
refused 'penaltyFactor is 0; expected a number above 0' solidDisplacementFoam
cd .. && rm -r case && cp -r whole case && cd case

# A model that reads the obstacle, and one that does not
config() {
    network 0.04 0 '{ name = "D", input = true, output = "delta" }' '{ name = "ddt(D)", input = true, output = "delta" }' "$@"
    cat <<'EOD'
[segments]
count = 4
method = "metis"
[training]
steps = 30
batch_size = 2
learning_rate = 1e-3
decay_steps = 30
normaliser_steps = 10
normaliser_warmup = 2
EOD
}
config '{ name = "obstacle", input = true, output = "none" }' '{ name = "obstacleAhead", input = true, output = "none" }' > ../seeing.toml
config > ../blind.toml
for name in seeing blind; do
    runs m4gn train --data "$work/trajectory.h5" --config ../$name.toml --out "$work/$name.safetensors"
done
surrogate() {
    clean_case
    cp -r ../full/0.2 .
    sed -i 's/^startTime .*/startTime 0.2;/' system/controlDict
    function_object m4gnSurrogate "mode replace; solverSteps 20; surrogateSteps 2; $*"
    echo "$others" >> system/functions
}
surrogate "model \"$work/blind.safetensors\";"
refused 'The case has obstacles .*does not read obstacle' solidDisplacementFoam
surrogate "model \"$work/blind.safetensors\"; outOfRange ignore;"
runs solidDisplacementFoam
surrogate "model \"$work/seeing.safetensors\";"
runs solidDisplacementFoam
grep -q '^m4gn: jumped 2 steps .*; gapBefore [-0-9.e]*; gap [-0-9.e]*;' log.run || { cat log.run; fail "no jump with a gap"; }
grep -q 'gap' postProcessing/test/0.2/surrogate.dat || fail "surrogate.dat has no gap"
mkdir ../serial && cp -r 0.3 ../serial
surrogate "model \"$work/seeing.safetensors\";"
cp system/functions ../functions && : > system/functions
runs decomposePar -time 0.2
cp ../functions system/functions
runs mpirun -np 2 solidDisplacementFoam -parallel
runs reconstructPar -time 0.3 -fields '(D)'
below "$(difference ../serial/0.3/D 0.3/D)" 2e-4 'D after a jump on two ranks'
surrogate "model \"$work/seeing.safetensors\";"
sed -i 's/^ahead .*/ahead 0.02;/' constant/obstacles
refused 'ahead .* is 0.02 s, and the stride of the model is 0.04 s' solidDisplacementFoam
surrogate "model \"$work/seeing.safetensors\";"
sed -i 's/obstacleTraction/fixedGradient; gradient uniform (0 0 0)/' 0.2/D
mv constant/obstacles ..
refused 'this case has no.*file constant/obstacles' solidDisplacementFoam
mv ../obstacles constant && sed -i 's/^ahead .*/ahead 0.04;/' constant/obstacles

# A state in touch with the obstacle, handed back: as it was, and with an error of 1 % from cell to cell
make_oracle
export ORACLE_STRIDE=0.025 ORACLE_FRAMES=25
clean_case
sed -i 's/^startTime .*/startTime 0;/' system/controlDict
function_object m4gnRecorder 'fields (D ddt(D)); writeControl timeStep; writeInterval 1;'
runs solidDisplacementFoam
oracle() {
    clean_case
    : > any
    cp -r ../full/0.3 .
    sed -i 's/^startTime .*/startTime 0.3;/' system/controlDict
    function_object m4gnSurrogate "mode replace; model any; solverSteps 20; surrogateSteps 2; outOfRange ignore; $*"
    runs solidDisplacementFoam
    correctors=$(sed -n 's/^m4gn: correctors .* after the jump: \(.*\); median.*/\1/p' log.run | awk 'NR == 1 { print $1 + $2 + $3 + $4 + $5 }')
    gap=$(sed -n 's/^m4gn: jumped .*; gap \([^;]*\);*.*/\1/p' log.run | head -n 1)
    echo "$*: $correctors correctors, gap $gap m"
}
depth() { awk "BEGIN { print $gap < 0 ? -1*$gap : 0 }"; }
oracle 'smoothing none; contact none;'
exact=$correctors
below "$(difference ../full/0.37/D 0.37/D)" 1e-12 'the recorded D as it was predicted'
below "$(depth)" 1e-5 'penetration (m)'
awk "BEGIN { exit !($gap < 1e-5) }" || fail "the recorded state is not in touch with the obstacle: gap $gap"
below "$(difference ../full/0.38/D 0.38/D)" 1e-4 'D ten steps later'
oracle
below "$(difference ../full/0.37/D 0.37/D)" 5e-4 'the recorded D, projected and smoothed'
below "$(depth)" 1e-5 'penetration (m)'
below "$(awk "BEGIN { print $correctors/$exact }")" 1.3 'correctors of the five steps after it, over those of the recorded one as it was'
export ORACLE_ROUGH=0.01
oracle 'smoothing none; contact none;'
rough=$correctors roughDepth=$(depth)
awk "BEGIN { exit !($roughDepth > 5e-5) }" || fail "the rough error brings the beam in by $roughDepth m only"
oracle
below "$(awk "BEGIN { print $correctors/$rough }")" 0.95 'correctors after a rough error, over those of the error as it was'
below "$(depth)" 2e-5 'penetration after a rough error (m)'

while read -r entries; do
    text=${entries#*: } entries=${entries%%: *}
    clean_case && cp -r ../full/0.3 .
    function_object m4gnSurrogate "mode replace; model any; solverSteps 20; surrogateSteps 2; $entries"
    refused "$text" solidDisplacementFoam
done <<'EOD'
contact some;: Entry contact of .* is some; expected none, or contact { length 8; }
contact { length 0; }: is 0 cells; expected more than 0
contact { width 2; }: Unknown entry width in .*contact
EOD

cd "$work"
shipped_model_is_near pressed-beam 0.15
echo "contact: passed"
