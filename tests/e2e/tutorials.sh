#!/usr/bin/env bash
# OpenFOAM's own tutorials, shortened: m4gnRecorder and m4gnSurrogate in mode observe change no byte of what the solver writes; what they
# cannot do is refused at the start, with its name.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
tutorials=$("$M4GN_HOME/setup/openfoam-source.sh" tutorials) || skip "OpenFOAM's tutorials could not be downloaded"

# tutorial PATH DELTAT: a copy of it, with a mesh, fields, and twenty steps to go
tutorial() {
    cd "$work"
    rm -rf case
    cp -r "$tutorials/$1" case
    cd case
    # The package has some files packed
    find . -name '*.gz' ! -path './constant/polyMesh/*' -exec gunzip -f {} +
    [ ! -d 0.orig ] || mv -T 0.orig 0
    for file in 0/*.orig; do [ ! -e "$file" ] || cp "$file" "${file%.orig}"; done
    for file in system/controlDict constant/turbulenceProperties; do
        [ ! -e $file.template ] || sed 's/END_TIME/1/; s/LAMINAR_MODEL/Stokes/' $file.template > $file
    done
    # Its own function objects would only take time
    sed -i '/^functions/,/^}/d' system/controlDict
    cat >> system/controlDict <<EOF
startFrom startTime;
deltaT $2;
endTime $(awk "BEGIN { print 20*$2 }");
adjustTimeStep no;
writeControl timeStep;
writeInterval 10;
writeFormat binary;
functions { #include "functions" }
EOF
    : > system/functions
    if [ -e elbow.msh ]; then runs fluentMeshToFoam elbow.msh; else runs blockMesh; fi
    [ ! -e system/setFieldsDict ] || runs setFields
}

# network STRIDE PRESSURE: the random network with this stride, so that a short run has some, for a pressure of this dimension
network() {
    edit_model "$work/network.safetensors" 'model["stride"] = float(arguments[0])
if arguments[1] == "Pa": model["fields"][1]["dimensions"] = [1, -1, -2, 0, 0, 0, 0]' "$@"
}

record='record { type m4gnRecorder; libs (m4gnFoam); fields (U p); writeControl timeStep; writeInterval 5; }'
# observe ENTRIES: five of the solver's steps are a stride
observe() { echo "watch { type m4gnSurrogate; libs (m4gnFoam); mode observe; model \"$work/network.safetensors\"; rolloutSteps 2; $* }"; }

# Everything the solver writes, but for uniform/, which has the function objects' own entries
written() { find . -type f \( -path './processor*/[0-9]*' -o -path './[0-9]*' \) | grep -v -e /uniform/ -e m4gnSegment -e /0/ | sort; }
# neutral SOLVER...: with what system/functions has now and without, the same bytes
neutral() {
    local functions file with
    functions=$(cat system/functions)
    runs "$@"
    [ -s system/functions ] && grep -q 'End' log.run || fail "$*: no end"
    rm -rf ../with && mkdir ../with
    with=$(written)
    while read -r file; do cp --parents "$file" ../with; done <<< "$with"
    find . -maxdepth 2 \( -path './processor*/[0-9]*' -o -path './[0-9]*' \) -prune ! -name 0 -exec rm -rf {} +
    : > system/functions
    runs "$@"
    [ "$(written)" = "$with" ] || { diff <(written) <(echo "$with"); fail "other files are written with the function objects"; }
    [ "$(find . -path '*[0-9]/U' | wc -l)" -ge 2 ] || fail "the solver has written no U"
    while read -r file; do
        cmp "$file" "../with/$file" || fail "$name: $file is not what the solver alone writes"
    done <<< "$with"
    echo "$name: the same bytes with ${functions%% *}$(grep -q watch <<< "$functions" && echo ' and watch')"
}

while read -r name path solver deltaT pressure entries; do
    tutorial "$path" "$deltaT"
    network "$(awk "BEGIN { print 5*$deltaT }")" "$pressure"
    { echo "$record"; observe "outOfRange ignore; $entries"; } > system/functions
    neutral "$solver"
    [ -f postProcessing/record/0/trajectory.h5 ] || fail "$name: nothing was recorded"
    awk '!/^#/ { ++n } END { exit n < 3 }' postProcessing/watch/0/surrogateError.dat || fail "$name: nothing was observed"
done <<'EOF'
LES incompressible/pisoFoam/LES/pitzDaily pisoFoam 1e-5 m2/s2
RAS incompressible/pimpleFoam/RAS/pitzDaily pimpleFoam 1e-4 m2/s2
compressible compressible/rhoPimpleFoam/RAS/cavity rhoPimpleFoam 1e-3 Pa
interface multiphase/interFoam/laminar/damBreak/damBreak interFoam 1e-3 Pa
cyclic incompressible/pimpleFoam/laminar/planarPoiseuille pimpleFoam 5e-3 m2/s2 nodeTypes { centreline wall; }
EOF

name=buoyant
tutorial heatTransfer/buoyantPimpleFoam/hotRoom 2
network 10 Pa
echo "$record" > system/functions
neutral buoyantPimpleFoam
# The network is one of two dimensions
observe > system/functions
refused 'was trained in 2 dimensions; this case solves 3' buoyantPimpleFoam

name=parallel
tutorial multiphase/interFoam/laminar/damBreak/damBreak 1e-3
network 5e-3 Pa
sed -i 's/^numberOfSubdomains.*/numberOfSubdomains 2;/; s/(2 2 1)/(2 1 1)/' system/decomposeParDict
runs decomposePar
{ echo "$record"; observe 'outOfRange ignore;'; } > system/functions
neutral mpirun -np 2 interFoam -parallel

# The shipped model of a cylinder in tutorials that are no cylinders in a channel: none is replaced in silence
while read -r name path solver deltaT what; do
    tutorial "$path" "$deltaT"
    # refuse: at the end of the first time step
    echo "watch { type m4gnSurrogate; libs (m4gnFoam); mode replace; model \"$M4GN_HOME/models/cylinder-flow.safetensors\";
timeStart 0; solverSteps 10; surrogateSteps 5; outOfRange refuse; }" > system/functions
    refused "$what" "$solver"
    echo "$name: $(grep -o "$what" log.run | head -1)"
done <<'EOF'
cavity incompressible/icoFoam/cavity/cavity icoFoam 0.005 400 cells of this case are [0-9]* nodes at the network's resolution, and it has 144 segments
elbow incompressible/icoFoam/elbow icoFoam 0.05 mean distance of neighbouring cells is 1.173e0 m, and the model was trained on
non-newtonian incompressible/nonNewtonianIcoFoam/offsetCylinder nonNewtonianIcoFoam 2.5e-3 mean distance of neighbouring cells is 1.433e-1 m, and the model was trained on
RAS incompressible/pisoFoam/RAS/cavity pisoFoam 0.005 400 cells of this case are [0-9]* nodes at the network's resolution, and it has 144 segments
EOF

name=moving
tutorial incompressible/pimpleFoam/RAS/oscillatingInletPeriodicAMI2D 1e-3
for object in "$record" "$(observe)"; do
    echo "$object" > system/functions
    refused 'dynamicMotionSolverFvMesh, which moves' pimpleFoam
    [ ! -d 0.01 ] || fail "the moving mesh was refused after the run began"
done
echo "moving: refused"
