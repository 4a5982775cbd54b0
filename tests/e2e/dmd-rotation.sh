#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd) where a network is refused or knows less than the solver: a pipe as a wedge, and a zone that
# rotates (MRF, pimpleFoam), and blocks that interpolation joins (cyclicAMI), each behind an inlet that pulsates.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
mkdir -p case/{0,constant,system} && cd case
control_dict pimpleFoam 3 0.005 adjustableRunTime 1.5 12
schemes
laminar 1e-2
solvers 1e-8 0.01
# fields SIDES: with these conditions of the other patches
fields() {
    field U volVectorField '0 1 -1 0 0 0 0' '(1 0 0)' "inlet { type uniformFixedValue; uniformValue { type sine; frequency 2; amplitude 0.1;
        scale (1 0 0); level (1 0 0); } value uniform (1 0 0); } outlet { type zeroGradient; } wall { type noSlip; } $1"
    field p volScalarField '0 2 -2 0 0 0 0' 0 "outlet { type fixedValue; value uniform 0; } \"inlet|wall\" { type zeroGradient; } $1"
}
# compared SOLVER WHAT: the hybrid run beside the plain one
compared() {
    control application "$1"
    plain 1.5 3
    ride 'mode replace; surrogates (dmd); dmd { snapshotInterval 0.05; maxJump 20; minSnapshots 24; jumpTolerance 0.1; fitTolerance 0.05; }'
    replaces 0.1 "$2"
    close_to ../plain 0.05 3/{U,p}
}

block '1 0.4 0.1' '20 8 1' 'inlet { type patch; faces (LEFT); } outlet { type patch; faces (RIGHT); } wall { type wall; faces (BOTTOM TOP); }
    sides { type empty; faces (BACK FRONT); }'
{ header topoSetDict; echo 'actions ( { name rotor; type cellSet; action new; source boxToCell; sourceInfo { box (0.3 0.1 -1) (0.7 0.3 1); } }
    { name rotor; type cellZoneSet; action new; source setToCellZone; sourceInfo { set rotor; } } );'; } > system/topoSetDict
runs topoSet
{ header MRFProperties; echo 'rotor { cellZone rotor; active yes; nonRotatingPatches (); origin (0.5 0.2 0); axis (0 0 1); omega 2; }'; } \
    > constant/MRFProperties
fields 'sides { type empty; }'
compared pimpleFoam 'a zone that rotates'
# One that begins to rotate: a jump would go past it
sed -i 's/omega 2;/omega table ((0 0) (1 0) (1.1 2) (9 2));/' constant/MRFProperties
refused 'cannot jump over what changes in time by itself: rotor of MRFProperties' pimpleFoam

rm constant/MRFProperties
rm -rf constant/polyMesh
wedge '16 6 1'
fields '"back|front" { type wedge; } axis { type empty; }'
compared icoFoam 'a pipe as a wedge'

# Two blocks whose cells do not match, joined by interpolation (cyclicAMI)
rm -rf constant/polyMesh
{ header blockMeshDict; cat <<'EOD'; } > system/blockMeshDict
vertices ((0 0 0) (.5 0 0) (.5 .4 0) (0 .4 0) (0 0 .1) (.5 0 .1) (.5 .4 .1) (0 .4 .1) (.5 0 0) (1 0 0) (1 .4 0) (.5 .4 0) (.5 0 .1) (1 0 .1) (1 .4 .1) (.5 .4 .1));
blocks (hex (0 1 2 3 4 5 6 7) (10 8 1) simpleGrading (1 1 1) hex (8 9 10 11 12 13 14 15) (8 6 1) simpleGrading (1 1 1));
boundary
(
    inlet { type patch; faces ((0 4 7 3)); } outlet { type patch; faces ((9 10 14 13)); } wall { type wall; faces ((0 1 5 4) (3 7 6 2) (8 9 13 12) (11 15 14 10)); }
    before { type cyclicAMI; neighbourPatch behind; transform noOrdering; faces ((1 2 6 5)); }
    behind { type cyclicAMI; neighbourPatch before; transform noOrdering; faces ((8 12 15 11)); }
    sides { type empty; faces ((0 3 2 1) (4 5 6 7) (8 11 10 9) (12 13 14 15)); }
);
EOD
runs blockMesh
fields 'sides { type empty; } "before|behind" { type cyclicAMI; }'
compared icoFoam 'blocks joined by cyclicAMI'
