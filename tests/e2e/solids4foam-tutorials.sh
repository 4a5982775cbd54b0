#!/usr/bin/env bash
# Takes minutes.
# solids4foam's own tutorials, of different models and laws, some with fewer cells: the function objects leave the solver's files as they were to the byte,
# mode replace goes on from recorded states or is refused in the first time step, by name, and m4gnAnderson comes to the same
# answer or leaves all to the solver, and says why. Needs solids4foam as tests/e2e/_solids4foam.sh says, and
#   SOLIDS4FOAM_DIR        its source, with tutorials/solids and applications/scripts
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam
# shellcheck source=tests/e2e/_solids4foam-tutorial.sh
. "$M4GN_HOME/tests/e2e/_solids4foam-tutorial.sh"
make_oracle
oracle=$LD_PRELOAD

# same FOLDER: every file of the times there is as it was, besides what m4gn writes
same() {
    local file n=0
    while read -r file; do
        cmp -s "$1/$file" "$file" || fail "$what: $file is not as it was without m4gn"
        n=$((n + 1))
    done < <(cd "$1" && find . -path './[0-9]*' -type f)
    [ $n -gt 4 ] || fail "$what: only $n files to compare"
    echo "$what: $n files as without m4gn"
}

while read -r tutorial cells steps ahead limit text; do
    what=$tutorial
    export LD_PRELOAD=
    rm -rf "$work/case" && cd "$work"
    solids4foam_tutorial "$tutorial" "$steps" case "${cells#own}"
    runs solids4Foam
    rm -rf ../plain && mkdir ../plain && find . -maxdepth 1 -name '[0-9]*' ! -name 0 -exec mv -t ../plain {} +

    # Recorded, with segments
    clean_case
    echo "record { type m4gnRecorder; libs (m4gnFoam); fields (D); writeControl timeStep; writeInterval 1; }
        parts { type m4gnSegments; libs (m4gnFoam); segments { count 4; } }" > system/functions
    runs solids4Foam
    same ../plain
    [ -s "$(find . -name trajectory.h5)" ] || fail "$what: nothing was recorded"

    # Solved ahead, and recorded for the oracle
    clean_case
    export LD_PRELOAD=$oracle
    ORACLE_STRIDE=$(calc "2*$step")
    export ORACLE_STRIDE ORACLE_FRAMES=2
    function_object m4gnRecorder 'fields (D); writeControl timeStep; writeInterval 1;'
    echo 'anderson { type m4gnAnderson; libs (m4gnFoam); compare no; }' >> system/functions
    runs solids4Foam
    case $ahead in
        left:*)
            expect_log "anderson leaves all time steps to the solver: .*${ahead#left:}.*; needed: "
            same ../plain
            ;;
        *)
            # Each begins at its solution
            expect_log ' solved ahead .* 0 left to the solver'
            checking=$(awk '/^m4gn: the next time step is solved/ { ahead = 1 } ahead && /^ *[0-9]+, / { split($1, a, ","); n = a[1] + 1 }
                /^ExecutionTime/ { ahead = 0; if (n > most) most = n; n = 0 } END { print most + 0 }' log.run)
            below "$checking" 10 "$what: most correctors of the solver in a time step that was solved ahead"
            last=$(foamListTimes -latestTime)
            below "$(difference "../plain/$last/D" "$last/D")" "$ahead" "$what: D at $last, $(sed -n 's/^m4gn: //p' log.run | tail -n 1)"
            ;;
    esac

    # Replaced: from the fourth step two steps are the surrogate's
    clean_case
    : > any
    function_object m4gnSurrogate "mode replace; model any; solverSteps 4; surrogateSteps 1; timeStart $(calc "3.5*$step");"
    if [ "$limit" = refused ]; then
        refused "$text" solids4Foam
        [ "$(grep -c '^Time = ' log.run)" -le 1 ] || fail "$what: refused in step $(grep -c '^Time = ' log.run), expected the first"
        echo "$what: refused in the first step: $text"
        continue
    fi
    runs solids4Foam
    jumped + 1
    last=$(foamListTimes -latestTime)
    for field in D sigma; do
        below "$(difference "../plain/$last/$field" "$last/$field")" "$limit" "$what: $field at $last, two steps of $steps were jumped"
    done
done <<'EOD'
linearElasticity/rigidCylinderContactBrick own 8 1e-4 1e-3
hyperelasticity/longWall 10x10 8 left:solvePressureEqn refused does not know how solidModel nonLinearGeometryTotalLagrangian carries on
hyperelasticity/rigidRotation/rotatingBlock own 8 1e-4 1e-3
hyperelasticity/cylindricalPressureVessel 20x20 8 left:solvePressureEqn 1e-3
viscoelasticity/viscoTube 24x12 6 1e-4 refused does not hand over the history of the material
linearElasticity/waveBar own 8 left:explicitLinearGeometryTotalDisplacement refused does not know how solidModel explicitLinearGeometryTotalDisplacement carries on
elastoplasticity/cooksMembrane 6x6 16 1e-3 refused does not know how solidModel nonLinearGeometryUpdatedLagrangian carries on
EOD
