#!/usr/bin/env bash
# m4gnSurrogate with dmd { cutTransient yes; }: a wake that grows slowly settles earlier than by itself and has the same amplitude then; a run that is
# carried on between two changes has the same ones; two ranks have the same. src/ride/dmd_tests/start_up.rs shows that what has settled is not touched.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
# A wake of Re 71, whose lift has its final amplitude from some 6.5 s on
cp -r "$M4GN_HOME/openfoam/templates/cylinder-flow" case
cd case
rm family.toml
sed -i -e 's/@x@/0.2291/; s/@y@/0.1931/; s/@radius@/0.04245/; s/@size@/0.0408/; s/@nu@/1e-3/; s/@shape@/0/; s/@elements@/0/' \
    -e 's/@linear@/12.2025/; s/@quadratic@/-29.7622/; s/@tolerance@/1e-6/; s/@correctors@/1/; s/@convection@/1/' \
    mesh.geo 0/U constant/transportProperties system/fv{Solution,Schemes}
cp -r 0 origin
control_dict icoFoam 8 0.00217391304347826087 adjustableRunTime 0.5 12
mesh_of_the_cylinder
cp -r origin/. 0

# amplitude FROM TO: half of what the lift varies by
amplitude() {
    awk -v from="$1" -v to="$2" '!/^#/ && $1 > from && $1 <= to { if (!n++ || $4 > most) most = $4; if (n == 1 || $4 < least) least = $4 }
        END { print (most - least)/2 }' postProcessing/lift/*/coefficient.dat
}
# settled END: time from which the amplitude over half a second stays within 3 % of END
settled() {
    local t
    for t in $(seq 7.5 -0.1 1); do
        awk "BEGIN { exit !($(off "$(amplitude "$t" "$(calc "$t + 0.5")")" "$1") < 0.03) }" || { calc "$t + 0.5"; return; }
    done
    calc "$t"
}
beside=$(drag lift)
# No jumps in time: what is looked at is the start-up
dmd='mode replace; surrogates (dmd); dmd { snapshotInterval 0.05; cutTransient yes; fitTolerance 1e-9; jumpTolerance 1e-9; }'

echo "$beside" > system/functions
solve
keep start 0.5
end=$(amplitude 7 8)
plain=$(settled "$end")
rm -rf postProcessing
ride "$dmd"
cut=$(settled "$end")
echo "settled at $plain s, and with cutTransient at $cut s"
holds "$cut < 0.8*$plain" 'settles early enough:'
below "$(off "$(amplitude 7 8)" "$end")" 0.02 'amplitude of lift at the end, off by'
expect_log 'start-up: a wave of period 0.4.* its amplitude is brought to'
decided 'changes that are kept' "of('start_up', decision='changed') and of('start_up', kept=True) and not of('start_up', decision='undone')"
decided 'an end' "len(of('start_up', decision='settled')) == 1"
keep whole [234] postProcessing

# changes FOLDER: between the start and the end of the run
changes() {
    python3 -c 'import json, sys
start, end = map(float, sys.argv[1:])
print(sum(d["decision"] == "changed" and start < d["time"] <= end for d in map(json.loads, sys.stdin) if d["event"] == "start_up"))' \
        "$(foamDictionary -entry startTime -value system/controlDict)" "$(foamDictionary -entry endTime -value system/controlDict)" \
        <"$1/postProcessing/test/decisions.jsonl"
}
# Carried on for a second each, from before the first change and from between two
for time in 2 3; do
    control endTime $((time + 1))
    carry_on "$time"
    close_to ../whole 1e-6 $((time + 1))/U
    [ "$(changes .)" -ge 1 ] || fail "no change between $time s and $((time + 1)) s"
    [ "$(changes .)" = "$(changes ../whole)" ] || fail "other changes after $time s"
done

# Two ranks make the same change: to the first quarter of a second that lies 0.3 s behind the first one
until=$(python3 -c 'import json, sys
first = next(d["time"] for d in map(json.loads, sys.stdin) if d["event"] == "start_up" and d["decision"] == "changed")
print("%g" % (int(4*first + 2.2)/4))' <../whole/postProcessing/test/decisions.jsonl)
control startTime 0.5 endTime "$until" writeInterval "$(calc "$until - 0.5")"
pressure_by_pcg
# started [RANKS]: from 0.5 s, when there is no wave yet
started() { clean_case && cp -r ../start/0.5 . && solve "$@"; }
surrogate "$dmd"
started
[ "$(changes .)" -ge 1 ] || fail "no change to $until s"
jumps=$(rows postProcessing/test/0.5/surrogate.dat | cut -f 1,2)
keep serial "$until"
started 2
runs reconstructPar
close_to ../serial 1e-3 "$until/U"
[ "$jumps" = "$(rows postProcessing/test/0.5/surrogate.dat | cut -f 1,2)" ] || fail 'two ranks make other changes'
