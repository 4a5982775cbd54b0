#!/usr/bin/env bash
# Takes minutes.
# Relaxation: what an error has of stiff shapes goes to its equilibrium, and what is right stays; on two ranks as on one
. "$(dirname "${BASH_SOURCE[0]}")/_solids4foam.sh"
make_oracle

relaxed=${replace/relaxation none;/}
# elastic FILE: the elastic energy of small strains that belongs to the stresses, but for a factor that is the same for all times (nu as above)
elastic() {
    values "$1" | awk -v nu=0.3 '{ w += (1 + nu)*($1^2 + $4^2 + $6^2 + 2*($2^2 + $3^2 + $5^2)) - nu*($1 + $4 + $6)^2 }
        END { print w }'
}
# relax WHAT ENTRIES ROUGH END
relax() {
    clean_case
    control endTime "$4"
    function_object m4gnSurrogate "${relaxed/0.02;/0.02; timeEnd 0.031;} $2"
    echo "$watch" >> system/functions
    # To the jump, which begins at 0.02
    ahead 0.019
    ORACLE_ROUGH=$3 solve
    gathered 0.025:
    stress=$(difference ../full/0.03/sigma 0.03/sigma)
    elastic=$(calc "$(elastic 0.03/sigma)/$(elastic ../full/0.03/sigma)")
    echo "$1, $ranks ranks: elastic energy $elastic of its own; D off by $(difference ../full/0.03/"$field" 0.03/"$field"), a step later $(difference ../full/0.031/"$field" 0.031/"$field")," \
        "sigma $stress, $(difference ../full/0.031/sigma 0.031/sigma), correctors $(correctors 0.031)"
}
# The nonlinear model on two ranks as well: its correctors have all that those of the linear one exchange
while read -r name material traction scheme fields most counts; do
    field=${fields%%,*}
    for ranks in $counts; do
        model "$name" "$material" "$traction" "${scheme//_/ }"
        clean_case
        function_object m4gnRecorder "fields (${fields//,/ }); writeControl timeStep; writeInterval 1;"
        ahead 1
        control endTime 0.036
        solve
        gathered 0.025:
        keep full 0.*

        if [ "$ranks" -eq 1 ]; then
            relax "$name, $scheme, no error, relaxed" 'relaxation { time 0.005; }' 0 0.034
            below "$stress" "$most" "$name: sigma of a recorded state that was relaxed"
            below "$(off "$elastic" 1)" "$most" "$name: elastic energy of a recorded state that was relaxed off by"
            below "$(difference ../full/0.034/"$field" 0.034/"$field")" "$(calc "$most/5")" "$name: D after a recorded state that was relaxed"

            # From inside the jump: as without the stop
            keep one 0.*
            rm -r 0.*
            cp -r ../one/0.025 .
            control startFrom latestTime endTime 0.031
            solve
            control startFrom startTime
            expect_log 'in a jump of which 1 steps are left'
            below "$(difference ../one/0.031/"$field" 0.031/"$field")" 1e-9 "$name: D of a run that was carried on inside a jump"

            relax "$name, $scheme, rough, as predicted" 'relaxation none;' 0.01 0.031
            rough=$stress
        fi
        # The error is the same on two ranks
        relax "$name, $scheme, rough, relaxed" 'relaxation { time 0.005; }' 0.01 0.031
        below "$stress" "$(calc "$rough/20")" "$name, $ranks ranks: sigma of a rough state that was relaxed"
        below "$(off "$elastic" 1)" 0.1 "$name, $ranks ranks: elastic energy of a rough state that was relaxed off by"
        if [ "$ranks" -eq 1 ]; then
            keep one 0.*
        else
            below "$(difference ../one/0.03/D 0.03/D)" 5e-4 "$name: D on two ranks and on one"
        fi
    done
done <<'EOD'
linearGeometryTotalDisplacement linearElastic 200 Euler D,ddt(D) 0.05 1
nonLinearGeometryTotalLagrangianTotalDisplacement neoHookeanElastic 2000 Euler D,ddt(D) 0.05 1 2
EOD
ranks=1
function_object m4gnSurrogate "$relaxed relaxation { time 0; }"
refused 'expected more than 0' solids4Foam
