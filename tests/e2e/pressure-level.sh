#!/usr/bin/env bash
# The level of the pressure: the flow is the same for each level of the outlet's pressure, and for one that varies in time; without an
# outlet the reference cell keeps its value in a jump, and what that is changes nothing.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 0.9 writeInterval 0.05 writePrecision 16
jumps="mode replace; timeStart 0.5; solverSteps 25; outOfRange ignore;"
cp -r 0 ../start

# with_level NAME LEVEL OUTLET: the run from a pressure of this level
with_level() {
    sed "s/^internalField .*/internalField uniform $2;/; s/type *fixedValue;/$3/" ../start/p > 0/p
    ride "$jumps model cylinder-flow.safetensors; surrogateSteps 5;"
    keep "$1" 0.6 0.9
}
with_level none 0 'type fixedValue;'
sed -i 's/value  *uniform 0;/value uniform 3;/' ../start/p
with_level three 3 'type fixedValue;'
with_level varying 0 'type uniformFixedValue; uniformValue table ((0 0) (1 3));'
for level in three varying; do
    below "$(difference ../none/0.6/U "../$level/0.6/U")" 1e-5 "U in a jump, outlet $level"
    below "$(difference ../none/0.9/U "../$level/0.9/U")" 1e-4 "U at the end, outlet $level"
done
at() { values "$1" | awk 'NR == 1'; }
near() { holds "($1 - $2)^2 < $4" "$3:"; }
near "$(at ../three/0.6/p)" "$(at ../none/0.6/p | awk '{ print $1 + 3 }')" "p in a jump, outlet at 3" 1e-8
near "$(at ../varying/0.6/p)" "$(at ../none/0.6/p | awk '{ print $1 + 1.8 }')" "p in a jump, outlet at 1.8 by then" 1e-8

# A closed channel, whose walls drive the flow
sed 's/^ *"(inlet|walls|cylinder)"/"(inlet|walls|cylinder|outlet)"/; /^ *outlet$/,/}/d' ../start/p > 0/p
cat > patches <<'EOD'
    walls { type fixedValue; value uniform (1 0 0); }
    "(inlet|outlet|cylinder)" { type fixedValue; value uniform (0 0 0); }
    frontAndBack { type empty; }
EOD
{ header U volVectorField; echo 'dimensions [0 1 -1 0 0 0 0]; internalField uniform (0 0 0); boundaryField {'; cat patches; echo '}'; } > 0/U
control endTime 0.6 writeInterval 0.01
cp -r 0 ../closed
for reference in 0 5; do
    sed "s/^internalField .*/internalField uniform $reference;/" ../closed/p > 0/p
    sed -i '/pRef/d' system/fvSolution
    sed -i "s/^ *nCorrectors .*/nCorrectors 2; \n pRefCell 7; pRefValue $reference;/" system/fvSolution
    ride "$jumps $small surrogateSteps 2;"
    for time in 0.51 0.52; do
        near "$(values $time/p | awk 'NR == 8')" "$reference" "p at the reference cell, $time s" 1e-16
    done
    keep "reference$reference" 0.52 0.6
done
below "$(difference ../reference0/0.52/U ../reference5/0.52/U)" 1e-5 "U in a jump, reference 5"
