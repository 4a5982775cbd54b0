# shellcheck shell=bash
# Small cases of the cylinder for the end-to-end tests. Sourced; leaves the test in a temporary folder of its own.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/../../setup/common.sh"
. "$M4GN_HOME/env.sh"
mpi_environment
export LC_ALL=C

work=$(mktemp -d)
trap 'status=$?; rm -rf "$work"; [ $status -ne 0 ] || echo "$(basename "$0" .sh): passed"' EXIT
# One that is ended from outside has not passed, whatever its last command was
trap 'exit 1' HUP INT TERM
cd "$work"

# Random weights, stride 0.01 s: enough for the machinery, and nothing has to be trained first
small_model=$M4GN_HOME/tests/cabi/small.safetensors
# Entries of m4gnSurrogate with it, and for one jump from 0.02 to 0.04
# shellcheck disable=SC2034  # used by the tests
small="model \"$small_model\";" jump="mode replace; model \"$small_model\"; timeStart 0.02; solverSteps 5; surrogateSteps 2;"

fail() { echo "FAILED: $*" >&2; exit 1; }

# skip WHY: the machine lacks what the test needs. 77 is what ./Alltest counts as skipped.
skip() { echo "skipped: $*"; exit 77; }

# needs_solids4foam: finds it, or skips the test
needs_solids4foam() {
    solids4foam_environment ||
        skip "there is no solids4foam in ${SOLIDS4FOAM_INST_DIR:-$M4GN_CACHE/solids4foam} (setup/solids4foam.sh SOURCE builds it)"
}

# header NAME [CLASS]: what an OpenFOAM file of this name begins with; a dictionary if nothing is said.
header() { echo "FoamFile { version 2.0; format ascii; class ${2:-dictionary}; object $1; }"; }

# set_entries FILE NAME VALUE...: other values for entries of a dictionary, wherever in it they are.
set_entries() {
    local file=$1 separator=$'\x01'
    shift
    while [ $# -gt 0 ]; do
        grep -qE "(^|[ {;])$1 +[^;{}]*;" "$file" || fail "$file has no entry $1"
        sed -i -E "s$separator(^|[ {;])$1 +[^;{}]*;$separator\\1$1 $2;$separator" "$file"
        shift 2
    done
}

# control NAME VALUE...: of system/controlDict
control() { set_entries system/controlDict "$@"; }

# ddt_scheme SCHEME: the default of the case
ddt_scheme() { sed -i "/ddtSchemes/,/}/s/default [^;]*;/default $1;/" system/fvSchemes; }

# decomposition RANKS METHOD [ENTRIES]: system/decomposeParDict
decomposition() { echo "$(header decomposeParDict) numberOfSubdomains $1; method $2; ${3:-}" > system/decomposeParDict; }

# control_dict APPLICATION END DELTA_T WRITE_CONTROL WRITE_INTERVAL PRECISION: system/controlDict of a run from time 0, without function
# objects, on two ranks where it is decomposed.
control_dict() {
    { header controlDict; cat <<EOD; } > system/controlDict
application     $1;
startFrom       startTime;
startTime       0;
stopAt          endTime;
endTime         $2;
deltaT          $3;
writeControl    $4;
writeInterval   $5;
writeFormat     ascii;
writePrecision  $6;
timePrecision   8;
runTimeModifiable no;
functions       { #include "functions" }
EOD
    : > system/functions
    decomposition 2 simple 'coeffs { n (2 1 1); }'
}

# block 'X Y Z' 'NX NY NZ' PATCHES: a mesh of one block from the origin, of these lengths and cells; faces of its patches are LEFT and RIGHT (along
# x), BOTTOM and TOP, BACK and FRONT.
block() {
    local x y z patches=$3
    read -r x y z <<< "$1"
    patches=${patches//LEFT/(0 4 7 3)} patches=${patches//RIGHT/(1 2 6 5)} patches=${patches//BOTTOM/(0 1 5 4)}
    patches=${patches//TOP/(3 7 6 2)} patches=${patches//BACK/(0 3 2 1)} patches=${patches//FRONT/(4 5 6 7)}
    { header blockMeshDict; cat <<EOD; } > system/blockMeshDict
vertices ((0 0 0) ($x 0 0) ($x $y 0) (0 $y 0) (0 0 $z) ($x 0 $z) ($x $y $z) (0 $y $z));
blocks (hex (0 1 2 3 4 5 6 7) ($2) simpleGrading (1 1 1));
boundary ($patches);
EOD
    runs blockMesh
}

# What gmsh makes of mesh.geo, once for all scripts that ./Alltest runs
mesh_of_the_cylinder() {
    local kept=${M4GN_TEST_MESHES:+$M4GN_TEST_MESHES/$(cat mesh.geo system/controlDict | cksum | tr ' ' -)}
    if [ -d "$kept" ]; then
        rm -rf constant/polyMesh && cp -r "$kept" constant/polyMesh
        return
    fi
    runs gmsh -nt 1 -3 -format msh2 -o mesh.msh mesh.geo
    runs gmshToFoam mesh.msh
    runs changeDictionary -constant
    if [ -n "$kept" ]; then
        # In one go, as another script may do the same
        mkdir -p "$kept.$$" && cp -r constant/polyMesh/. "$kept.$$"
        mv -T "$kept.$$" "$kept" 2> log.mesh || rm -rf "$kept.$$"
    fi
}

# make_case FOLDER [NAME VALUE...]: about 900 triangles, icoFoam, 0.002 s a step, ASCII fields every 0.01 s to 0.06 s, or as these entries of
# controlDict have it.
make_case() {
    cp -r "$M4GN_HOME/openfoam/templates/cylinder-flow" "$1"
    cd "$1"
    rm family.toml
    sed -i -e 's/@x@/0.31/; s/@y@/0.212/; s/@radius@/0.052/; s/@size@/0.058/; s/@nu@/1e-3/; s/@shape@/0/; s/@elements@/0/' \
        -e 's/@linear@/15.121951/; s/@quadratic@/-36.882808/' mesh.geo 0/U constant/transportProperties
    sed -i 's/@tolerance@/1e-6/; s/@correctors@/1/; s/@convection@/1/' system/fv{Solution,Schemes}
    control_dict icoFoam 0.06 0.002 adjustableRunTime 0.01 12
    # Ranks differ in where their linear solvers stop; that is not what is tested
    set_entries system/fvSolution tolerance 1e-10 relTol 0
    pressure_by_pcg
    mesh_of_the_cylinder
    cp -r "$M4GN_HOME/openfoam/templates/cylinder-flow/0/." 0
    sed -i 's/@linear@/15.121951/; s/@quadratic@/-36.882808/' 0/U
    # Behind the mesh, which is written as text
    control "${@:2}"
}

# pressure_by_pcg: between ranks on one core a message costs more than a sweep over some hundred cells, and the levels of multigrid send several times
# as many
pressure_by_pcg() {
    sed -i 's/solver  *GAMG;/solver PCG;/; s/smoother  *GaussSeidel;/preconditioner DIC;/' system/fvSolution
    ! grep -q GAMG system/fvSolution || fail 'system/fvSolution still has GAMG'
}

# network STRIDE RWSE_STEPS SEGMENTS TRAINING FIELDS...: the configuration of a small network of these fields, a line each, and of its training;
# entries of [segments] and [training] stand between semicolons.
network() {
    cat <<EOD
[model]
stride = $1
width = 8
hidden_layers = 1
activation = "silu"
layers_before = 2
layers_after = 1
fields = [
$(printf '    %s,\n' "${@:5}")
]
[macro]
layers = 1
heads = 2
ffn_width = 16
rwse_steps = $2
centroids = true
offsets = true
[segments]
${3//; /$'\n'}
[training]
${4//; /$'\n'}
EOD
}

# with_input FIELD: a configuration that trains the small model with a field more that it reads and does not predict.
with_input() {
    network 0.01 4 'count = 4; modes = 3' 'batch_size = 1; learning_rate = 1e-3; decay_steps = 1' '{ name = "U", input = true, output = "delta" }' \
        '{ name = "p", input = true, output = "value" }' "{ name = \"$1\", input = true, output = \"none\" }"
}

# stress COMPACT CORRECTORS TOLERANCE: the form of the normal stress, and where a step of solidDisplacementFoam stops
stress() { sed -i "s/^stressAnalysis.*/stressAnalysis { compactNormalStress $1; nCorrectors $2; D $3; }/" system/fvSolution; }

# make_beam FOLDER [NAME VALUE...]: a beam of 0.4 x 0.05 m, clamped at its left, loaded at its tip at time 0; solidDisplacementFoam, with these
# entries of controlDict. One period is some 0.5 s.
make_beam() {
    mkdir -p "$1"/{0,constant,system} && cd "$1"
    control_dict solidDisplacementFoam 0.255 0.005 timeStep 1 14
    control "${@:2}"
    { header fvSchemes; cat <<'EOD'; } > system/fvSchemes
d2dt2Schemes { default Euler; }
ddtSchemes { default Euler; }
gradSchemes { default leastSquares; grad(D) leastSquares; }
divSchemes { default none; div(sigmaD) Gauss linear; }
laplacianSchemes { default none; laplacian(DD,D) Gauss linear corrected; laplacian(m4gn) Gauss linear corrected; }
interpolationSchemes { default linear; }
snGradSchemes { default none; }
EOD
    { header fvSolution; cat <<'EOD'; } > system/fvSolution
solvers { "(D|T)" { solver PCG; preconditioner DIC; tolerance 1e-12; relTol 0.001; } }
stressAnalysis { compactNormalStress yes; }
EOD
    { header mechanicalProperties
      echo 'rho { type uniform; value 1000; } nu { type uniform; value 0.3; } E { type uniform; value 1e6; } planeStress yes;'
    } > constant/mechanicalProperties
    { header thermalProperties
      echo 'C { type uniform; value 434; } k { type uniform; value 60.5; } alpha { type uniform; value 1.1e-05; } thermalStress no;'
    } > constant/thermalProperties
    field D volVectorField '0 1 0 0 0 0 0' '(0 0 0)' '
    clamp { type fixedValue; value uniform (0 0 0); }
    tip { type tractionDisplacement; traction uniform (0 50 0); pressure uniform 0; value uniform (0 0 0); }
    sides { type tractionDisplacement; traction uniform (0 0 0); pressure uniform 0; value uniform (0 0 0); }
    frontAndBack { type empty; }
    '
    block '0.4 0.05 0.01' '24 4 1' 'clamp { type patch; faces (LEFT); } tip { type patch; faces (RIGHT); }
        sides { type wall; faces (BOTTOM TOP); } frontAndBack { type empty; faces (BACK FRONT); }'
}

# square_mesh: nine blocks around a square of 0.02 m, which is the one in the middle
square_mesh() {
    local x=(-0.1 -0.01 0.01 0.3) y=(-0.1 -0.01 0.01 0.1) nx=(11 7 24) ny=(9 7 9) grading=(0.25 1 4) i j z a
    header blockMeshDict
    echo "vertices ("
    for z in 0 0.01; do for j in 0 1 2 3; do for i in 0 1 2 3; do echo "(${x[i]} ${y[j]} $z)"; done; done; done
    echo "); blocks ("
    for j in 0 1 2; do
        for i in 0 1 2; do
            a=$((4*j + i))
            [ $a -eq 5 ] || echo "hex ($a $((a + 1)) $((a + 5)) $((a + 4)) $((a + 16)) $((a + 17)) $((a + 21)) $((a + 20)))" \
                "(${nx[i]} ${ny[j]} 1) simpleGrading (${grading[i]} ${grading[j]} 1)"
        done
    done
    face() { echo "($1 $2 $(($2 + 16)) $(($1 + 16)))"; }
    echo "); boundary (
        inlet { type patch; faces ($(face 0 4) $(face 4 8) $(face 8 12)); }
        outlet { type patch; faces ($(face 3 7) $(face 7 11) $(face 11 15)); }
        sides { type symmetry; faces ($(face 0 1) $(face 1 2) $(face 2 3) $(face 12 13) $(face 13 14) $(face 14 15)); }
        square { type wall; faces ($(face 5 6) $(face 9 10) $(face 5 9) $(face 6 10)); } );
        defaultPatch { name frontAndBack; type empty; }"
}

# field NAME CLASS DIMENSIONS VALUE PATCHES: 0/NAME
field() { echo "$(header "$1" "$2") dimensions [$3]; internalField uniform $4; boundaryField { $5 }" > "0/$1"; }

# square_field NAME DIMENSIONS VALUE WALL [CLASS]
square_field() {
    field "$1" "${5:-volScalarField}" "$2" "$3" "inlet { type fixedValue; value uniform $3; }
        outlet { type inletOutlet; inletValue uniform $3; value uniform $3; } sides { type symmetry; } square { $4 } frontAndBack { type empty; }"
}

# make_square FOLDER: a square of 0.02 m in a wind, some 1,000 cells, pimpleFoam; turbulence says with which model.
make_square() {
    mkdir -p "$1"/{0,constant,system} && cd "$1"
    square_mesh > system/blockMeshDict
    control_dict pimpleFoam 1.2 0.001 adjustableRunTime 0.4 12
    schemes 'default Gauss upwind; div(phi,U) Gauss linearUpwind grad(U); div((nuEff*dev2(T(grad(U))))) Gauss linear;'
    echo 'wallDist { method meshWave; }' >> system/fvSchemes
    { header fvSolution; cat <<'EOD'; } > system/fvSolution
solvers
{
    "p.*" { solver GAMG; smoother DICGaussSeidel; tolerance 1e-6; relTol 0.01; }
    "(U|k|omega|epsilon|nuTilda).*" { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-7; relTol 0; }
}
PIMPLE { nOuterCorrectors 1; nCorrectors 2; nNonOrthogonalCorrectors 0; }
EOD
    { header transportProperties; echo 'transportModel Newtonian; nu 1.5e-5;'; } > constant/transportProperties
    square_field U '0 1 -1 0 0 0 0' '(2 0.02 0)' 'type noSlip;' volVectorField
    square_field k '0 2 -2 0 0 0 0' 0.0024 'type kqRWallFunction; value uniform 0.0024;'
    square_field omega '0 0 -1 0 0 0 0' 25 'type omegaWallFunction; value uniform 25;'
    square_field epsilon '0 2 -3 0 0 0 0' 0.0054 'type epsilonWallFunction; value uniform 0.0054;'
    square_field nuTilda '0 2 -1 0 0 0 0' 6e-5 'type fixedValue; value uniform 0;'
    field p volScalarField '0 2 -2 0 0 0 0' 0 'outlet { type fixedValue; value uniform 0; } "(inlet|square)" { type zeroGradient; }
        sides { type symmetry; } frontAndBack { type empty; }'
    runs blockMesh
}

# turbulence MODEL NUT_AT_THE_WALL
turbulence() {
    { header turbulenceProperties; echo "simulationType RAS; RAS { RASModel $1; turbulence on; printCoeffs off; }"; } \
        > constant/turbulenceProperties
    field nut volScalarField '0 2 -1 0 0 0 0' 9e-5 "square { type $2; value uniform 0; }
        \"(inlet|outlet)\" { type calculated; value uniform 9e-5; } sides { type symmetry; } frontAndBack { type empty; }"
}

# schemes [DIV]: Euler and linear, with these entries of divSchemes behind the default.
schemes() {
    { header fvSchemes; cat <<EOD; } > system/fvSchemes
ddtSchemes { default Euler; }
gradSchemes { default Gauss linear; }
divSchemes { default Gauss linear; ${1:-} }
laplacianSchemes { default Gauss linear corrected; }
interpolationSchemes { default linear; }
snGradSchemes { default corrected; }
EOD
}

# solvers TOLERANCE P_REL_TOL: of flows and heat with one outer corrector
solvers() {
    { header fvSolution; cat <<EOD; } > system/fvSolution
solvers
{
    "rho.*" { solver diagonal; }
    "p.*" { solver PCG; preconditioner DIC; tolerance $1; relTol $2; }
    "(U|h|T|DT).*" { solver smoothSolver; smoother symGaussSeidel; tolerance $1; relTol 0; }
}
"(PIMPLE|PISO|SIMPLE)" { momentumPredictor yes; nOuterCorrectors 1; nCorrectors 2; nNonOrthogonalCorrectors 0; pRefCell 0; pRefValue 0; }
EOD
}

# wedge CELLS: a pipe of 1 m, radius 0.1 m, as a wedge. CELLS '16 6 1': along, across, around.
wedge() {
    { header blockMeshDict; cat <<EOD; } > system/blockMeshDict
vertices ((0 0 0) (1 0 0) (1 0.1 -0.004) (0 0.1 -0.004) (1 0.1 0.004) (0 0.1 0.004));
blocks (hex (0 1 2 3 0 1 4 5) ($1) simpleGrading (1 1 1));
boundary
(
    inlet { type patch; faces ((0 5 3 0)); }
    outlet { type patch; faces ((1 2 4 1)); }
    wall { type wall; faces ((3 5 4 2)); }
    back { type wedge; faces ((0 3 2 1)); }
    front { type wedge; faces ((0 1 4 5)); }
    axis { type empty; faces ((0 1 1 0)); }
);
EOD
    runs blockMesh
}

# laminar [NU]: what pimpleFoam and pisoFoam need beside what icoFoam has
laminar() {
    echo "$(header x) simulationType laminar; transportModel Newtonian; nu ${1:-1e-3};" | tee constant/turbulenceProperties > constant/transportProperties
    sed -i 's/div(phi,U) .*/div(phi,U) Gauss linear; div((nuEff*dev2(T(grad(U))))) Gauss linear;/' system/fvSchemes
}

# Removes what a run left.
clean_case() {
    find . -maxdepth 1 \( -name '[0-9]*' ! -name 0 -o -name 'processor[0-9]*' \) -exec rm -rf {} +
    rm -rf postProcessing 0/m4gnSegment 0/m4gnSegmentDict 0/m4gnGroup
}

# function_object TYPE ENTRIES...: of the case, called test, beside those in $beside.
function_object() {
    local type=$1
    shift
    echo "test { type $type; libs (m4gnFoam); $* } ${beside:-}" > system/functions
}
surrogate() { function_object m4gnSurrogate "$@"; }
recorder() { function_object m4gnRecorder "$@"; }

application() { sed -n 's/^application  *\(.*\);/\1/p' system/controlDict; }

# solve [RANKS]: the application of the case, on one rank or on more ($ranks), for which it is decomposed
solve() {
    local n=${1:-${ranks:-1}}
    if [ "$n" -eq 1 ]; then
        runs "$(application)"
    else
        runs decomposePar -force
        runs mpirun -np "$n" "$(application)" -parallel
    fi
}

# ride ENTRIES...: the case anew with m4gnSurrogate of these entries; record ENTRIES...: with m4gnRecorder.
ride() { clean_case && surrogate "$@" && solve; }
record() { clean_case && recorder "$@" && solve; }

# expect_error TEXT ENTRIES...: m4gnSurrogate of these entries ends the run, which says TEXT.
expect_error() { surrogate "${@:2}" && refused "$1" "$(application)"; }

# expect_errors [TYPE]: the same of each line 'ENTRIES => TEXT', of this type of function object
expect_errors() {
    local line
    while read -r line; do
        function_object "${1:-m4gnSurrogate}" "${line% => *}"
        refused "${line#* => }" "$(application)"
    done
}

# expect_in LOG TEXT...: it has each of these; expect_log TEXT...: that of the last run has; expect_silence TEXT...: it has none of them.
expect_in() {
    local text
    for text in "${@:2}"; do grep -q -- "$text" "$1" || { tail -n 60 "$1"; fail "the log does not say: $text"; }; done
}
expect_log() { expect_in log.run "$@"; }
expect_silence() {
    local text
    for text in "$@"; do ! grep -- "$text" log.run || fail "the log says: $text"; done
}

# keep NAME FILES...: a copy of them in ../NAME
keep() { rm -rf "../$1" && mkdir "../$1" && cp -r "${@:2}" "../$1"; }

# same_bytes FOLDER FILES...: the files are those of the same names there.
same_bytes() {
    local file
    for file in "${@:2}"; do cmp "$file" "$1/$file" || { grep m4gn log.run || true; fail "$file is not that of $1"; }; done
}

# close_to FOLDER LIMIT FILES...: the fields differ from those there by at most this, over the largest value.
close_to() {
    local file
    for file in "${@:3}"; do below "$(difference "$1/$file" "$file")" "$2" "$file against $1"; done
}

# drag NAME [ENTRIES]: a function object for forces on the cylinder.
drag() {
    echo "$1 { type forceCoeffs; libs (forces); patches (cylinder); rho rhoInf; rhoInf 1; magUInf 1; lRef 1; Aref 1; log no;
        CofR (0 0 0); liftDir (0 1 0); dragDir (1 0 0); pitchAxis (0 0 1); ${2:-} }"
}

# entry NAME [START]: of the summary of a run from this time, else of any.
entry() { sed -n "s/^ *\"$1\": \([^,]*\).*/\1/p" postProcessing/test/${2:-*}/summary.json; }

# times: all that the case has stored, from 0 on, in order
times() { find . -maxdepth 1 -name '[0-9]*' -printf '%f\n' | sort -g | tr '\n' ' '; }
# json FILE EXPRESSION: of Python, over what the file has, d
json() { python3 -c "import json, sys; d = json.load(open(sys.argv[1])); print($2)" "$1"; }
# figure FOLDER QUANTITY KEY [START]: of averages.json in a case, of a run from this time
figure() { json "$1/postProcessing/averages/${4:-0}/averages.json" "d['$2']['$3']"; }

# decided WHAT EXPRESSION [NAME]: of what the function object NAME (test) has decided, the expression holds, in Python: of(EVENT, FIELD=VALUE...)
# is a list of decisions (docs/reference/run-files.md).
decided() {
    python3 - "$2" "postProcessing/${3:-test}/decisions.jsonl" <<'EOD' || fail "$1: not $2"
import json, sys
all = [json.loads(line) for line in open(sys.argv[2])]
def of(event, **fields):
    return [d for d in all if d["event"] == event and all_are(d, fields)]
def all_are(d, fields):
    return not [name for name, value in fields.items() if d.get(name) != value]
if not eval(sys.argv[1]):
    sys.exit("\n".join(map(str, all)))
EOD
}

# jumped COUNT STRIDES: so many jumps of so many strides; COUNT +: at least one
jumped() {
    case $1 in
        +) decided "jumps of $2 strides" "of('handed_back', strides=$2)" ;;
        *) decided "$1 jumps of $2 strides" "len(of('handed_back', strides=$2)) == $1" ;;
    esac
}

# plain [TIMES...]: the run without function objects but $beside, of which these are kept in ../plain.
plain() {
    echo "${beside:-}" > system/functions
    clean_case
    solve
    [ $# -eq 0 ] || keep plain "$@"
}

# replaces LEAST WHAT: at least this share of the time from timeStart on was replaced.
replaces() {
    below "$1" "$(entry replaced_fraction)" "$2: least that is replaced"
}

# content FILE: what a recording has, wherever it stands.
content() { m4gn info "$1" | grep -E '^(mesh|patch|frames|field) '; }

# runs COMMAND...: must end with status 0. The log is log.run.
runs() {
    local status=0
    "$@" > log.run 2>&1 < /dev/null || status=$?
    [ $status -eq 0 ] || { tail -n 40 log.run; fail "'$*' ended with status $status"; }
}

# refused TEXT COMMAND...: must end with another status, and say TEXT.
refused() {
    local text=$1 status=0
    shift
    "$@" > log.run 2>&1 < /dev/null || status=$?
    [ "$status" -ne 0 ] || { tail -n 40 log.run; fail "'$*' ended with status 0, expected: $text"; }
    expect_log "$text"
}

# difference FILE FILE: largest difference of the internal fields, relative to the largest value of the first.
difference() {
    paste <(values "$1") <(values "$2") | awk '
        NF % 2 { print "different sizes"; exit 1 }
        { for (i = 1; i <= NF/2; ++i) { d = abs($i - $(i + NF/2)); a = abs($i); if (d > m) m = d; if (a > s) s = a } }
        function abs(x) { return x < 0 ? -x : x }
        END { print m/s }'
}
values() { awk '/^internalField/ { on = 1; next } /^\)/ { on = 0 } on && (/^\(.* / || /^[-0-9.e]+$/) && n++ { gsub(/[()]/, ""); print }' "$1"; }

# labels FILE: those of the internal field, each once.
labels() {
    if grep -q '^internalField *uniform' "$1"; then
        sed -n 's/^internalField *uniform \(.*\);/\1/p' "$1"
    else
        values "$1" | sort -u
    fi
}

# calc EXPRESSION: of awk; holds EXPRESSION [WHAT]: it is true; off A B: by how much A differs from B, over B
calc() { awk "BEGIN { print $1 }"; }
holds() { awk "BEGIN { exit !($1) }" || fail "${2:-expected} $1"; }
off() { calc "sqrt((($1)/($2) - 1)^2)"; }

# rows FILE: of a table; same_rows ROWS ROWS: to seven digits, whatever the number of ranks
rows() { awk '!/^#/' "$1"; }
same_rows() {
    paste <(echo "$1") <(echo "$2") | awk '
        NF < 4 || NF % 2 { exit 1 }
        { for (i = 1; i <= NF/2; ++i) { d = ($i - $(i + NF/2))/($i + 1e-12); if (d*d > 1e-8) exit 1 } }' ||
        { echo "$1"; echo "$2"; fail "the tables differ"; }
}

# same_on_two_ranks LIMIT FILES...: the same run on two ranks has fields as close as this.
same_on_two_ranks() {
    keep serial 0.*
    clean_case
    solve 2
    runs reconstructPar
    close_to ../serial "$@"
}

# carry_on TIME: the run goes on from what ../whole has of this time, and from its state.
carry_on() {
    clean_case
    cp -r "../whole/$1" ../whole/postProcessing .
    control startTime "$1"
    solve
    expect_log "m4gn: test goes on from its state at time $1"
}

# edit_model FILE PYTHON [ARGUMENTS...]: the small model with a description that this code has changed
edit_model() {
    python3 - "$small_model" "$@" <<'PYTHON'
import json, struct, sys
data = open(sys.argv[1], "rb").read()
n = struct.unpack("<Q", data[:8])[0]
header = json.loads(data[8:8 + n])
model = json.loads(header["__metadata__"]["m4gn"])
exec(sys.argv[3], {"model": model, "arguments": sys.argv[4:], "json": json})
header["__metadata__"]["m4gn"] = json.dumps(model)
text = json.dumps(header).encode()
text += b" " * (-len(text) % 8)
open(sys.argv[2], "wb").write(struct.pack("<Q", len(text)) + text + data[8 + n:])
PYTHON
}

# below VALUE LIMIT WHAT
below() {
    local number='^[-+]?[0-9]*\.?[0-9]+([eE][-+]?[0-9]+)?$'
    [[ $1 =~ $number && $2 =~ $number ]] || fail "$3: $1, expected at most $2: no numbers"
    awk "BEGIN { exit !($1 <= $2) }" || fail "$3: $1, expected at most $2"
    echo "$3: $1"
}

# make_oracle: a surrogate that is always right, in front of libm4gn.so (oracle.c).
make_oracle() {
    # Most of its functions have parameters that say nothing to a recording
    cc -std=c11 -O2 -Wall -Wextra -Wno-unused-parameter -Werror -shared -fPIC -I "$M4GN_HOME/cpp/include" \
        "$M4GN_HOME/tests/e2e/oracle.c" -o "$work/oracle.so" -lm -ldl
    export LD_PRELOAD=$work/oracle.so ORACLE_FILE=$work/oracle.bin
}
