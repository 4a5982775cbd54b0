# shellcheck shell=bash
# A beam in solids4foam, by any of its solid models. Sourced.
# solids4foam is no part of this project: setup/solids4foam.sh puts it into the cache, and
#   SOLIDS4FOAM_INST_DIR   names another folder that holds solids4Foam and libsolids4FoamModels.so, in it or in its bin/ and lib/
# Laws of solids4foam need lib/libm4gnSolids4Foam.so, which the same script makes.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam
[ -f "$M4GN_HOME/lib/libm4gnSolids4Foam.so" ] || skip "there is no lib/libm4gnSolids4Foam.so (setup/solids4foam.sh makes it)"

# A beam of 0.2 x 0.04 x 0.02 m, clamped at its left, loaded at its tip at time 0. One period is some 0.2 s.
mkdir -p case/0 case/constant case/system/dualMesh && cd case
control_dict solids4Foam 0.052 0.001 timeStep 1 14
schemes() { header fvSchemes; cat <<EOD; }
d2dt2Schemes { default $1; }
ddtSchemes { default $1; }
gradSchemes { default leastSquares; }
divSchemes { default Gauss linear; }
laplacianSchemes { default Gauss linear corrected; }
interpolationSchemes { default linear; }
snGradSchemes { default corrected; }
EOD
{ header fvSolution; cat <<'EOD'; } > system/fvSolution
solvers { "(D|DD)" { solver PCG; preconditioner FDIC; tolerance 1e-13; relTol 0.05; } }
relaxationFactors { }
EOD
schemes steadyState > system/dualMesh/fvSchemes
cp system/fvSolution system/dualMesh
{ header physicsProperties; echo 'type solid;'; } > constant/physicsProperties
{ header dynamicMeshDict; echo 'dynamicFvMesh staticFvMesh;'; } > constant/dynamicMeshDict
{ header g uniformDimensionedVectorField; echo 'dimensions [0 1 -2 0 0 0 0]; value (0 0 0);'; } > constant/g
displacement() { header "$1" "$2"; cat <<EOD; }
dimensions [0 1 0 0 0 0 0];
internalField uniform (0 0 0);
boundaryField
{
    clamp { type $3; value uniform (0 0 0); }
    tip { type $4; traction uniform (0 $5 0); pressure uniform 0; value uniform (0 0 0); }
    sides { type $4; traction uniform (0 0 0); pressure uniform 0; value uniform (0 0 0); }
}
EOD

# model NAME LAW TRACTION SCHEME: the case of a solid model
model() {
    { header solidProperties; cat <<EOD; } > constant/solidProperties
solidModel $1;
$1Coeffs
{
    nCorrectors 5000; infoFrequency 1000; $tolerances
    solutionAlgorithm implicitCoupled; fullNewton no; geometricStiffness yes; zeta 0.2; lineSearch no; usePETSc no;
}
EOD
    { header mechanicalProperties; cat <<EOD; } > constant/mechanicalProperties
planeStress no;
mechanical
(
    rubber
    {
        type $2; rho rho [1 -3 0 0 0 0 0] 1000; E E [1 -1 -2 0 0 0 0] 1e6; nu nu [0 0 0 0 0 0 0] 0.3; tangentEps 1e-8;
    }
);
EOD
    schemes "$4" > system/fvSchemes
    rm -f 0/*
    case $1 in
        vertexCentred*) displacement pointD pointVectorField fixedValue pointSolidTraction "$3" > 0/pointD ;;
        *TotalDisplacement) displacement D volVectorField fixedDisplacement solidTraction "$3" > 0/D ;;
        *) displacement DD volVectorField fixedDisplacement solidTraction "$3" > 0/DD ;;
    esac
}
: > system/functions
block '0.2 0.04 0.02' '20 4 2' 'clamp { type patch; faces (LEFT); } tip { type patch; faces (RIGHT); }
    sides { type patch; faces (BOTTOM TOP BACK FRONT); }'

# The solver to 0.02, the surrogate to 0.03, the solver to 0.04, the surrogate to 0.05, the solver to the end
export ORACLE_STRIDE=0.005 ORACLE_FRAMES=5
# What is handed back is right, so that nothing need be relaxed
replace='mode replace; model any; timeStart 0.02; solverSteps 10; surrogateSteps 2; relaxation none;'
: > any

# ahead END: until then time steps are solved by m4gnAnderson, beside what else there is: the solver's own answer with a quarter of the correctors
ahead() { echo "ahead { type m4gnAnderson; libs (m4gnFoam); compare no; timeEnd $1; }" >> system/functions; }
# gathered TIMES: D and sigma of a run on several ranks; at points there is one rank
gathered() { [ "$ranks" -eq 1 ] || runs reconstructPar -fields '(D sigma)' -time "$1"; }
# forces TIME FILE: what the clamp takes, as solids4foam's own function object has it
forces() { awk -v time="$1" '$1 + 0 == time { print $2, $3, $4 }' "$2"; }
# correctors FROM: of five time steps
correctors() {
    awk -v from="$1" '/^Time = / { time = $3 } /^ *[0-9]+, / { split($1, a, ","); n[time] = a[1] + 1 }
        END { for (i = 0; i < 5; ++i) printf "%s ", n[sprintf("%g", from + i*0.001)] }' log.run
}
energy() { awk -v time="$1" '$1 + 0 == time { print $2 }' "$2/postProcessing/0/"*solidKineticEnergy*; }
watch='energy { type solidKineticEnergy; libs (solids4FoamModels); }
forces { type solidForces; libs (solids4FoamModels); historyPatch clamp; }'
tolerances='solutionTolerance 1e-9; alternativeTolerance 1e-9; materialTolerance 1e-9;'
