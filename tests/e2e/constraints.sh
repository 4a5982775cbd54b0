#!/usr/bin/env bash
# Method m4gn with what decomposeParDict may ask for besides: processor weights, weight fields, cyclic patches, and
# constraints, which hold as with any method.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# A channel of 40 x 12 cells, cyclic from left to right, empty in z. Cell 40 j + i is in column i.
mkdir -p channel/0 channel/system channel/constant
cd channel
cp -r "$M4GN_HOME/tests/e2e/igloo/system" .
head="FoamFile { version 2.0; format ascii; class dictionary; object x; }"
echo 'libs (m4gnFoam);' >> system/controlDict
cat > system/topoSetDict << EOD
$head
actions
(
    { name belt; type faceSet; action new; source boxToFace; sourceInfo { box (1.99 -1 -1) (2.01 2 1); } }
    { name belt; type faceZoneSet; action new; source setToFaceZone; sourceInfo { faceSet belt; } }
    { name corner; type faceSet; action new; source boxToFace; sourceInfo { box (0.4 -0.01 -1) (0.9 0.01 1); } }
    { name other; type faceSet; action new; source boxToFace; sourceInfo { box (3.4 -0.01 -1) (3.9 0.01 1); } }
);
EOD
block '4 1.2 0.1' '40 12 1' 'left { type cyclic; neighbourPatch right; faces (LEFT); } right { type cyclic; neighbourPatch left; faces (RIGHT); }
    walls { type wall; faces (BOTTOM TOP); } sides { type empty; faces (BACK FRONT); }'
runs topoSet
printf 'type m4gnSegments; libs (m4gnFoam); recompute yes; segments { count 16; modes 4; }\n' > system/m4gnSegments

# dict NP ENTRIES...
dict() {
    local np=$1
    shift
    echo "$head numberOfSubdomains $np; method m4gn; $*" > system/decomposeParDict
}
decomposes() { dict "$@"; runs decomposePar -force -cellDist; }
refuses() { local text=$1; shift; dict "$@"; refused "$text" decomposePar -force; }

# No segment on two processors, and none without
whole() {
    paste <(values 0/m4gnSegment) <(values 0/cellDist) | sort -u | awk '
        $1 in rank { print "segment " $1 " on " rank[$1] " and " $2; exit 1 } { rank[$1] = $2 }' || fail "a segment is torn"
    [ "$(values 0/cellDist | sort -u | wc -l)" -eq "$(sed -n 's/.*numberOfSubdomains \([0-9]*\).*/\1/p' system/decomposeParDict)" ] ||
        fail "a processor is empty"
}
rank_of() { values 0/cellDist | awk -v cell="$1" 'NR == cell + 1'; }

rm -f 0/*
decomposes 4 'm4gnCoeffs { count 16; }'
whole
grep -q '16 segments computed' log.run || fail "the segments were not computed"
cp 0/m4gnSegment ../serial
# A cyclic that is cut becomes processorCyclic, and changes nothing
grep -q 'm4gn: 16 segments on 4 processors' log.run || fail "no report"
rm -f processor*/0/m4gnSegment 0/m4gnSegment
runs mpirun -np 4 postProcess -parallel -func m4gnSegments -time 0
cmp <(values ../serial) <(values 0/m4gnSegment) || fail "other segments on four ranks of a cyclic channel"
echo "cyclic channel: the same segments on four ranks"

decomposes 3 'm4gnCoeffs { processorWeights (2 1 1); }'
whole
values 0/cellDist | awk '{ ++n[$1] } END { r = n[0]/(n[0] + n[1] + n[2]); exit !(r > 0.42 && r < 0.58) }' ||
    fail "processorWeights were not followed"
# All the work in the left quarter
{
    sed '/^internalField/,$d' 0/m4gnSegment | sed 's/m4gnSegment/work/'
    echo 'internalField nonuniform List<scalar> 480 ('
    for _ in $(seq 12); do for i in $(seq 40); do if [ "$i" -le 10 ]; then echo 100; else echo 1; fi; done; done
    echo '); boundaryField { "(left|right)" { type cyclic; } walls { type zeroGradient; } sides { type empty; } }'
} > 0/work
decomposes 2 'weightField work;'
whole
paste <(values 0/work) <(values 0/cellDist) | awk '{ w[$2] += $1 } END { r = w[0]/w[1]; exit !(r > 0.6 && r < 1.6) }' ||
    fail "the weight field was not followed"
rm 0/work
echo "weights: followed"

decomposes 3 'constraints { keep { type preservePatches; patches (left right); } }'
for j in $(seq 0 11); do
    [ "$(rank_of $((40*j)))" = "$(rank_of $((40*j + 39)))" ] || fail "row $j: the cyclic patches are torn"
done
decomposes 3 'constraints { keep { type preserveFaceZones; zones (belt); } }'
for j in $(seq 0 11); do
    [ "$(rank_of $((40*j + 19)))" = "$(rank_of $((40*j + 20)))" ] || fail "row $j: the zone is torn"
done
decomposes 3 'constraints { keep { type singleProcessorFaceSets; sets ((corner 2) (other 0)); } }'
if [ "$(rank_of 6)" != 2 ] || [ "$(rank_of 36)" != 0 ]; then fail "the sets are not on their processors"; fi
decomposes 3 'constraints { keep { type singleProcessorFaceSets; sets ((belt -1)); } }'
[ "$(rank_of 19)" = "$(rank_of $((40*11 + 20)))" ] || fail "the set is on several processors"
echo "constraints: hold"

refuses 'segments.cuont: unknown entry' 3 'm4gnCoeffs { cuont 16; }'
refuses 'processorWeights has 2 entries' 3 'm4gnCoeffs { processorWeights (1 1); }'
refuses 'expected positive numbers' 3 'm4gnCoeffs { processorWeights (1 1 0); }'
refuses 'count is 16 there, and 12 is wanted' 3 'm4gnCoeffs { count 12; stored refuse; }'
refuses '16 segments for 17 subdomains' 17
rm 0/m4gnSegment
refuses '2 segments for 3 subdomains' 3 'm4gnCoeffs { count 2; }'
refuses 'segments.method: expected one of metis' 3 'm4gnCoeffs { method slick; }'
[ ! -e 0/m4gnSegment ] || fail "a refused decomposition left segments"
echo "bad input: refused"

# Baffles where the belt was: two faces in one place, and cells on both sides that must stay together
cat > system/createBafflesDict << EOD
$head
internalFacesOnly true;
baffles
{
    belt
    {
        type faceZone; zoneName belt;
        patches { master { name baffles; type wall; } slave { name baffles; type wall; } }
    }
}
EOD
runs createBaffles -overwrite
rm -f 0/*
decomposes 3 'm4gnCoeffs { count 16; } constraints { keep { type preserveBaffles; } }'
for j in $(seq 0 11); do
    [ "$(rank_of $((40*j + 19)))" = "$(rank_of $((40*j + 20)))" ] || fail "row $j: the baffle is torn"
done
echo "baffles: held together"
