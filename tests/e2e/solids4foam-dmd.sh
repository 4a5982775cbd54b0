#!/usr/bin/env bash
# Takes minutes.
# Fitted to the run's own states: after a fit most of a free vibration is not solved, and the solver carries on as in the run without
. "$(dirname "${BASH_SOURCE[0]}")/_solids4foam.sh"

control endTime 0.6 deltaT 0.002 writeInterval 50
block '0.2 0.04 0.02' '10 2 1' 'clamp { type patch; faces (LEFT); } tip { type patch; faces (RIGHT); }
    sides { type patch; faces (BOTTOM TOP BACK FRONT); }'
tolerances='solutionTolerance 1e-6; alternativeTolerance 1e-6; materialTolerance 1e-6;'
dmd='mode replace; surrogates (dmd); dmd { snapshotInterval 0.01; minSnapshots 24; fitTolerance 0.02; }'
while read -r ranks name material traction scheme field; do
    what="dmd, $name, $scheme, $ranks ranks"
    model "$name" "$material" "$traction" "${scheme//_/ }"
    clean_case
    : > system/functions
    ahead 1
    # Between ranks each corrector is some hundred messages: the full run is on one, and what is not jumped is solved ahead too
    solve 1
    keep full 0.5 0.6
    beside=
    [ "$ranks" -eq 1 ] || beside='ahead { type m4gnAnderson; libs (m4gnFoam); compare no; }'
    ride "$dmd"
    replaces 0.15 "$what"
    if [ "$ranks" -eq 1 ]; then
        # In jumps too
        for time in 0.{1..6}; do [ -f "$time/sigmaEq" ] || fail "$what: no sigmaEq at $time"; done
    fi
    gathered 0.5,0.6
    change=$(difference ../full/{0.6,0.5}/"$field")
    close_to ../full "$(calc "0.05*$change")" 0.6/{"$field",sigma}
    close_to ../full "$(calc "0.1*$change")" 0.5/sigma
done <<'EOD'
1 linearGeometryTotalDisplacement linearElastic 200 Euler D
1 linearGeometry linearElastic 200 Euler D
2 nonLinearGeometryTotalLagrangianTotalDisplacement neoHookeanElastic 500 Euler D
1 nonLinearGeometryTotalLagrangian neoHookeanElastic 500 Euler D
1 vertexCentredLinearGeometry linearElastic 200 NewmarkBeta_0.25_0.5 pointD
1 vertexCentredNonLinTotalLagGeometry neoHookeanElastic 50 NewmarkBeta_0.25_0.5 pointD
EOD
ranks=1 beside=
function_object m4gnSurrogate "$dmd"
model nonLinearGeometryUpdatedLagrangian neoHookeanElastic 500 Euler
clean_case
refused 'the mesh moves with the body (solidModel nonLinearGeometryUpdatedLagrangian)' solids4Foam
model linearGeometryTotalDisplacement linearElastic 200 Euler
echo '((0 (0 200 0)) (1 (0 0 0)))' > constant/load
sed -i 's|tip .*|tip { type solidTraction; tractionSeries { file "constant/load"; outOfBounds clamp; } pressure uniform 0; value uniform (0 0 0); }|' 0/D
clean_case
refused 'Nobody can say beforehand what the condition solidTraction of D at the patch tip' solids4Foam
sed -i 's|tip .*|tip { type rigidCylinderContact; cylinderRadius 1; cylinderCentre { file "constant/load"; outOfBounds clamp; } penaltyStiffness 1e6; relaxFactor 0.1; value uniform (0 0 0); }|' 0/D
refused 'Nobody can say beforehand what the condition rigidCylinderContact of D at the patch tip' solids4Foam
