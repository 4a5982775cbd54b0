#!/usr/bin/env bash
# Coupled patches: a cyclic one, whole and cut by processors, in both function objects; couplings that are refused.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# A channel that is periodic in x, with a jet along its middle
mkdir -p case/{0,constant,system} && cd case
control_dict icoFoam 0.06 0.002 adjustableRunTime 0.01 12
cp "$M4GN_HOME"/openfoam/templates/cylinder-flow/system/{fvSchemes,fvSolution} system
sed -i 's/@tolerance@/1e-10/; s/@correctors@/1/; s/@convection@/0/; s/relTol  *0.05/relTol 0/; s/nCorrectors  *2;/nCorrectors 2; pRefCell 0; pRefValue 0;/' system/fv{Solution,Schemes}
pressure_by_pcg
mesh() { # TYPE ENTRIES ENTRIES: of the ends, the left and the right one
    block '1 0.4 0.1' '20 8 1' "left { type $1; neighbourPatch right; $2 faces (LEFT); }
        right { type $1; neighbourPatch left; $3 faces (RIGHT); }
        walls { type wall; faces (BOTTOM TOP); } sides { type empty; faces (BACK FRONT); }"
}
fields() { # TYPE of the ends
    {
        header U volVectorField
        echo 'dimensions [0 1 -1 0 0 0 0]; internalField nonuniform List<vector> 160 ('
        for ((i = 0; i < 160; ++i)); do
            awk "BEGIN { x = 6.2831853*($i % 20 + 0.5)/20; y = (int($i/20) + 0.5)/8
                printf \"(%.6f %.6f 0)\n\", 4*y*(1 - y), 0.2*sin(x)*y*(1 - y) }"
        done
        echo "); boundaryField { \"left|right\" { type $1; } walls { type noSlip; } sides { type empty; } }"
    } > 0/U
    {
        header p volScalarField
        echo 'dimensions [0 2 -2 0 0 0 0]; internalField uniform 0;'
        echo "boundaryField { \"left|right\" { type $1; } walls { type zeroGradient; } sides { type empty; } }"
    } > 0/p
}
{ header transportProperties; echo 'nu 1e-3;'; } > constant/transportProperties
mesh cyclic '' ''
fields cyclic

control endTime 0.02
record
file=postProcessing/test/0/trajectory.h5
content $file
content $file | grep -q '40 boundary faces, 16 cyclic faces' || fail "the cyclic faces were not recorded as such"
content $file > ../serial.info

# A cut across the flow leaves the ends on two ranks (processorCyclic), one along it on the same (cyclic)
for cut in '2 1 1' '1 2 1'; do
    clean_case
    decomposition 2 simple "coeffs { n ($cut); }"
    solve 2
    content $file | diff ../serial.info - || fail "cut $cut: two ranks recorded something else than one"
done

# To just behind the jump, from 0.02 to 0.04
control endTime 0.042
ride "mode replace; $small solverSteps 10; surrogateSteps 2;"
keep serial 0.04
for cut in '2 1 1' '1 2 1'; do
    clean_case
    decomposition 2 simple "coeffs { n ($cut); }"
    solve 2
    runs reconstructPar
    close_to ../serial 1e-4 0.04/{U,p}
done

clean_case
: > system/functions
mesh cyclicAMI 'transform translational; separationVector (1 0 0);' 'transform translational; separationVector (-1 0 0);'
fields cyclicAMI
recorder
refused 'is of type cyclicAMI, which m4gn does not handle' icoFoam
mesh symmetryPlane '' ''
fields symmetryPlane
record
content $file | grep -q 'left  *8 faces, symmetry' || fail "symmetry planes were not recorded as such"
