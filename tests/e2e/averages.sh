#!/usr/bin/env bash
# Takes minutes.
# m4gnAverages: a run in a pulsating flow ends when the mean and the rms of the drag are known, with figures that a longer run's lie within;
# it carries on from any write time, after a kill too, and not from series that are damaged; two ranks end as one; errors are told by entry; a steady
# solver's values that settle are known. dmd.sh has the means of a run with a surrogate.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 2.5 writeInterval 0.25
set_entries system/fvSolution tolerance 1e-7 relTol 0.05
foamDictionary -entry boundaryField.inlet 0/U -set \
    '{ type uniformFixedValue; uniformValue { type sine; frequency 10; amplitude 0.3; scale (1 0 0); level (1 0 0); } }' \
    > log.inlet || fail "the pulsating inlet: $(cat log.inlet)"

# averages ENTRIES: forceCoeffs and m4gnAverages with these entries beside quantities, behind what is in $beside
averages() {
    cat > system/functions <<EOD
${beside:-}
forces
{
    type forceCoeffs; libs (forces); patches (cylinder);
    rho rhoInf; rhoInf 1; CofR (0.31 0.212 0); liftDir (0 1 0); dragDir (1 0 0); pitchAxis (0 0 1);
    magUInf 1; lRef 0.104; Aref 0.00104; log no;
}
averages
{
    type            m4gnAverages;
    libs            (m4gnAverages);
    quantities
    {
        Cd  { functionObject forces; result Cd; relative 0.01; }
        Cd2 { functionObject forces; result Cd; statistic rms; relative 0.01; }
    }
    $1
}
EOD
}
last_time() { find . -maxdepth 1 -name '[0-9]*' -printf '%f\n' | sort -g | tail -n 1; }

# A longer run, told and not ended
averages ''
runs icoFoam
keep long postProcessing
[ "$(last_time)" = 2.5 ] || fail "the run without stop ended at $(last_time)"
grep -q 'm4gn: Cd .* +- .* (95 %), transient to .* s' log.run || fail "the log has no line of Cd"

# A run that ends a step behind the first check that finds it within its tolerance does not know it
known=$(grep '^m4gn: Cd[: ]' log.run | grep -n ', known$' | head -n 1 | cut -d: -f1)
once=$(rows ../long/postProcessing/averages/0/averages.dat | awk -v n="$known" 'NR == n - 1 { print $1 }')
[ -n "$once" ] || fail "the drag of the long run is not known"
clean_case
control endTime "$(calc "$once + $(foamDictionary -entry deltaT -value system/controlDict)")"
runs icoFoam
grep '^m4gn: Cd ' log.run | tail -n 1 | grep -q ', not known yet$' || fail "a second check of the same rows made the drag known"
control endTime 2.5

# Ended when both are known; others see that this is the end
clean_case
beside='test { type m4gnRecorder; libs (m4gnFoam); timeEnd 0.1; writeControl timeStep; writeInterval 10; }'
averages 'stop yes; minTime 0.5;'
echo 'last { type fieldMinMax; libs (fieldFunctionObjects); fields (p); executeControl onEnd; writeControl onEnd; log no; }' >> system/functions
runs icoFoam
[ -f postProcessing/test/0/trajectory.h5 ] || fail "the recording to 0.1 has not got its name"
[ "$(rows postProcessing/last/0/fieldMinMax.dat | wc -l)" = 1 ] || fail "what is executed at the end was not executed once"
unset beside
averages 'stop yes; minTime 0.5;'
end=$(last_time)
holds "$end < 2.2 && $end >= 0.5" "the end of the run:"
grep -q 'all figures of averages are known' log.run || fail "the log does not say that all is known"
for of in 'Cd mean half_width' 'Cd2 rms rms_half_width'; do
    read -r name key half <<< "$of"
    holds "($(figure . "$name" "$key") - $(figure ../long "$name" "$key"))^2 <= ($(figure . "$name" "$half") + $(figure ../long "$name" "$half"))^2" \
        "$name, within its interval of the longer run's:"
done
# The command finds the same in the table of forceCoeffs
m4gn averages postProcessing/forces/0/coefficient.dat --column Cd --json cd.json > log.averages ||
    fail "m4gn averages: $(cat log.averages)"
[ "$(json cd.json 'round(d["frequency"], 1)')" = 10.0 ] || fail "expected the inlet's frequency: $(cat cd.json)"
# Post-processing leaves the figures of the run as they are
cp postProcessing/averages/0/averages.json ../known.json
runs icoFoam -postProcess
cmp ../known.json postProcessing/averages/0/averages.json || fail "post-processing wrote figures over those of the run"

# Carried on from a write time in the middle: as without the interruption
rm -rf postProcessing "$end"
control startFrom latestTime
runs icoFoam
expect_log 'carries on with the series of'
[ "$(last_time)" = "$end" ] || fail "carried on, the run ended at $(last_time), and not at $end"

# From series that are damaged it does not
rm -rf postProcessing "$end"
printf '\x2a' | dd of="$(last_time)/uniform/averages.state" bs=1 seek=1000 conv=notrunc status=none
control endTime "$(calc "$(last_time) + 0.02")"
runs icoFoam
expect_log 'averages begins anew: .*averages.state: expected series of m4gnAverages, found a file that is damaged'

# Nor from those of a later time whose folder was renamed
mv 0 begin
cp -r 0.25 0
control startFrom startTime endTime 0.02
runs icoFoam
expect_log 'averages begins anew: .*0/uniform/averages.state: has series up to time 0.2'
rm -r 0
mv begin 0

# Carried on after a kill: the table of the run without one
clean_case
averages ''
control startFrom startTime endTime 2.5 writeFormat binary
# It waits some steps behind 1.3 s, where nobody reads on
mkfifo ../said
icoFoam > ../said 2>&1 &
killed=$! line=
exec 3< ../said
until [[ $line == 'Time = 1.3'* ]]; do read -r line <&3 || fail "the run ended before it was killed"; done
kill -9 $killed
wait $killed || true
exec 3<&-
control startFrom latestTime
runs icoFoam
expect_log 'carries on with the series of'
from=$(find postProcessing/averages -mindepth 1 -name '[1-9]*' -printf '%f\n')
rows "postProcessing/averages/$from/averages.dat" > ../carried.dat
[ "$(wc -l < ../carried.dat)" -gt 1 ] || fail "no checks after the kill"
same_rows "$(rows ../long/postProcessing/averages/0/averages.dat | awk -v from="$from" '$1 > from')" "$(cat ../carried.dat)"
control startFrom startTime writeFormat ascii

# Two ranks end as one; to wider tolerances, as their steps take long
clean_case
averages 'stop yes; minTime 0.5; quantities { Cd { relative 0.05; } Cd2 { relative 0.05; } }'
solve 2
holds "$(foamListTimes -processor -latestTime) < 2.2" "the end of the run on two ranks:"
grep -q 'all figures of averages are known' log.run || fail "two ranks know less than one"

# So do two ranks whose files are in one folder, which carry on; values that are published seldom count once; the series are kept whatever writeControl says
clean_case
control endTime 0.2 writeInterval 0.1 writeFormat binary
seldom='pMax { functionObject extremes; result max(p); }'
beside='extremes { type fieldMinMax; libs (fieldFunctionObjects); fields (p); writeControl timeStep; writeInterval 20; log no; }'
averages "writeControl timeStep; writeInterval 1000; quantities { $seldom }"
steps=$(calc "0.2/$(foamDictionary -entry deltaT -value system/controlDict)")
runs decomposePar -force -fileHandler collated
runs mpirun -np 2 icoFoam -parallel -fileHandler collated
expect_log "pMax: too few rows, $(calc "int($steps/20)")\$"
control startFrom latestTime endTime 0.3
runs mpirun -np 2 icoFoam -parallel -fileHandler collated
expect_log 'carries on with the series of .*0.2/uniform/averages.state' "pMax: too few rows, $(calc "int(1.5*$steps/20)")\$"
# A run that is carried on waits for a result that its function object did not publish before
sed -i 's/fields (p);/fields (p U);/; s/result max(p)/result max(mag(U))/' system/functions
control startFrom startTime startTime 0.2
runs mpirun -np 2 icoFoam -parallel -fileHandler collated
expect_log 'averages waits for extremes, which has published other results alone so far: .*max(p)' "pMax: too few rows, $((steps/40))\$"
sed -i 's/fields (p U);/fields (p);/; s/result max(mag(U))/result max(p)/' system/functions
control startTime 0
# What is published no more adds nothing
sed -i 's/writeInterval 20;/writeInterval 1; timeEnd 0.2;/' system/functions
control startFrom startTime endTime 0.3
runs mpirun -np 2 icoFoam -parallel -fileHandler collated
[ "$(figure . pMax rows)" = "$steps" ] || fail "rows behind timeEnd: $(figure . pMax rows), expected $steps"
control startFrom latestTime
# Not the series of another quantity that has the same name
control endTime 0.4
beside= averages ''
sed -i 's/result Cd/result Cl/' system/functions
runs mpirun -np 2 icoFoam -parallel -fileHandler collated
expect_log 'begins anew: .*0.3/uniform/averages.state: has series of other quantities'
# What has kept its first value may be what the flow has not reached: it ends a run behind minTime alone
clean_case
control startFrom startTime endTime 0.1 writeInterval 0.1 writeFormat ascii
beside='extremes { type fieldMinMax; libs (fieldFunctionObjects); fields (U); log no; }'
still='stop yes; quantities { still { functionObject extremes; result min(mag(U)); tolerance 1; } }'
averages "$still"
sed -i '/^ *Cd2* /d' system/functions
runs icoFoam
[ "$(last_time)" = 0.1 ] || fail "a value that has not varied ended the run at $(last_time)"
expect_log 'still 0.000000 .*has kept its first value, not known yet$'
clean_case
averages "$still minTime 0.05;"
sed -i '/^ *Cd2* /d' system/functions
runs icoFoam
holds "$(last_time) >= 0.05 && $(last_time) < 0.08" "the end of a run with a value that does not vary and minTime:"
# The same value counts as often as it is published
clean_case
sed -i 's/fields (U);/& writeControl timeStep; writeInterval 2;/' system/functions
runs icoFoam
holds "$(last_time) >= 0.05 && $(last_time) < 0.1" "the end of a run with a value that is published seldom and does not vary:"
# A result that an edit of its function object ends adds nothing, though it is there for the others to see
clean_case
beside='inlet { type surfaceFieldValue; libs (fieldFunctionObjects); regionType patch; name inlet; operation average; fields (p); writeFields no; log no; }
edit { type timeActivatedFileUpdate; libs (utilityFunctionObjects); fileToUpdate "<system>/functions"; timeVsFile ((0 "<system>/before") (0.05 "<system>/after")); }'
averages 'quantities { pIn { functionObject inlet; result average(inlet,p); } }'
cp system/functions system/before
sed 's/fields (p);/fields (U);/' system/functions > system/after
control runTimeModifiable yes
echo 'OptimisationSwitches { fileModificationSkew 0; }' >> system/controlDict
touch -d '1 hour ago' system/*
runs icoFoam
published=$(awk '/^# Time/ { ++headers } !/^#/ && headers == 1' postProcessing/inlet/0/surfaceFieldValue.dat | wc -l)
[ "$(figure . pIn rows)" = "$published" ] || fail "rows behind the edit: $(figure . pIn rows), expected $published"
[ "$published" -lt "$(figure . Cd rows)" ] || fail "the edit was not read"
control runTimeModifiable no
control endTime 2.5 writeInterval 0.25
unset beside

# ill_formed WORDS ENTRIES
ill_formed() {
    clean_case
    averages "$2"
    icoFoam > log.refused 2>&1 && fail "accepted: $2"
    tr -s ' \n' ' ' < log.refused | grep -q "$1" || { tail -n 20 log.refused; fail "expected '$1' of: $2"; }
}
ill_formed 'Unknown entry toleranse' 'toleranse 1;'
ill_formed 'Entry confidence of .*expected a number between 0 and 1' 'confidence 95;'
ill_formed 'Entry stop of .*expected tolerance or relative of a quantity' 'stop yes; #remove quantities
    quantities { Cd { functionObject forces; result Cd; } }'
ill_formed 'Entry checkInterval of .* is 0; expected at least 1' 'checkInterval 0;'
ill_formed 'Entry statistic of .*expected mean or rms' 'quantities { Cd { functionObject forces; result Cd; statistic median; } }'
ill_formed 'Quantity time of .*expected another name' 'quantities { time { functionObject forces; result Cd; } }'
ill_formed "Quantity 'mean Cd' of .*expected a name without spaces" 'quantities { "mean Cd" { functionObject forces; result Cd; } }'
ill_formed 'Entry relative of .*expected a positive number' 'quantities { Cd { relative -1; } }'
ill_formed 'expected one of them, found both' 'quantities { Cd { tolerance 1; } }'
ill_formed 'Cd of forces is a scalar Expected a scalar without component' 'quantities { Cd { component x; } }'
ill_formed 'of functionObject force, which this run has not' 'quantities { Cd { functionObject force; result Cd; } }'
ill_formed 'publishes no Cx It publishes: ' 'quantities { Cd { functionObject forces; result Cx; } }'

# Behind timeEnd OpenFOAM does not tell it of the run's end: the last figures are of all rows before
control endTime 0.08
for end in 0.062 0.064; do
    clean_case
    averages "timeEnd $end;"
    runs icoFoam
    counted=$(rows postProcessing/forces/0/coefficient.dat | awk -v end=$end '$1 < end + 1e-6' | wc -l)
    [ "$(figure . Cd rows)" = "$counted" ] || fail "rows up to timeEnd: $(figure . Cd rows), expected $counted"
done

# Each column has a name of its own, that of an rms beside a quantity that is called so too
clean_case
control endTime 0.02
averages 'quantities { Cd_rms { functionObject forces; result Cd; statistic rms; } }'
runs icoFoam
columns=$(head -n 1 postProcessing/averages/0/averages.dat | tr '\t' '\n')
[ -z "$(sort <<< "$columns" | uniq -d)" ] || fail "columns of one name: $columns"
grep -qx 'Cd:rms_half_width' <<< "$columns" || fail "no rms of Cd: $columns"

# A steady solver's values settle, and are known
cd "$work"
make_case steady endTime 1000 deltaT 1 writeControl timeStep writeInterval 1000
set_entries system/fvSolution tolerance 1e-9 relTol 0.05
laminar 0.02
control application simpleFoam
sed -i 's/default *Euler;/default steadyState;/' system/fvSchemes
echo 'SIMPLE { consistent yes; } relaxationFactors { equations { U 0.9; } }' >> system/fvSolution
averages 'stop yes;'
sed -i '/Cd2/d' system/functions
runs simpleFoam
expect_log 'm4gn: Cd .*, known$'
holds "$(last_time) < 1000" "iterations until the drag is known"
known=$(figure . Cd mean) half=$(figure . Cd half_width)
averages ''
control startFrom latestTime
runs simpleFoam
settled=$(awk 'END { print $2 }' postProcessing/forces/[1-9]*/coefficient.dat)
holds "($known - $settled)^2 <= $half^2" "the drag $settled of 1000 iterations is within $half of $known:"
