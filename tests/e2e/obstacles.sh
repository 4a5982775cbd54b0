#!/usr/bin/env bash
# constant/obstacles: the fields obstacle and obstacleAhead are where it is and will be, a surface from a file is the same obstacle, and what
# does not fit between a case and a model is refused.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# It passes the tip of the beam, out of its way
make_beam case
stress yes 5 1e-3
obstacles() { { header obstacles; echo "range 0.04; ahead ${1:-0.01}; punch { $ball motion table ((0 (0 0 0)) (1 (-0.1 0 0))); }"; } > constant/obstacles; }
ball='type searchableBox; min (0.36 0.07 -1); max (0.4 0.1 1);'
beside='written { type writeObjects; libs (utilityFunctionObjects); objects (obstacle obstacleAhead); writeOption anyWrite; writeControl writeTime; }'
fields='fields (D ddt(D) obstacle obstacleAhead); writeControl timeStep; writeInterval 1;'
obstacles && record "$fields"
below "$(difference 0.24/obstacle 0.23/obstacleAhead)" 1e-12 'obstacleAhead at 0.23 s, off obstacle at 0.24 s'
below "$(difference 0.23/obstacle 0.23/obstacleAhead | awk '{ print 1/$1 }')" 1000 'and obstacle at 0.23 s is another, its inverse'
cp postProcessing/test/0/trajectory.h5 ..
keep full 0.01

# The same box from a file
mkdir constant/triSurface
awk 'BEGIN {
    print "solid punch"
    split("0 0 0 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 1 1 1 0 1 1", u, " ")
    split("1 3 2 1 4 3 5 6 7 5 7 8 1 2 6 1 6 5 2 3 7 2 7 6 3 4 8 3 8 7 4 1 5 4 5 8", t, " ")
    for (i = 0; i < 12; ++i) {
        print "facet normal 0 0 0\nouter loop"
        for (k = 1; k <= 3; ++k) {
            p = 3*(t[3*i + k] - 1)
            printf "vertex %.3f %.3f %.3f\n", 0.36 + 0.04*u[p + 1], 0.07 + 0.03*u[p + 2], -1 + 2*u[p + 3]
        }
        print "endloop\nendfacet"
    }
    print "endsolid punch"
}' > constant/triSurface/punch.stl
control endTime 0.01
ball='type triSurfaceMesh; file "punch.stl";'
obstacles && record "$fields"
close_to ../full 1e-5 0.01/obstacle

# What does not fit is refused before anything is solved
ball='type searchableDisk; origin (0.4 0.1 0.005); normal (0 1 0); radius 0.1;'
obstacles && clean_case && recorder "$fields"
refused 'the obstacle punch, a .*, is open' solidDisplacementFoam
ball='type searchableSphere; centre (0.4 0.1 0.005); radius 0.04;'
unset beside

# A model that reads the obstacle, and one that does not
config() {
    network 0.01 0 'count = 4; method = "metis"' \
        'steps = 5; batch_size = 2; learning_rate = 1e-3; decay_steps = 5; normaliser_steps = 5; normaliser_warmup = 2' \
        '{ name = "D", input = true, output = "delta" }' '{ name = "ddt(D)", input = true, output = "delta" }' "$@"
}
config '{ name = "obstacle", input = true, output = "none" }' '{ name = "obstacleAhead", input = true, output = "none" }' > ../seeing.toml
config > ../blind.toml
for name in seeing blind; do
    runs m4gn train --data "$work/trajectory.h5" --config ../$name.toml --out "$work/$name.safetensors"
done
good='mode replace; solverSteps 4; surrogateSteps 2;'
obstacles
control endTime 0.05
clean_case
expect_error 'The case has obstacles .*does not read obstacle' "$good model \"$work/blind.safetensors\";"
for name in blind seeing; do
    ride "$good model \"$work/$name.safetensors\"; outOfRange ignore;"
    jumped + 2
done
clean_case
obstacles 0.02
expect_error 'ahead .* is 0.02 s, and the stride of the model is 0.01 s' "$good model \"$work/seeing.safetensors\";"
rm constant/obstacles
refused 'this case has no.*file constant/obstacles' solidDisplacementFoam
recorder "$fields"
refused 'Field obstacle is neither registered' solidDisplacementFoam
