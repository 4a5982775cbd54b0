#!/usr/bin/env bash
# Campaigns from nothing to a report, in columns: "until", every third run, cold, until its figures are known; "nearest", from the nearest sister's last state;
# "auto", the usual one, with every sixth run made again cold and plain and to the end; "dmd", as auto with the dmd surrogate.
#   bench/campaign.sh FOLDER speeds|cavity|square|channel|finer [RUNS [COLUMN...]]    (docs/lab/2026-11-campaign.md)
# The same command goes on where one was ended.
. "$(dirname "${BASH_SOURCE[0]}")/../tests/e2e/common.sh"
trap 'rm -rf "$work"' EXIT
cd "$OLDPWD"
mkdir -p "$1" && cd "$1"
study=$2 count=${3:-} size=0.05 step=0.002
columns=("${@:4}")
[ ${#columns[@]} -gt 0 ] || columns=(until nearest auto)

# parameters NAME VALUE...: those of the case by itself
parameters() { { header simulationParameters; printf '%s %s;\n' "$@"; } > system/simulationParameters; }

# with FILE FIELD...: fields include this file of system
with() { for name in "${@:2}"; do sed -i "s/^dimensions\| dimensions/\n#include \"<system>\/$1\"\ndimensions/" "0/$name"; done; }

# forces PATCH PLACE SPEED LENGTH AREA: their coefficients
forces() { cat > system/functions <<EOD; }
forces
{
    #include "<system>/simulationParameters"
    type forceCoeffs; libs (forces); patches ($1);
    rho rhoInf; rhoInf 1; CofR ($2); liftDir (0 1 0); dragDir (1 0 0); pitchAxis (0 0 1);
    magUInf $3; lRef $4; Aref $5; log no;
}
EOD

# cylinder SPEED: the family's channel, some 1,200 cells, a cylinder at the height @y@ with forces
cylinder() {
    cp -r "$M4GN_HOME/openfoam/templates/cylinder-flow" case && cd case
    rm -r family.toml source
    sed -i "s/@x@/0.31/; s/@radius@/0.052/; s/@size@/$size/; s/@shape@/0/; s/@elements@/0/" mesh.geo
    sed -i 's/@tolerance@/1e-6/; s/@correctors@/1/; s/@convection@/0/' system/fv{Solution,Schemes}
    control_dict icoFoam 8 "$step" runTime 8 10
    control writeFormat binary
    forces cylinder '0.31 0.2 0' "$1" 0.104 0.00104
}

# Inlet speeds of a cylinder in a channel
case_of_speeds() {
    # shellcheck disable=SC2016  # names of OpenFOAM
    cylinder '$u0'
    sed -i 's/@nu@/1e-3/' constant/transportProperties
    # shellcheck disable=SC2016  # names of OpenFOAM
    sed -i 's/@linear@/$linear/; s/@quadratic@/$quadratic/' 0/U
    with simulationParameters U
    parameters u0 1 linear 1 quadratic 1
    sed -i 's/@y@/0.212/' mesh.geo
    mesh_of_the_cylinder
    rm mesh.msh mesh.geo
}
# The same in one inlet, over the Reynolds number of mean speed and diameter and over the cylinder's height: each run makes its own mesh
case_of_channel() {
    cylinder 1.5
    sed -i 's/@linear@/14.634146/; s/@quadratic@/-35.693040/' 0/U
    mv mesh.geo mesh.geo.in
    cat > Allrun.pre <<'EOD'
#!/bin/sh -e
of() { foamDictionary -entry "$1" -value system/simulationParameters; }
sed "s/@y@/$(of height)/" mesh.geo.in > mesh.geo
sed -i "s/@nu@/$(of Re | awk '{ printf "%.8g", 0.104/$1 }')/" constant/transportProperties
gmsh -nt 1 -3 -format msh2 -o mesh.msh mesh.geo
gmshToFoam mesh.msh
changeDictionary -constant
rm mesh.msh
EOD
    chmod +x Allrun.pre
    parameters Re 100 height 0.2
}
# The same with some four times the cells
case_of_finer() { case_of_channel; }
# URANS of a square in a wind of some speed and turbulence
case_of_square() {
    make_square case
    turbulence kOmegaSST nutkWallFunction
    control endTime 1.5
    rm -r constant/polyMesh log.run
    # shellcheck disable=SC2016
    forces square '0 0 0' '$speed' 0.02 0.0002
    with simulationParameters U
    with inlet k omega
    # shellcheck disable=SC2016  # names of OpenFOAM
    sed -i 's/(2 0.02 0)/($speed 0.02 0)/g' 0/U
    for name in k omega; do sed -i "s/uniform [0-9.]*/uniform \$${name}0/g" 0/$name; done
    # Ten times the fluid's viscosity
    cat > Allrun.pre <<'EOD'
#!/bin/sh -e
of() { foamDictionary -entry "$1" -value system/simulationParameters; }
echo "$(of speed) $(of intensity)" | awk '{ k = 1.5*($1*$2)^2; print "k0", k ";", "omega0", k/1.5e-4 ";" }' > system/inlet
blockMesh
EOD
    chmod +x Allrun.pre
    parameters speed 2 intensity 0.05
}
# A cavity of air of 0.1 m between a hot and a cold wall
case_of_cavity() {
    mkdir -p case/{0,constant,system} && cd case
    control_dict buoyantBoussinesqPimpleFoam 800 0.5 runTime 800 8
    cat > system/functions <<'EOD'
speed { type mag; libs (fieldFunctionObjects); field U; writeControl none; log no; }
motion { type volFieldValue; libs (fieldFunctionObjects); regionType all; operation volAverage; fields (mag(U)); writeFields no; log no; }
EOD
    schemes ''
    solvers 1e-8 0.01
    sed -i 's/(U|h|T|DT)/(U|T)/' system/fvSolution
    { header g uniformDimensionedVectorField; echo 'dimensions [0 1 -2 0 0 0 0]; value (0 -9.81 0);'; } > constant/g
    { header transportProperties; echo 'transportModel Newtonian; nu 1.5e-05; beta 3e-03; TRef 300; Pr 0.71; Prt 0.7;'; } > constant/transportProperties
    { header turbulenceProperties; echo 'simulationType laminar;'; } > constant/turbulenceProperties
    local empty='frontAndBack { type empty; }' all='"(hot|cold|insulated)"'
    # shellcheck disable=SC2016  # names of OpenFOAM
    field T volScalarField '0 0 0 1 0 0 0' 300 'hot { type fixedValue; value uniform $hot; } cold { type fixedValue; value uniform 300; }
        insulated { type zeroGradient; } '"$empty"
    with simulationParameters T
    field U volVectorField '0 1 -1 0 0 0 0' '(0 0 0)' "$all { type noSlip; } $empty"
    field p volScalarField '0 2 -2 0 0 0 0' 0 "$all { type calculated; value uniform 0; } $empty"
    field p_rgh volScalarField '0 2 -2 0 0 0 0' 0 "$all { type fixedFluxPressure; rho rhok; value uniform 0; } $empty"
    field alphat volScalarField '0 2 -1 0 0 0 0' 0 "$all { type calculated; value uniform 0; } $empty"
    block '0.1 0.1 0.01' '30 30 1' 'hot { type wall; faces (LEFT); } cold { type wall; faces (RIGHT); } insulated { type wall; faces (BOTTOM TOP); }
        frontAndBack { type empty; faces (BACK FRONT); }'
    rm -r constant/polyMesh log.run
    parameters hot 301
}

# list FACTOR: of the speeds
list() { awk -v n="${count:-8}" -v f="$1" 'BEGIN { for (i = 0; i < n; ++i) printf "%s%.8g", (i ? "," : ""), f*(1.4 + 0.7*i/(n - 1)) }'; }
case $study in
speeds) range=("u0=$(list 1)" "linear=$(list 9.7560976)" "quadratic=$(list -23.795360)") min_time=1 count='' scale=u0 ;;
channel | finer) range=(Re=60:200 height=0.16:0.25) min_time=1 scale='' ;;
square) range=(speed=1.2:2.4 intensity=0.01:0.1) min_time=0.2 scale=speed ;;
cavity) range=(hot=300.1:302) min_time=50 scale='' ;;
*) fail "$study: expected speeds, cavity, square, channel or finer" ;;
esac
[ "$study" != finer ] || size=0.025 step=0.001
[ -d case ] || { (case_of_"$study"); }

# made COLUMN: the campaign's folder
made() {
    local parameters=()
    for one in "${range[@]}"; do parameters+=(--parameter "$one"); done
    if [ "$study" = speeds ]; then parameters+=(--sampling list); else parameters+=(--count "${count:-24}"); fi
    runs m4gn campaign init case --out "$1" "${parameters[@]}"
    sed -i "s/^held_out = .*/held_out = 0/; s/^min_time = .*/min_time = $min_time/" "$1/campaign.toml"
    [ -z "$scale" ] || sed -i "s/^# scale = .*/scale = \"$scale\"/" "$1/campaign.toml"
    # The drag of speeds is told, and not waited for
    [ "$study" != speeds ] || sed -i '/^relative = 0.01/d' "$1/campaign.toml"
    [ "$study" != cavity ] || printf '[[quantity]]\nname = "motion"\nfunction_object = "motion"\nresult = "volAverage(mag(U))"\nrelative = 0.01\n' >> "$1/campaign.toml"
    case $1 in
    until) sed -i 's/^start = .*/start = "cold"/' "$1/campaign.toml" ;;
    nearest) sed -i 's/^start = .*/start = "nearest"/' "$1/campaign.toml" ;;
    auto) sed -i "s/^held_out = .*/held_out = 0.1667/" "$1/campaign.toml" ;;
    dmd) sed -i 's/^# surrogate = /surrogate = /; s/^# surrogate_entries = /surrogate_entries = /' "$1/campaign.toml" ;;
    esac
}
for column in "${columns[@]}"; do
    [ -f "$column/campaign.toml" ] || made "$column"
    # Cold runs until known, of which every third stands for all
    if [ "$column" = until ]; then m4gn campaign run --store "$column" --shard 1/3; else m4gn campaign run --store "$column"; fi
    m4gn campaign report --store "$column"
done
python3 "$M4GN_HOME/bench/campaign.py"
