#!/usr/bin/env bash
# m4gn campaign: a cavity from init to report with the stock solver; killed in the middle; two at once; a full disk; a run that diverges; an edited
# case; starts from sisters, scaled and mapped, while they pay; for Dakota; on two ranks.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# cavity FOLDER: a driven cavity without a mesh, whose lid speed and number of cells are parameters once its files are told so
cavity() {
    mkdir -p "$1"/{0,constant,system}
    cd "$1"
    control_dict icoFoam 2 0.005 timeStep 20 10
    cat > system/functions <<'EOD'
speed { type mag; libs (fieldFunctionObjects); field U; writeControl none; log no; }
mean
{
    // include
    type volFieldValue; libs (fieldFunctionObjects); regionType all; operation volAverage; fields (mag(U)); writeFields no; log no;
}
EOD
    schemes
    solvers 1e-8 0
    { header transportProperties; echo 'nu 0.01;'; } > constant/transportProperties
    field U volVectorField '0 1 -1 0 0 0 0' '(0 0 0)' '
lid { type fixedValue; value uniform (1 0 0); }
walls { type noSlip; } frontAndBack { type empty; }
'
    field p volScalarField '0 2 -2 0 0 0 0' 0 '"(lid|walls)" { type zeroGradient; } frontAndBack { type empty; }'
    block '0.1 0.1 0.01' '20 20 1' 'lid { type wall; faces (TOP); } walls { type wall; faces (LEFT RIGHT BOTTOM); }
        frontAndBack { type empty; faces (BACK FRONT); }'
    rm -rf constant/polyMesh log.run
    cd ..
}
# quantity FOLDER ENTRY...: its campaign.toml asks for the mean speed, not before 0.3 s, and has these entries
quantity() {
    local folder=$1
    shift
    sed -i -E 's/^(min_time) = .*/\1 = 0.3/; s/^(held_out) = .*/\1 = 0/' "$folder/campaign.toml"
    for entry in "$@"; do
        sed -i -E "/^#? ?${entry%% *} = /d" "$folder/campaign.toml"
        sed -i "1i $entry" "$folder/campaign.toml"
    done
    cat >> "$folder/campaign.toml" <<'EOD'
[[quantity]]
name = "speed"
function_object = "mean"
result = "volAverage(mag(U))"
relative = 0.005
EOD
}
# value FOLDER RUN: of its row of results.csv, not its check's
value() { awk -F, -v run="$2" '$1 == run && $(NF - 3) != "check" { print $(NF - 6) }' "$1/results.csv"; }
done_of() { stat -c '%n %y %i' "$1"/*/*/done; }

cavity cavity
before=$(find cavity -type f -exec md5sum {} + | sort)

# A parameter that no file uses: the lines that may be meant; nothing is written
refused 'uses the parameter Ulid' m4gn campaign init cavity --out study --parameter Ulid=0.5:2
expect_log '#include "<system>/simulationParameters"' '0/U, line .*: lid { type fixedValue; value uniform (1 0 0); }'
[ "$(find cavity study -type f -exec md5sum {} + 2> log.find | sort)" = "$before" ] || fail "a refused init wrote something"
# shellcheck disable=SC2016  # names of OpenFOAM
sed -i 's/uniform (1 0 0)/uniform ($Ulid 0 0)/; s/ dimensions/\n#include "<system>\/simulationParameters"\ndimensions/' cavity/0/U
# shellcheck disable=SC2016
sed -i 's/(20 20 1)/($n $n 1)/' cavity/system/blockMeshDict
# What controlDict includes is not there yet
sed -i 's/.*\/\/ include/#include "<system>\/simulationParameters"/' cavity/system/functions

# What does not go together is told
runs m4gn campaign init cavity --out study --parameter Ulid=0.5,1,1.5,2 --parameter n=20
expect_log 'system/blockMeshDict uses a parameter and does not include' 'no quantity is known' '4 runs' \
    'check: the first run was not made: blockMesh failed'
grep -q 'prepare = \[\["blockMesh"\]\]' study/campaign.toml || fail "blockMesh is no command: $(cat study/campaign.toml)"
sed -i '2i #include "simulationParameters"' cavity/system/blockMeshDict
# Its check has 6 s for the solver, which a pause of the machine may take
for _ in 1 2 3; do
    rm -rf study
    runs m4gn campaign init cavity --out study --parameter Ulid=0.5,1,1.5,2 --parameter n=20
    ! grep -q 'fits, with' log.run || break
done
expect_silence 'does not include'
grep -qxF '# result = "volAverage(mag(U))"' study/campaign.toml || fail "not the result of the case's function object: $(cat study/campaign.toml)"
expect_log 'check: .*surrogate = "dmd" fits, with dmd { snapshotInterval '
entries=$(sed -n 's/.*fits, with //p' log.run)
grep -qxF "# surrogate_entries = \"$entries\"" study/campaign.toml || fail "not the entries of the check: $(cat study/campaign.toml)"
refused 'is there already' m4gn campaign init cavity --out study --parameter Ulid=1,2
refused 'lies in the case' m4gn campaign init cavity --out study/../cavity/own --parameter Ulid=1,2
mkdir own && echo 'case_name,Ulid' > own/parameters.csv
refused 'own/parameters.csv: is there already' m4gn campaign init cavity --out own --parameter Ulid=1,2
[ "$(cat own/parameters.csv)" = 'case_name,Ulid' ] || fail "the user's parameters.csv was changed"
# A file that cannot be written takes the others with it, and the next init goes on
mkdir half && ln -s nowhere/campaign.toml half/campaign.toml
refused 'half/campaign.toml: cannot be written' m4gn campaign init cavity --out half --parameter Ulid=1,2 --parameter n=20
rm half/campaign.toml
runs m4gn campaign init cavity --out half --parameter Ulid=1,2 --parameter n=20
refused 'has no \[\[quantity\]\]' m4gn campaign run --store study
quantity study 'scale = "Ulid"' 'held_out = 0.25' 'start = "nearest"'
refused 'has no run r7: expected one of r01' m4gn campaign one r7 --store study

# A column that no file of the case uses would make all runs alike
cp study/parameters.csv as-made.csv
sed '1s/$/,density/; 2,$s/$/,1/' as-made.csv > study/parameters.csv
refused 'uses the parameter density' m4gn campaign run --store study
refused 'uses the parameter density' m4gn campaign one r01 --store study
mv as-made.csv study/parameters.csv

# What a stopped run leaves is told
mkdir -p study/runs/r02/case
runs m4gn campaign status --store study
expect_log 'r02 .*to make anew, from its begin'

# Killed in the middle, and carried on: what is done stays, and nothing of the killed run does
m4gn campaign run --store study > log.killed 2>&1 &
killed=$!
until ls study/runs/*/done > log.ls 2>&1; do kill -0 $killed || { cat log.killed; fail "it ended before it was killed"; }; sleep 0.1; done
kill -9 $killed
wait $killed || true
kept=$(done_of study)
[ "$(wc -l <<< "$kept")" -lt 4 ] || fail "it was over before it was killed"
runs m4gn campaign status --store study
expect_log 'to make'
runs m4gn campaign run --store study
[ "$(done_of study | grep -cF "$kept")" -ge 1 ] || fail "what was done before the kill was made again"
runs m4gn campaign run --store study
expect_log '5 of 5 runs are there, 0 to make'
runs m4gn campaign one r02 --store study
expect_log 'r02: is there: speed '

# The starts are scaled sisters; figures are those of the cold plain run to the end
runs m4gn campaign report --store study
[ "$(awk -F, '$(NF - 3) ~ /^nearest r0. x / { ++n } END { print n }' study/results.csv)" = 3 ] || { cat study/results.csv; fail "not three runs began from a sister"; }
awk -F, '$(NF - 3) == "check" { print $1, $(NF - 6) }' study/results.csv > check
read -r run checked < check
below "$(off "$(value study "$run")" "$checked")" 0.006 "mean speed of $run against its check"
grep -q '"kind": "nearest"' "study/runs/$run/done" || fail "$run, which is checked, is cold itself"
# A creeping flow: four times the lid's speed, four times the mean
holds "$(value study r04)/$(value study r01) > 3.5 && $(value study r04)/$(value study r01) < 4.5"
grep -q '<svg' study/report.html || fail "the page has no chart"
grep -q 'A cold plain run to the end takes' study/report.html || fail "the page does not say what cold runs would take"
! grep -n 'NaN' study/report.html || fail "the page has figures that are none"
# by_itself ULID: the stock solver by itself, in plain
by_itself() {
    rm -rf plain
    cp -r cavity plain && cd plain
    runs blockMesh
    sed -i "s/^Ulid .*/Ulid $1;/" system/simulationParameters
    runs icoFoam
}
# A cold run of the stock solver by itself says the same
by_itself 2
plain=$(awk '!/^#/ { u = $2 } END { print u }' postProcessing/mean/0/volFieldValue.dat)
cd ..
below "$(off "$(value study r04)" "$plain")" 0.006 "mean speed of r04 against a run by itself"

# An edited case: told, and made again where that is asked for
sed -i 's/^nu .*/nu 0.0101;/' cavity/constant/transportProperties
refused '5 of 5 runs are of other contents .*another content of: constant/transportProperties of the case' m4gn campaign run --store study
refused 'another content of: constant/transportProperties of the case' m4gn campaign one r02 --store study
runs m4gn campaign report --store study
expect_log 'is left out' '0 of 5 runs'
runs m4gn campaign one r02 --store study --anew
runs m4gn campaign run --store study --anew --shard 1/2
runs m4gn campaign status --store study
expect_log 'of another content of: constant/transportProperties'
runs m4gn campaign run --store study --anew --shard 2/2
runs m4gn campaign report --store study
expect_log '5 of 5 runs'

# The how-to's Snakefile: its names are those of the runs, and Snakemake makes the one that is missing
awk '/`Snakefile`/ { on = 1 } /^\[foamlib/ { on = 0 } on && sub(/^    /, "")' "$M4GN_HOME/docs/how-to/run-a-campaign.md" > study/Snakefile
# As Excel saves the table
sed -i '1s/^/\xef\xbb\xbf/; s/^r02/"r02"/; s/$/\r/' study/parameters.csv
printf '\r\n' >> study/parameters.csv
(cd study && python3 -c "$(sed '/^rule/,$d' Snakefile)
assert names == ['r01', 'r02', 'r03', 'r04'], names") || fail "the Snakefile has other runs"
if command -v snakemake > log.which; then
    kept=$(done_of study)
    rm study/runs/r04/done
    (cd study && snakemake --cores 1) > log.snakemake 2>&1 || { cat log.snakemake; fail "Snakemake failed"; }
    [ -s study/runs/r04/done ] || fail "Snakemake has not made r04"
    [ "$(done_of study | grep -v r04)" = "$(grep -v r04 <<< "$kept")" ] || fail "Snakemake made more than r04"
fi

# Two at once: each run is made once
rm -rf study/runs study/checks
m4gn campaign run --store study > log.first 2>&1 & first=$!
m4gn campaign run --store study > log.second 2>&1 & second=$!
wait $first || { cat log.first; fail "the first of two failed"; }
wait $second || { cat log.second; fail "the second of two failed"; }
runs m4gn campaign status --store study
expect_log '5 of 5 runs are there'
for log in log.first log.second; do grep -q '^[0-9]/[0-9] r0' $log || { cat $log; fail "one of two made all"; }; done
! grep waiting: study/*/*/log.m4gn || fail "two began the same run, and one waited for the other"

# A full disk, on which programs' writes fail and they go on: no result and nothing half, and the same command goes on
rm -rf study/runs study/checks
full=$( (trap '' XFSZ; ulimit -f 0; m4gn campaign one r02 --store study) 2>&1) && fail "a run was made without a byte"
grep -q 'File too large' <<< "$full" || fail "not what failed: $full"
{ echo '#!/bin/bash'; echo "trap '' XFSZ; [ -e $PWD/space ] || ulimit -f 12; exec icoFoam > /dev/null"; } > cavity/limited
chmod +x cavity/limited
sed -i 's/^solver = .*/solver = [".\/limited"]/' study/campaign.toml
refused 'is cut off: expected the line that ends' m4gn campaign one r02 --store study
[ ! -e study/runs/r02/done ] || fail "a state that is cut off counts"
touch space
runs m4gn campaign run --store study --retry
runs m4gn campaign status --store study
expect_log '5 of 5 runs are there'
rm cavity/limited
sed -i 's/^solver = .*/solver = ["icoFoam"]/' study/campaign.toml

# Another mesh: mapped. A run that diverges is told, kept as failed, and the others are made
runs m4gn campaign init cavity --out other --parameter Ulid=1,1.2,300 --parameter n=20,24,20 --sampling list
quantity other 'scale = "Ulid"'
refused '1 of 3 runs failed' m4gn campaign run --store other
expect_log 'r03 (Ulid 300, n 20): failed: ' 'mapped'
refused 'failed before, and is not made again' m4gn campaign run --store other
refused 'r03 (Ulid 300, n 20): failed: ' m4gn campaign run --store other --retry
runs m4gn campaign report --store other
expect_log '2 of 3 runs' 'r03 failed'
grep -q 'those that failed [0-9.]*[1-9]' other/report.html || fail "a failed run took no time"
# A state that the user has removed is none that a run starts from
rm -r other/runs/r02/case
echo r04,1.1,24 >> other/parameters.csv
runs m4gn campaign one r04 --store other
expect_log '^r04: speed .*from nearest r01 x [0-9.]* mapped'

# Dakota's files. asked FORMAT ULID ASV...: params.in as Dakota writes it, for the responses again and speed
asked() {
    local format=$1 tags=(variables functions derivative_variables analysis_components eval_id metadata)
    if [ "$format" = aprepro ]; then
        tags=(DAKOTA_VARS DAKOTA_FNS DAKOTA_DER_VARS DAKOTA_AN_COMPS DAKOTA_EVAL_ID DAKOTA_METADATA)
    fi
    put() { if [ "$format" = aprepro ]; then printf '%20s{ %-15s = %22s }\n' '' "$1" "$2"; else printf '%43s %s\n' "$2" "$1"; fi; }
    { put "${tags[0]}" 2; put Ulid "$(printf '%.15e' "$2")"; put n 20
      put "${tags[1]}" 2; put ASV_1:again "$3"; put ASV_2:speed "$4"
      put "${tags[2]}" 1; put DVV_1:Ulid 1; put "${tags[3]}" 0; put "${tags[4]}" 1; put "${tags[5]}" 0; } > params.in
}
of_dakota() { m4gn campaign one --store by_dakota --dakota params.in results.out; }
runs m4gn campaign init cavity --out by_dakota --parameter Ulid=1.25 --parameter n=20
quantity by_dakota 'scale = "Ulid"'
sed -n '/^\[\[quantity/,$ { s/"speed"/"again"/; /^relative/d; p }' by_dakota/campaign.toml > again
cat again >> by_dakota/campaign.toml
asked standard 1.25 1 1
runs of_dakota
expect_log '^r01: again '
[ "$(awk '{ print $2 }' results.out | xargs)" = "again speed" ] || { cat results.out; fail "not the responses that were asked for, in order"; }
[ "$(wc -l < by_dakota/parameters.csv)" = 2 ] || fail "a run that is in the table was appended"
# Two at once that are not in the table, and one of them again
for ulid in 1.5 0.75; do
    mkdir "eval.$ulid" && cd "eval.$ulid"
    asked aprepro "$ulid" 0 1
    m4gn campaign one --store ../by_dakota --dakota params.in results.out > log &
    cd ..
done
wait
asked standard 1.5 0 1
runs of_dakota
expect_log ': is there: again '
cmp results.out eval.1.5/results.out || fail "the same values have another answer"
[ "$(cut -d, -f1 by_dakota/parameters.csv | xargs)" = "case_name r01 r02 r03" ] || fail "not three runs: $(cat by_dakota/parameters.csv)"
runs m4gn campaign report --store by_dakota
below "$(off "$(awk '{ print $1 }' results.out)" "$(awk -F, '$2 == 1.5 && $4 == "speed" { print $5 }' by_dakota/results.csv)")" 1e-12 "results.out against results.csv"
below "$(off "$(awk '{ print $1 }' eval.0.75/results.out)" "$(awk '{ print $1/2 }' results.out)")" 0.02 "half the speed of the lid, in a creeping flow"
# failed ASV WHY: Dakota is told that the run failed
failed() {
    refused "$1" of_dakota
    [ "$(head -n 1 results.out)" = fail ] || { cat results.out; fail "results.out does not begin with fail"; }
}
asked standard 1.5 1 3
failed 'asks for 3 of .speed.: expected 0 or 1'
sed -i 's/3 ASV_2:speed/1 ASV_2:drag/' params.in
failed 'response .drag.: expected a \[\[quantity\]\] of the campaign, speed, again'
asked standard 300 1 1
failed 'icoFoam'
asked aprepro 1.5 1 1
sed -i '/Ulid  /d' params.in
failed 'expected a number of DAKOTA_VARS'
[ "$(wc -l < by_dakota/parameters.csv)" = 5 ] || fail "what cannot be read was appended: $(cat by_dakota/parameters.csv)"

# On two ranks
refused 'numberOfSubdomains is 2: expected the 3 of --ranks' m4gn campaign init cavity --out ranks --parameter Ulid=1,1.2 --parameter n=20 --ranks 3
runs m4gn campaign init cavity --out ranks --parameter Ulid=1,1.2 --parameter n=20 --ranks 2
quantity ranks 'scale = "Ulid"'
# shellcheck disable=SC2016  # of the inner shell
unbound='prepare = [["sh", "-c", "[ $OMPI_MCA_hwloc_base_binding_policy$PRTE_MCA_rmaps_default_mapping_policy = none:oversubscribe ]"], '
sed -i "s/^prepare = \\[/$unbound/" ranks/campaign.toml
runs env -u PRTE_MCA_rmaps_default_mapping_policy m4gn campaign one r01 --store ranks
runs env FOAM_FILEHANDLER=collated m4gn campaign run --store ranks
runs m4gn campaign report --store ranks
below "$(off "$(value ranks r01)" "$(value other r01)")" 0.006 "mean speed on two ranks against one"
[ -z "$(ls -d ranks/runs/*/case/processor* 2> /dev/null)" ] || fail "folders of ranks are left"

# Its figures are there where its last state cannot be reconstructed
mkdir shim
printf '#!/bin/sh\nexit 1\n' > shim/reconstructPar
chmod +x shim/reconstructPar
runs m4gn campaign init cavity --out apart --parameter Ulid=1 --parameter n=20 --ranks 2
quantity apart
runs env PATH="$PWD/shim:$PATH" m4gn campaign one r01 --store apart
expect_log '^r01: speed .*its last state cannot be taken: .*reconstructPar failed'

# An end that is a parameter is each run's own, also where controlDict includes it from elsewhere in the case
sed -i 's/^endTime .*/#include "$FOAM_CASE\/constant\/times"/' cavity/system/controlDict
# shellcheck disable=SC2016  # names of OpenFOAM
printf '#include "<system>/simulationParameters"\nendTime $stopAfter;\n' > cavity/constant/times
runs m4gn campaign init cavity --out ends --parameter Ulid=1 --parameter n=20 --parameter stopAfter=0.1,0.2
quantity ends 'stop = false'
sed -i 's/^min_time = .*/min_time = 0/' ends/campaign.toml
runs m4gn campaign run --store ends
grep -q '"end_time": 0.1,' ends/runs/r01/done && grep -q '"end_time": 0.2,' ends/runs/r02/done ||
    fail "not each its own end: $(grep -h end_time ends/runs/*/done)"
sed -i 's/^#include.*times"/endTime 2;/' cavity/system/controlDict
rm cavity/constant/times cavity/system/simulationParameters

# The folder of the first time is found by its value, whatever timeFormat calls it
echo 'timeFormat scientific;' >> cavity/system/controlDict
runs m4gn campaign init cavity --out named --parameter Ulid=1,1.1 --parameter n=20
quantity named 'start = "nearest"'
runs m4gn campaign run --store named
expect_log 'from nearest r0[12],'
sed -i '/^timeFormat /d' cavity/system/controlDict

# A flow that repeats itself: runs between others start from the cycles of these
# shellcheck disable=SC2016  # names of OpenFOAM
sed -i 's/lid { .*/lid { type uniformFixedValue; uniformValue sine; uniformValueCoeffs { frequency 4; amplitude 0.5; scale ($Ulid 0 0); level ($Ulid 0 0); } value $internalField; }/' \
    cavity/0/U
runs m4gn campaign init cavity --out cycles --parameter Ulid=0.5,1,1.5,2,2.5 --parameter n=20
quantity cycles
# Five periods
sed -i 's/^min_time = .*/min_time = 1.3/' cycles/campaign.toml
runs m4gn campaign run --store cycles
runs m4gn campaign report --store cycles
[ "$(awk -F, '$(NF - 3) ~ /^cycle r0/ { print $1 }' cycles/results.csv | xargs)" = "r02 r04" ] ||
    { cat cycles/results.csv; fail "r02 and r04 are not the runs that began from cycles"; }
# The first one went on for the states of its cycle
[ -f cycles/runs/r03/case/log.states ] || fail "r03 has not gone on for a period"
grep -q 'format *binary' cycles/runs/r03/case/[1-9]*/U || fail "r03 has stored no states in binary"
grep -q '"sister": ".*r03' cycles/runs/r02/done || { cat cycles/runs/r02/done; fail "r02 has nothing of r03"; }
by_itself 1
plain=$(awk '!/^#/ && $1 > 1 { sum += $2; ++n } END { print sum/n }' postProcessing/mean/0/volFieldValue.dat)
cd ..
below "$(off "$(value cycles r02)" "$plain")" 0.002 "mean speed of r02 against a run by itself"
[ -z "$(find cycles/runs -name m4gnCampaign.state)" ] || fail "series are kept with states that no run goes on from"
# Starts that have not paid are not taken again: r06 is cold, and told why
for record in cycles/runs/*/done; do
    grep -q '"kind": "cold"' "$record" || sed -i 's/"solver": .*/"solver": 99,/' "$record"
done
echo r06,3.5,20 >> cycles/parameters.csv
runs m4gn campaign run --store cycles
expect_log 'r06 .* from cold (cycle took [0-9.e+]* of a cold run, nearest took [0-9.e+]* of a cold run)'
runs m4gn campaign status --store cycles
expect_log 'r06 .*cold.*nearest took'

# A run whose solver does not go on behind its end has its answer all the same
{ echo '#!/bin/bash'; echo '[ ! -e ran ] || exit 1'; echo 'touch ran; exec icoFoam > /dev/null'; } > cavity/once
chmod +x cavity/once
runs m4gn campaign init cavity --out once --parameter Ulid=1 --parameter n=20
quantity once
sed -i 's/^min_time = .*/min_time = 1.3/; s/^solver = .*/solver = [".\/once"]/' once/campaign.toml
runs m4gn campaign one r01 --store once
expect_log '^r01: speed .*its cycle cannot be taken'

# A run whose solver fails from a sister's state is made from its own fields, and says so
{ echo '#!/bin/bash'; echo '! grep -q nonuniform 0/U || exit 1'; echo 'exec icoFoam > /dev/null'; } > cavity/own
chmod +x cavity/own
runs m4gn campaign init cavity --out fallback --parameter Ulid=1,1.1 --parameter n=20
quantity fallback 'start = "nearest"'
sed -i 's/^solver = .*/solver = [".\/own"]/' fallback/campaign.toml
runs m4gn campaign run --store fallback
expect_log 'r02 .*from cold (from nearest r01 there is no answer: .*log.own: own failed'
grep -q '"tried": "nearest"' fallback/runs/r02/done || fail "the start in vain is not kept: $(cat fallback/runs/r02/done)"

# A time that Allrun.pre leaves is none of a run's, and none that init's check begins at
printf '#!/bin/sh\nblockMesh\ncp -r 0 5\n' > cavity/Allrun.pre
chmod +x cavity/Allrun.pre
sed -i 's/^startFrom .*/startFrom latestTime;/' cavity/system/controlDict
runs m4gn campaign init cavity --out left --parameter Ulid=1 --parameter n=20
expect_silence 'begins at its end'

# A run's end is that of the controlDict that prepare leaves
printf '#!/bin/sh\nblockMesh\nsed -i "s/^endTime .*/endTime 0.1;/" system/controlDict\n' > cavity/Allrun.pre
runs m4gn campaign init cavity --out sooner --parameter Ulid=1 --parameter n=20
quantity sooner 'stop = false'
sed -i 's/^min_time = .*/min_time = 0/' sooner/campaign.toml
runs m4gn campaign run --store sooner
grep -q '"end_time": 0.1,' sooner/runs/r01/done || fail "not the end of prepare: $(grep end_time sooner/runs/r01/done)"
