#!/usr/bin/env bash
# Bad input of solids: what was expected, found, where, what to do; no half files.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_beam case
solid_model=$M4GN_HOME/tests/e2e/solid.safetensors
sed -i 's/^endTime .*/endTime 0.01;/' system/controlDict
sed -i 's/compactNormalStress.*;/compactNormalStress yes; nCorrectors 5; D 1e-3;/' system/fvSolution
cp -r . ../good

# again EXPRESSION FILE TEXT: the case with that change is refused with this text. In post-processing: with some of
# these solidDisplacementFoam divides by zero before any function object is asked.
again() {
    rm -rf ./* && cp -r ../good/. .
    sed -i "$1" "$2"
    cmp -s "$2" "../good/$2" && fail "'$1' did not change $2"
    echo 'type m4gnSegments; libs (m4gnFoam); segments { count 8; operator elastic; }' > system/m4gnSegments
    refused "$3" postProcess -func m4gnSegments -time 0
    [ ! -e 0/m4gnSegment ] || fail "segments were written after: $3"
}
properties=constant/mechanicalProperties
again 's/value 0.3;/value 0.5;/' $properties 'expected a value above -1 and below 0.5; for a material that keeps its volume set 0.4999'
again 's/value 1000;/value 0;/' $properties 'density of cell 0 is 0 kg/m^3: expected a positive'
again 's/value 1e6;/value -1e6;/' $properties "Young's modulus of cell 0 is -1000000 Pa"
# Two corners of a cell change places
rm -rf ./* && cp -r ../good/. .
awk '/^\($/ { on = 1; print; next } on { ++n } n == 30 { kept = $0; next } { print } n == 31 { print kept }' \
    ../good/constant/polyMesh/points > constant/polyMesh/points
echo 'type m4gnSegments; libs (m4gnFoam); segments { count 8; }' > system/m4gnSegments
refused 'is inverted, flat or folded' postProcess -func m4gnSegments -time 0
# No handle: the clamp is loaded as the rest
again 's/clamp .*/clamp { type tractionDisplacement; traction uniform (0 0 0); pressure uniform 0; value uniform (0 0 0); }/' \
    0/D 'Nothing holds the elastic body: expected a patch where D fixes its value'
grep -q 'clamp: free' log.run || fail "the patches and what they are taken for are not listed"
grep -q 'freeBody yes' log.run || fail "it is not said what to do"
# A file that another solver stored
again 's/\[0 1 0 0 0 0 0\]/[0 2 -1 0 0 0 0]/' 0/D 'expected a volVectorField \[0 1 0 0 0 0 0\], found volVectorField \[0 2 -1 0 0 0 0\]'
again 's/class volVectorField/class volScalarField/; s/(0 0 0)/0/' 0/D 'found volScalarField'
rm 0/D
refused 'found no such field' postProcess -func m4gnSegments -time 0

rm -rf ./* && cp -r ../good/. .
echo 'type m4gnSegments; libs (m4gnFoam); segments { count 8; operator elastic; }' > system/m4gnSegments
sed -i 's/tip .*/tip { type springLoaded; value uniform (0 0 0); }/' 0/D
refused 'Whether the condition springLoaded at patch tip fixes the displacement is not known' postProcess -func m4gnSegments -time 0

# Materials that are not known
rm -rf ./* && cp -r ../good/. .
echo "type m4gnSegments; libs (m4gnFoam); segments { count 8; operator elastic; }" > system/m4gnSegments
cp $properties ..
{ head -n 1 ../mechanicalProperties; echo 'planeStress no; mechanical (rubber { type MooneyRivlin; rho 1000; c10 1; });'; } > $properties
refused 'material rubber of mechanicalProperties has neither E and nu nor mu and K' postProcess -func m4gnSegments -time 0
{ head -n 1 ../mechanicalProperties; echo 'planeStress no; mechanical (steel { type linearElastic; rho rho [1 -3 0 0 0 0 0] 1000; E E [1 -1 -2 0 0 0 0] 1e6; nu 0.3; });'; } > $properties
runs postProcess -func m4gnSegments -time 0
grep -q ' Hz' log.run || fail "solids4foam's list of materials was not taken"
# A list for E, as materials with several relaxation times have it: modes are optional, and the recording goes on without them
{ head -n 1 ../mechanicalProperties
  echo 'planeStress no; mechanical (visco { type viscousHookeanElastic; rho 1000; EInfinity 1e5; E (4e5 5e5); relaxationTimes (1 2); nu 0.3; });'
} > $properties
refused 'material visco of mechanicalProperties has neither E and nu nor mu and K with rho, each a number' \
    postProcess -func m4gnSegments -time 0
cp ../good/0/D 0
echo 'type m4gnRecorder; libs (m4gnFoam); fields (D);' > system/m4gnRecorder
runs postProcess -func m4gnRecorder -time 0
grep -q 'no modes of the elastic body, whose material is not known: material visco of mechanicalProperties has' log.run ||
    { cat log.run; fail "it is not said that there are no modes"; }
recorded=$(find postProcessing -name trajectory.h5)
[ -n "$recorded" ] || fail "nothing was recorded of a body without modes"
m4gn info "$recorded" > ../info || fail "the recording of a body without modes cannot be read"
rm -r postProcessing system/m4gnRecorder
rm $properties
refused 'found no such file' postProcess -func m4gnSegments -time 0
echo "type m4gnSegments; libs (m4gnFoam); segments { count 8; operator elastic; material { E 1e6; nu 0.3; } }" > system/m4gnSegments
refused 'expected E, nu and rho' postProcess -func m4gnSegments -time 0

rm -rf ./* && cp -r ../good/. .
function_object m4gnSegments 'segments { count 8; operator plastic; }'
refused 'segments.operator: expected laplacian or elastic, found plastic' solidDisplacementFoam

# A model of a solid in a solver without one, and with another displacement
sed 's/\[0,1,0,0,0,0,0\]/[0,2,0,0,0,0,0]/; s/\[0,1,0,0,0,0,0\]/[0,2,0,0,0,0,0]/' "$solid_model" > units.safetensors
cmp -s units.safetensors "$solid_model" && fail "the test did not change the units"
function_object m4gnSurrogate 'mode observe; model units.safetensors;'
refused 'is for D with the dimensions' solidDisplacementFoam
function_object m4gnSurrogate "mode observe; model \"$solid_model\"; segments { operator laplacian; modes 4; } nodeTypes { sides wall; }"
refused 'wall' solidDisplacementFoam
function_object m4gnSurrogate "mode replace; model \"$solid_model\"; state updated; solverSteps 2; surrogateSteps 2;"
refused 'Entry state is updated; expected' solidDisplacementFoam

# A solver whose times are iterations
cat > system/fvSolution <<'EOD'
FoamFile { version 2.0; format ascii; class dictionary; object fvSolution; }
solvers { ".*" { solver GAMG; tolerance 1e-12; relTol 0.01; smoother GaussSeidel; nCellsInCoarsestLevel 20; } }
stressAnalysis { compactNormalStress yes; accelerationFactor 1.4; relTol 0.01; }
EOD
sed -i 's/default none;/default Gauss linear;/; s/ddtSchemes.*/ddtSchemes { default steadyState; }/; s/Gauss linear; laplacian/Gauss linear corrected; laplacian/' system/fvSchemes
sed -i 's/^snGradSchemes.*/snGradSchemes { default corrected; }/' system/fvSchemes
function_object m4gnSurrogate "mode replace; model \"$solid_model\"; solverSteps 2; surrogateSteps 2;"
refused 'the times of solidEquilibriumDisplacementFoam are iterations to one equilibrium' solidEquilibriumDisplacementFoam
cd .. && make_case flow
function_object m4gnSurrogate "mode observe; model \"$solid_model\";"
refused 'need its displacement D: expected a volVectorField \[0 1 0 0 0 0 0\], found no such field' icoFoam
echo "bad-solid: passed"
