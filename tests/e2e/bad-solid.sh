#!/usr/bin/env bash
# Bad input of solids: what was expected, found, where, what to do; no half files.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_beam case endTime 0.01
stress yes 5 1e-3
solid_model=$M4GN_HOME/tests/e2e/solid.safetensors
elastic='segments { count 8; operator elastic; }'
# segments ENTRIES: a good case, and what m4gnSegments has to do in post-processing: with some of the bad cases solidDisplacementFoam divides
# by zero before any function object is asked.
segments() {
    rm -rf ./* && cp -r ../good/. .
    echo "type m4gnSegments; libs (m4gnFoam); $1" > system/m4gnSegments
}
# refuses TEXT: nothing is written either
refuses() {
    refused "$1" postProcess -func m4gnSegments -time 0
    [ ! -e 0/m4gnSegment ] || fail "segments were written after: $1"
}
# again EXPRESSION FILE TEXT: the case with that change is refused with this text.
again() {
    segments "$elastic"
    sed -i "$1" "$2"
    ! cmp -s "$2" "../good/$2" || fail "'$1' did not change $2"
    refuses "$3"
}
cp -r . ../good
properties=constant/mechanicalProperties
again 's/value 0.3;/value 0.5;/' $properties 'expected a value above -1 and below 0.5; for a material that keeps its volume set 0.4999'
again 's/value 1000;/value 0;/' $properties 'density of cell 0 is 0 kg/m^3: expected a positive'
again 's/value 1e6;/value -1e6;/' $properties "Young's modulus of cell 0 is -1000000 Pa"
# Two corners of a cell change places
segments 'segments { count 8; }'
awk '/^\($/ { on = 1; print; next } on { ++n } n == 30 { first = $0; next } { print } n == 31 { print first }' \
    ../good/constant/polyMesh/points > constant/polyMesh/points
refuses 'is inverted, flat or folded'
# No handle: the clamp is loaded as the rest
again 's/clamp .*/clamp { type tractionDisplacement; traction uniform (0 0 0); pressure uniform 0; value uniform (0 0 0); }/' \
    0/D 'Nothing holds the elastic body: expected a patch where D fixes its value'
# The patches, what they are taken for, and what to do
expect_log 'clamp: free' 'freeBody yes'
# A file that another solver stored
again 's/\[0 1 0 0 0 0 0\]/[0 2 -1 0 0 0 0]/' 0/D 'expected a volVectorField \[0 1 0 0 0 0 0\], found volVectorField \[0 2 -1 0 0 0 0\]'
again 's/class volVectorField/class volScalarField/; s/(0 0 0)/0/' 0/D 'found volScalarField'
rm 0/D
refuses 'found no such field'
again 's/tip .*/tip { type springLoaded; value uniform (0 0 0); }/' 0/D 'Whether the condition springLoaded at patch tip fixes the displacement is not known'

# Those of solids4foam are told by their names, as a run has them: held at the clamp, free at the tip
segments "$elastic"
runs postProcess -func m4gnSegments -time 0
lowest=$(sed -n 's/^m4gn: eigenvalue 1 = //p' log.run)
sed -i 's/clamp .*/clamp { type normalDisplacementZeroShear; value uniform (0 0 0); }/
    s/tip .*/tip { type solidForce; force uniform (0 0 0); value uniform (0 0 0); }/' 0/D
runs postProcess -func m4gnSegments -time 0
expect_log "eigenvalue 1 = $lowest"

# Materials that are not known
materials() { { header mechanicalProperties; echo "planeStress no; mechanical ($1);"; } > $properties; }
segments "$elastic"
materials 'rubber { type MooneyRivlin; rho 1000; c10 1; }'
refuses 'material rubber of mechanicalProperties has neither E and nu nor mu and K'
# A list for E, as materials with several relaxation times have it: modes are optional, and the recording goes on without them
materials 'visco { type viscousHookeanElastic; rho 1000; EInfinity 1e5; E (4e5 5e5); relaxationTimes (1 2); nu 0.3; }'
refuses 'material visco of mechanicalProperties has neither E and nu nor mu and K with rho, each a number'
echo 'type m4gnRecorder; libs (m4gnFoam); fields (D);' > system/m4gnRecorder
runs postProcess -func m4gnRecorder -time 0
expect_log 'no modes of the elastic body, whose material is not known: material visco of mechanicalProperties has'
recorded=$(find postProcessing -name trajectory.h5)
[ -n "$recorded" ] || fail "nothing was recorded of a body without modes"
m4gn info "$recorded" > ../info || fail "the recording of a body without modes cannot be read"
# solids4foam's list of materials
materials 'steel { type linearElastic; rho rho [1 -3 0 0 0 0 0] 1000; E E [1 -1 -2 0 0 0 0] 1e6; nu 0.3; }'
runs postProcess -func m4gnSegments -time 0
expect_log ' Hz'
rm -f $properties 0/m4gn*
refuses 'found no such file'
segments 'segments { count 8; operator elastic; material { E 1e6; nu 0.3; } }'
refuses 'expected E, nu and rho'

segments "$elastic"
expect_errors m4gnSegments <<< 'segments { count 8; operator plastic; } => segments.operator: expected laplacian or elastic, found plastic'
# A model of a solid in a solver without one, and with another displacement
sed 's/\[0,1,0,0,0,0,0\]/[0,2,0,0,0,0,0]/; s/\[0,1,0,0,0,0,0\]/[0,2,0,0,0,0,0]/' "$solid_model" > units.safetensors
cmp -s units.safetensors "$solid_model" && fail "the test did not change the units"
expect_errors <<EOD
mode observe; model units.safetensors; => is for D with the dimensions
mode observe; model "$solid_model"; segments { operator laplacian; modes 4; } nodeTypes { sides wall; } => wall
mode replace; model "$solid_model"; state updated; solverSteps 2; surrogateSteps 2; => Entry state is updated; expected
EOD

# What a network cannot hand back to
surrogate "mode replace; model \"$solid_model\"; solverSteps 2; surrogateSteps 2;"
refused 'does not know how solidDisplacementFoam carries on from a state of a network' solidDisplacementFoam
expect_log 'totalDisplacement: .* (solids4foam)' 'Use one of these, or surrogates (dmd)'
cd .. && make_case flow
expect_error 'need its displacement D: expected a volVectorField \[0 1 0 0 0 0 0\], found no such field' "mode observe; model \"$solid_model\";"
