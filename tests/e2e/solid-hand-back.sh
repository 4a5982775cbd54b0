#!/usr/bin/env bash
# solidDisplacementFoam: an error of the surrogate that differs from cell to cell is smoothed before the solver takes over; jumps after which
# the solver stops at its cap of correctors become shorter.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_oracle
make_beam case
cp "$M4GN_HOME/openfoam/tutorials/beam/system/decomposeParDict" system

export ORACLE_STRIDE=0.025 ORACLE_FRAMES=5
others='gradient { type grad; libs (fieldFunctionObjects); field D; executeControl timeStep; writeControl writeTime; }
    rates { type writeObjects; libs (utilityFunctionObjects); objects (ddt(D)); writeOption anyWrite; writeControl writeTime; }'

# full COMPACT TOLERANCE: the recorded run without jumps
full() {
    clean_case
    sed -i "s/compactNormalStress.*;/compactNormalStress $1; nCorrectors 500; D $2;/; " system/fvSolution
    sed -i 's/^startTime .*/startTime 0;/' system/controlDict
    function_object m4gnRecorder 'fields (D ddt(D)); writeControl timeStep; writeInterval 1;'
    echo "$others" >> system/functions
    runs solidDisplacementFoam
    rm -rf ../full && mkdir ../full && mv 0.* ../full
    # What goes on from 0.1, where start-up is over
    sed -i 's/^startTime .*/startTime 0.1;/' system/controlDict
}
# surrogate ENTRIES...: the solver to 0.15, the surrogate to 0.2, the solver to the end
surrogate() {
    clean_case
    : > any
    cp -r ../full/0.1 .
    function_object m4gnSurrogate "mode replace; model any; solverSteps 10; surrogateSteps 2; $*"
    echo "$others" >> system/functions
}
# Correctors of the first five steps after the jump, and their sum
after() { sed -n 's/^m4gn: correctors .* after the jump: \(.*\); median.*/\1/p' log.run | head -n 1; }
sum() { after | awk '{ print $1 + $2 + $3 + $4 + $5 }'; }
# energy FOLDER: elastic and kinetic, of the cells (plane stress, E 1 MPa, nu 0.3, 1000 kg/m^3)
energy() {
    paste <(values "$1/grad(D)") <(values "$1/ddt(D)") | awk '
        { xy = ($2 + $4)/2
          e += 1e6/2.6*($1^2 + $5^2 + 2*xy^2) + 0.15e6/0.91*($1 + $5)^2 + 500*($10^2 + $11^2 + $12^2) }
        END { print e }'
}
excess() { awk "BEGIN { print $(energy 0.2)/$(energy ../full/0.2) - 1 }"; }

# The form of the normal stress that hardly sees what changes from cell to cell, in which roughness costs most
full no 2e-5
measure() {
    correctors=$(sum) excess=$(excess) first=$(difference ../full/0.2/D 0.2/D) next=$(difference ../full/0.205/D 0.205/D)
    echo "rough error $1, smoothing $2 correctors $(after), energy too large by $excess, D off by $first $next" \
        "$(difference ../full/0.255/D 0.255/D) at 0.2, 0.205, 0.255"
}
# less A B SHARE WHAT: A is at most that share of B
less() { awk "BEGIN { exit !($1 <= $3*$2) }" || fail "$4: $1 with smoothing, $2 without, expected at most $3 of it"; }

# The solver's own states: what they have of roughness goes as well, and the solver makes it anew
surrogate 'smoothing none;'
runs solidDisplacementFoam
measure 0 'none;'
exact=$correctors
below "$first" 0 'the recorded D, without smoothing'
# What the solver writes at its own times is written at the surrogate's
for field in sigma sigmaEq; do
    below "$(difference ../full/0.2/$field 0.2/$field)" 5e-3 "$field of the recorded state at the surrogate's time"
done
surrogate
runs solidDisplacementFoam
measure 0 '{ length 2; }'
below "$first" 2e-3 'the recorded D, smoothed'
below "$excess" 5e-3 'energy of the recorded state, smoothed, too large by'
below "$(awk "BEGIN { print $correctors/$exact }")" 1.6 'correctors of the five steps after the recorded state, smoothed, over those without'
for time in 0.205 0.225 0.255; do
    below "$(difference ../full/$time/D $time/D)" 2e-3 "D at $time after the recorded state, smoothed"
done
[ "$(entry jumps_watched)" = 1 ] && [ "$(entry jumps_to_the_cap)" = 0 ] || fail "expected one jump that was watched, and no cap"
awk -v mean="$(entry correctors_after)" -v sum="$correctors" 'BEGIN { d = 5*mean - sum; exit !(d*d < 1e-6) }' ||
    fail "correctors_after is not the mean of '$(after)'"

# An error of 1 % from cell to cell
export ORACLE_ROUGH=0.01
surrogate 'smoothing none;'
runs solidDisplacementFoam
measure 0.01 'none;'
rough=$correctors roughExcess=$excess roughFirst=$first roughNext=$next
# Or the test shows nothing
awk "BEGIN { exit !($rough > 5*$exact) }" || fail "the rough error costs $rough correctors in place of $exact only"
surrogate 'smoothing { length 2; }'
runs solidDisplacementFoam
measure 0.01 '{ length 2; }'
less "$correctors" "$rough" 0.5 'correctors of the five steps after a rough error'
less "$excess" "$roughExcess" 0.05 'energy too large by'
less "$first" "$roughFirst" 0.75 'error of D at the hand-over'
less "$next" "$roughNext" 0.6 'error of D a step later'
rm -rf ../serial && mkdir ../serial && cp -r 0.2 0.255 ../serial

# The same on two ranks, up to the tolerance of the solver: as far off as the recordings, of which the oracle's ranks have their own
surrogate 'smoothing { length 2; }'
mv system/functions ../functions
function_object m4gnRecorder 'fields (D ddt(D)); writeControl timeStep; writeInterval 1;'
runs decomposePar -force -time 0.1
mkdir ../start && cp -r processor0 processor1 ../start
runs mpirun -np 2 solidDisplacementFoam -parallel
runs reconstructPar -time 0.2 -fields '(D)'
recordings=$(difference ../full/0.2/D 0.2/D)
rm -rf 0.2 processor0 processor1 && cp -r ../start/processor? . && cp ../functions system/functions
runs mpirun -np 2 solidDisplacementFoam -parallel
[ -n "$(after)" ] || fail "no jump on two ranks"
echo "correctors on two ranks: $(after)"
runs reconstructPar -time 0.2 -fields '(D)'
below "$(difference ../serial/0.2/D 0.2/D)" "$(awk "BEGIN { print 1.1*$recordings }")" \
    "smoothed D on two ranks, recordings $recordings apart"

# Jumps after which the solver stops at its cap become shorter, and then there are none. So with a run that is carried on.
sed -i 's/nCorrectors 500/nCorrectors 300/' system/fvSolution
capped() {
    grep -q 'stopped at its cap of 300 correctors after a jump of 2 steps: the next jumps have 1 at most' log.run ||
        fail "the jump did not become shorter"
    grep -q 'stopped at its cap of 300 correctors (nCorrectors) up to time .*, after a jump of one step' log.run ||
        fail "there is no warning that the solver goes on alone"
    [ "$(entry jumps) $(entry surrogate_steps) $(entry jumps_to_the_cap)" = '2 3 2' ] || fail "expected a jump of two steps and one of one"
}
surrogate 'smoothing none;'
sed -i 's/solverSteps 10/solverSteps 5/' system/functions
runs solidDisplacementFoam
capped
cp -r 0.19 ..
# Its fourth step after the jump of two
clean_case
cp -r ../0.19 . && sed -i 's/^startTime .*/startTime 0.19;/' system/controlDict
cat log.run > ../log.first
runs solidDisplacementFoam
grep -q 'goes on from its state at time 0.19' log.run || fail "the run did not go on"
cat ../log.first >> log.run
capped
sed -i 's/^startTime .*/startTime 0.1;/' system/controlDict
surrogate
sed -i 's/solverSteps 10/solverSteps 5/' system/functions
runs solidDisplacementFoam
[ "$(entry surrogate_steps) $(entry jumps_to_the_cap)" = '4 0' ] || fail "with smoothing a jump was found too long"

# What is wrong is said before the run begins
while read -r entries; do
    text=${entries#*: } entries=${entries%%: *}
    surrogate "$entries"
    refused "$text" solidDisplacementFoam
done <<'EOD'
smoothing some;: Entry smoothing of .* is some; expected none, or smoothing { length 2; }
smoothing { length 0; }: is 0 cells; expected more than 0
smoothing { length 0; }: To hand over what was predicted: smoothing none
smoothing { width 2; }: Unknown entry width in .*smoothing
EOD
echo "solid-hand-back: passed"
