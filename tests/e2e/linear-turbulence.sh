#!/usr/bin/env bash
# m4gnSurrogate with surrogates (linear) and turbulence models with wall functions: a square in a wind, some 1,000 cells. All fields of the
# model are handed over, none of its wall functions is evaluated between, and what is positive stays so.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
mkdir -p case/{0,constant,system} && cd case

# mesh: nine blocks around a square of 0.02 m, which is the one in the middle
mesh() {
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
mesh > system/blockMeshDict
control_dict pimpleFoam 1.2 0.001 adjustableRunTime 0.4 12
{ header fvSchemes; cat <<'EOD'; } > system/fvSchemes
ddtSchemes { default Euler; }
gradSchemes { default Gauss linear; }
divSchemes { default Gauss upwind; div(phi,U) Gauss linearUpwind grad(U); div((nuEff*dev2(T(grad(U))))) Gauss linear; }
laplacianSchemes { default Gauss linear corrected; }
interpolationSchemes { default linear; }
snGradSchemes { default corrected; }
wallDist { method meshWave; }
EOD
{ header fvSolution; cat <<'EOD'; } > system/fvSolution
solvers
{
    "p.*" { solver GAMG; smoother DICGaussSeidel; tolerance 1e-6; relTol 0.01; }
    "(U|k|omega|epsilon|nuTilda).*" { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-7; relTol 0; }
}
PIMPLE { nOuterCorrectors 1; nCorrectors 2; nNonOrthogonalCorrectors 0; }
EOD
{ header transportProperties; echo 'transportModel Newtonian; nu 1.5e-5;'; } > constant/transportProperties
# field NAME DIMENSIONS VALUE WALL [CLASS]
field() {
    header "$1" "${5:-volScalarField}"
    echo "dimensions [$2]; internalField uniform $3; boundaryField { inlet { type fixedValue; value uniform $3; }
        outlet { type inletOutlet; inletValue uniform $3; value uniform $3; } sides { type symmetry; } square { $4 } frontAndBack { type empty; } }"
}
field U '0 1 -1 0 0 0 0' '(2 0.02 0)' 'type noSlip;' volVectorField > 0/U
field k '0 2 -2 0 0 0 0' 0.0024 'type kqRWallFunction; value uniform 0.0024;' > 0/k
field omega '0 0 -1 0 0 0 0' 25 'type omegaWallFunction; value uniform 25;' > 0/omega
field epsilon '0 2 -3 0 0 0 0' 0.0054 'type epsilonWallFunction; value uniform 0.0054;' > 0/epsilon
field nuTilda '0 2 -1 0 0 0 0' 6e-5 'type fixedValue; value uniform 0;' > 0/nuTilda
{ header p volScalarField; echo 'dimensions [0 2 -2 0 0 0 0]; internalField uniform 0; boundaryField { outlet { type fixedValue; value uniform 0; }
    "(inlet|square)" { type zeroGradient; } sides { type symmetry; } frontAndBack { type empty; } }'; } > 0/p
: > system/functions
runs blockMesh

while read -r model names wall; do
    { header turbulenceProperties; echo "simulationType RAS; RAS { RASModel $model; turbulence on; printCoeffs off; }"; } \
        > constant/turbulenceProperties
    { header nut volScalarField; echo "dimensions [0 2 -1 0 0 0 0]; internalField uniform 9e-5; boundaryField { square { type $wall; value uniform 0; }
        \"(inlet|outlet)\" { type calculated; value uniform 9e-5; } sides { type symmetry; } frontAndBack { type empty; } }"; } > 0/nut
    plain pimpleFoam 0.8 1.2
    function_object m4gnSurrogate 'mode replace; surrogates (linear); timeStart 0.6; linear { interval 0.005; least 24; tolerance 0.05; enough 0.05; }'
    runs pimpleFoam
    replaces 0.15 "$model"
    grep -q "^m4gn: the linear surrogate advances.*$names" log.run || fail "$model: expected $names among what is handed over"
    ! grep -i 'bounding\|warning' log.run || fail "$model: a field has left its bounds"
    for name in U ${names//,/}; do
        hold=$(difference ../plain/1.2/$name ../plain/0.8/$name)
        below "$(difference ../plain/1.2/$name 1.2/$name)" "$(awk "BEGIN { print 0.25*$hold }")" "$model: largest error of $name"
    done
done <<'EOD'
kOmegaSST omega nutkWallFunction
kEpsilon epsilon nutkWallFunction
SpalartAllmaras nuTilda nutUSpaldingWallFunction
EOD
