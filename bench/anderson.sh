#!/usr/bin/env bash
# solids4foam's own tutorials, plain and with m4gnAnderson by turns: correctors, the difference of D after the last step over its largest value, and
# the time with m4gnAnderson over that without (processor time, user and system). Needs solids4foam (setup/solids4foam.sh SOURCE).
#   bench/anderson.sh FOLDER [--repeats N] [--only PATTERN]    medians of N (3) runs (docs/lab/2026-11-solids.md)
. "$(dirname "${BASH_SOURCE[0]}")/../tests/e2e/common.sh"
needs_solids4foam
# shellcheck source=tests/e2e/_solids4foam-tutorial.sh
. "$M4GN_HOME/tests/e2e/_solids4foam-tutorial.sh"

usage='usage: bench/anderson.sh FOLDER [--repeats N] [--only PATTERN]'
[ $# -gt 0 ] || die "no folder was given" "$usage"
cd "$OLDPWD" && mkdir -p "$1" && folder=$(realpath "$1")
shift
repeats=3 only=.
while [ $# -gt 0 ]; do
    case $1 in
        --repeats) repeats=$2 ;;
        --only) only=$2 ;;
        *) die "unknown argument $1" "$usage" ;;
    esac
    shift 2
done

# alter WHAT: what a row changes of its tutorial
alter() {
    case $1 in
        -) ;;
        pressure) set_entries constant/mechanicalProperties solvePressureEqn no ;;
        damping) swings && control_model dampingCoeff 'dampingCoeff [0 0 -1 0 0 0 0] 1e4' ;;
        predictor) swings && control_model predictor yes ;;
        cells) control_model cellDisplacements '{ one { approximateCoordinate (24e-3 30e-3 0); displacement (0 1e-3 0); } }' ;;
        *) die "unknown change $1" "$usage" ;;
    esac
}
# swings: Cook's membrane does, instead of being at rest in each time step
swings() {
    sed -i '/d2dt2Schemes/,/}/s/steadyState/Euler/; /ddtSchemes/,/}/s/steadyState/Euler/' system/fvSchemes
    control deltaT 1e-6 endTime "${steps}e-6"
}
# control_model ENTRY VALUE: of the coefficients of the solid model
control_model() {
    sed -i "/Coeffs/,/{/s/{/{ $1 $2;/" constant/solidProperties
    sed -i "s/$1 \({.*}\);/$1 \1/" constant/solidProperties
}

# told KEY: what m4gnAnderson says at the end of a run; nothing where it is not in the run
told() {
    python3 -c 'import glob, json, sys
for file in glob.glob("postProcessing/anderson/*/summary.json"): print(json.load(open(file)).get(sys.argv[1], ""))' "$1"
}
# correctors: of m4gnAnderson and of the solver. The last line of a time step has those of the solver, but at its limit.
correctors() {
    awk -v ahead="$(told correctors)" -v most="$(sed -n 's/^ *nCorrectors *\([0-9]*\);.*/\1/p' constant/solidProperties | head -n 1)" '
        function add() { n += last; last = 0 }
        /^Time = / { add() }
        /^ *[0-9]+, / { split($1, a, ","); last = a[1] + 1 }
        /Max iterations reached/ { last = most ? most : 10000 }
        END { add(); print n + ahead }' log.run
}
median() { sort -g | awk '{ a[NR] = $1 } END { print (a[int((NR + 1)/2)] + a[int((NR + 2)/2)])/2 }'; }
# timed: processor time of the solver (s)
timed() {
    TIMEFORMAT='%U %S'
    { time runs solids4Foam > /dev/null; } 2>&1 | awk 'NF == 2 && $1 $2 ~ /^[0-9.]+$/ { print $1 + $2; found = 1 } !(NF == 2) { print > "/dev/stderr" } END { exit !found }'
}

echo "| tutorial of solids4foam | time steps | correctors without, with | time, s: without, with | with over without | D off by | steps solved ahead, left |"
echo "| --- | --- | --- | --- | --- | --- | --- |"
while read -r tutorial steps change words; do
    what="$tutorial${words:+, $words}"
    grep -q -- "$only" <<< "$what" || continue
    cd "$folder" && rm -rf case plain
    solids4foam_tutorial "$tutorial" "$steps" case
    control writeInterval "$steps"
    alter "$change"
    : > "$folder/plain-times" && : > "$folder/times"
    for ((i = 0; i < repeats; ++i)); do
        clean_case
        : > system/functions
        timed >> "$folder/plain-times"
        without=$(correctors)
        last=$(foamListTimes -latestTime)
        keep plain "$last/D"
        clean_case
        echo 'anderson { type m4gnAnderson; libs (m4gnAccelerators); }' > system/functions
        timed >> "$folder/times"
    done
    with=$(correctors)
    ahead=$(told why)
    [ -n "$ahead" ] || ahead="$(told time_steps_solved), $(told time_steps_left)"
    plain=$(median < "$folder/plain-times") taken=$(median < "$folder/times")
    off=0
    cmp -s ../plain/D "$last/D" || off=$(difference ../plain/D "$last/D")
    echo "| $what | $steps | $without, $with | $plain, $taken | $(calc "$taken/$plain") | $off | $ahead |"
done <<'EOD'
linearElasticity/cooksMembrane 1 -
linearElasticity/plateHole 1 - analytical tractions, symmetry
linearElasticity/pressurisedCylinder 1 -
linearElasticity/cooksMembrane 1 cells a cell displacement
linearElasticity/cooksMembrane 100 damping Euler, damping
linearElasticity/cooksMembrane 100 predictor predictor
linearElasticity/rigidCylinderContactBrick 14 - contact
multiMaterial/layeredPipe 1 - two materials
viscoelasticity/viscoTube 10 -
elastoplasticity/perforatedPlate/perforatedPlate 10 -
elastoplasticity/cooksMembrane 30 - updated Lagrangian
elastoplasticity/cylinderExpansion 100 - pressure equation
hyperelasticity/longWall 10 - zero shear, pressure equation
hyperelasticity/longWall 10 pressure zero shear, solvePressureEqn no
hyperelasticity/cylindricalPressureVessel 4 - pressure equation
hyperelasticity/cylindricalPressureVessel 4 pressure solvePressureEqn no
hyperelasticity/rigidRotation/rotatingBlock 50 -
hyperelasticity/rigidRotation/rotatingCylinder 3 -
hyperelasticity/cantileverBeam 1 - unstructured gradients
linearElasticity/waveBar 4000 - explicit
EOD
