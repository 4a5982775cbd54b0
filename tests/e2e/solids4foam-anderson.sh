#!/usr/bin/env bash
# Takes minutes.
# m4gnAnderson: the solver's own answer, with a fraction of its correctors; stopped and carried on too
. "$(dirname "${BASH_SOURCE[0]}")/_solids4foam.sh"
make_oracle

# all_correctors: of all time steps, those of m4gnAnderson among them
all_correctors() {
    awk '/^m4gn: the next time step is solved/ { n += $9 } /^ *[0-9]+, / { split($1, a, ","); n += a[1] + 1 } END { print n + 0 }' log.run
}
anderson='anderson { type m4gnAnderson; libs (m4gnFoam); }'
# On one rank all of twenty time steps are solved ahead. On two, forty and the account of processor time: one is left to the solver to compare with, which
# takes more than 32 to come, and how many follow is the machine's. The solver alone makes ten. On two ranks the answer is that of the solver alone on one,
# in the row before, but for where its linear solver stops.
while read -r ranks name material traction part held; do
    what="m4gnAnderson, $name, $held, $ranks ranks"
    model "$name" "$material" "$traction" Euler
    sed -i "s/ fixedDisplacement;/ $held;/" 0/*
    if [ "$ranks" -eq 1 ]; then
        control endTime 0.01
        plain
        keep full 0.01
        alone=$((2*$(all_correctors)))
    fi
    control endTime "$(calc "0.02*$ranks")"
    clean_case
    if [ "$ranks" -eq 1 ]; then
        echo "${anderson%\}*} compare no; }" > system/functions
        solve
        expect_log '^m4gn: 20 time steps solved ahead .* 0 left to the solver'
        grep -q '"time_steps_solved": 20, .*"time_steps_left": 0}' postProcessing/anderson/0/summary.json || fail "$what: $(cat postProcessing/anderson/0/summary.json)"
        below "$(all_correctors)" "$(calc "$part*$alone")" "$what: correctors in place of $alone"
    else
        echo "$anderson" > system/functions
        solve
        below 1 "$(sed -n 's/^m4gn: .* solved ahead .* \([0-9]*\) left to the solver.*/\1/p' log.run)" "$what: least time steps left to the solver"
    fi
    gathered 0.01
    close_to ../full "1e-$((7 - ranks))" 0.01/{D,sigma}
    # solids4foam itself carries on from D only
    if [ "$ranks" -gt 1 ] || [ ! -f 0/D ]; then continue; fi
    # What is prescribed stays to the bit: m4gnSurrogate refuses conditions that change from step to step
    grep -q "traction  *uniform (0 $traction 0);" 0.01/D || fail "$what: the traction at the tip is no longer $traction"
    keep end 0.02
    rm -r 0.01?* 0.02
    control startFrom latestTime
    solve
    control startFrom startTime
    close_to ../end 1e-6 0.02/D
done <<'EOD'
1 linearGeometryTotalDisplacement linearElastic 200 0.35 fixedDisplacement
1 nonLinearGeometryTotalLagrangianTotalDisplacement neoHookeanElastic 2000 0.35 fixedDisplacement
1 linearGeometry linearElastic 200 0.35 fixedDisplacement
1 nonLinearGeometryTotalLagrangian neoHookeanElastic 2000 0.35 fixedDisplacement
2 nonLinearGeometryTotalLagrangian neoHookeanElastic 2000 0.35 fixedDisplacement
1 nonLinearGeometryUpdatedLagrangian neoHookeanElastic 2000 0.35 fixedDisplacement
1 linearGeometryTotalDisplacement linearElastic 200 0.35 fixedDisplacementZeroShear
1 nonLinearGeometryTotalLagrangian neoHookeanElastic 2000 0.35 fixedDisplacementZeroShear
EOD
ranks=1
# None is left to the solver by the account of time
anderson="${anderson%\}*} compare no; }"
# It acts behind all others but a surrogate
clean_case
surrogate "$replace"
{ echo "$anderson"; cat system/functions; } > ../behind && mv ../behind system/functions
refused 'Function object test comes after anderson' solids4Foam
expect_log 'Have anderson behind it in functions'
# What it cannot solve is the solver's, and the log says why
control endTime 0.003
model vertexCentredLinearGeometry linearElastic 200 Euler
clean_case
echo "$anderson" > system/functions
solve
expect_log 'leaves all time steps to the solver: solidModel is vertexCentredLinearGeometry; needed: linearGeometry'
# The interface of two materials keeps the stress of the corrector before
model linearGeometryTotalDisplacement linearElastic 200 Euler
sed -i 's/^    rubber/    soft { type linearElastic; rho rho [1 -3 0 0 0 0 0] 1000; E E [1 -1 -2 0 0 0 0] 1e5; nu nu [0 0 0 0 0 0 0] 0.3; }\n&/' \
    constant/mechanicalProperties
{ header topoSetDict; cat <<'EOD'; } > system/topoSetDict
actions
(
    { name left; type cellSet; action new; source boxToCell; box (-1 -1 -1) (0.1 1 1); }
    { name rubber; type cellZoneSet; action new; source setToCellZone; set left; }
    { name right; type cellSet; action new; source boxToCell; box (0.1 -1 -1) (1 1 1); }
    { name soft; type cellZoneSet; action new; source setToCellZone; set right; }
);
EOD
clean_case
cp -r constant/polyMesh ../no-zones && runs topoSet
solve
expect_log 'leaves all time steps to the solver: 2 materials'
control endTime 0.04
rm -rf constant/polyMesh && mv ../no-zones constant/polyMesh
# Beside a surrogate: no step after a jump is at the solver's limit, which rough errors would take it to
model nonLinearGeometryTotalLagrangianTotalDisplacement neoHookeanElastic 2000 Euler
clean_case
function_object m4gnRecorder "fields (D ddt(D)); writeControl timeStep; writeInterval 1;"
echo "$anderson" >> system/functions
solve
rm -rf 0.0*
function_object m4gnSurrogate "$replace"
echo "$anderson" >> system/functions
ORACLE_ROUGH=0.01 solve
echo "beside a surrogate with a rough error: correctors of the solver $(correctors 0.031)after a jump"
for n in $(correctors 0.031); do below "$n" 5 'correctors of the solver after a jump'; done
