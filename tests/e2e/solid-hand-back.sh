#!/usr/bin/env bash
# solidDisplacementFoam: an error of the surrogate that differs from cell to cell is smoothed before the solver takes over; jumps after which
# the solver stops at its cap of correctors become shorter.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_oracle
make_beam case
export ORACLE_STRIDE=0.025 ORACLE_FRAMES=5
beside='gradient { type grad; libs (fieldFunctionObjects); field D; executeControl timeStep; writeControl writeTime; }
    rates { type writeObjects; libs (utilityFunctionObjects); objects (ddt(D)); writeOption anyWrite; writeControl writeTime; }'

# from_start [ENTRIES]: the solver from 0.1, where start-up is over, to 0.15, the surrogate to 0.2, the solver to the end
from_start() {
    clean_case
    : > any
    cp -r ../full/0.1 .
    surrogate "mode replace; model any; solverSteps 10; surrogateSteps 2; $*"
}
jumps() { from_start "$@" && solve; }
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

# measure WHAT: of a jump
measure() {
    correctors=$(sum) excess=$(excess) first=$(difference ../full/0.2/D 0.2/D) next=$(difference ../full/0.205/D 0.205/D)
    echo "rough error $1, smoothing $2 correctors $(after), energy too large by $excess, D off by $first $next" \
        "$(difference ../full/0.255/D 0.255/D) at 0.2, 0.205, 0.255"
}
# less A B SHARE WHAT: A is at most that share of B
less() { awk "BEGIN { exit !($1 <= $3*$2) }" || fail "$4: $1 with smoothing, $2 without, expected at most $3 of it"; }
# The recorded run without jumps, in the form of the normal stress that hardly sees what changes from cell to cell, in which roughness costs most
stress no 500 2e-5
record 'fields (D ddt(D)); writeControl timeStep; writeInterval 1;'
keep full 0.*
control startTime 0.1

# The solver's own states: what they have of roughness goes as well, and the solver makes it anew
jumps 'smoothing none;'
measure 0 'none;'
exact=$correctors
below "$first" 0 'the recorded D, without smoothing'
# What the solver writes at its own times is written at the surrogate's
close_to ../full 5e-3 0.2/{sigma,sigmaEq}
jumps
measure 0 '{ length 2; }'
below "$first" 2e-3 'the recorded D, smoothed'
below "$excess" 5e-3 'energy of the recorded state, smoothed, too large by'
below "$(calc "$correctors/$exact")" 1.6 'correctors of the five steps after the recorded state, smoothed, over those without'
close_to ../full 2e-3 0.2{05,25,55}/D
[ "$(entry jumps_watched)" = 1 ] && [ "$(entry jumps_to_the_cap)" = 0 ] || fail "expected one jump that was watched, and no cap"
holds "(5*$(entry correctors_after) - $correctors)^2 < 1e-6" "correctors_after is not the mean of '$(after)':"

# An error of 1 % from cell to cell
export ORACLE_ROUGH=0.01
jumps 'smoothing none;'
measure 0.01 'none;'
rough=$correctors roughExcess=$excess roughFirst=$first roughNext=$next
holds "$rough > 5*$exact" "or the test shows nothing:"
jumps 'smoothing { length 2; }'
measure 0.01 '{ length 2; }'
less "$correctors" "$rough" 0.5 'correctors of the five steps after a rough error'
less "$excess" "$roughExcess" 0.05 'energy too large by'
less "$first" "$roughFirst" 0.75 'error of D at the hand-over'
less "$next" "$roughNext" 0.6 'error of D a step later'
keep serial 0.2 0.255

# The same on two ranks, up to the tolerance of the solver: as far off as the recordings, of which the oracle's ranks have their own
from_start 'smoothing { length 2; }'
mv system/functions ../functions
recorder 'fields (D ddt(D)); writeControl timeStep; writeInterval 1;'
runs decomposePar -force -time 0.1
keep start processor0 processor1
runs mpirun -np 2 solidDisplacementFoam -parallel
runs reconstructPar -time 0.2 -fields '(D)'
recordings=$(difference ../full/0.2/D 0.2/D)
rm -rf 0.2 processor0 processor1 && cp -r ../start/processor? . && cp ../functions system/functions
# To the five steps behind the jump
control endTime 0.23
runs mpirun -np 2 solidDisplacementFoam -parallel
[ -n "$(after)" ] || fail "no jump on two ranks"
echo "correctors on two ranks: $(after)"
runs reconstructPar -time 0.2 -fields '(D)'
below "$(difference ../serial/0.2/D 0.2/D)" "$(awk "BEGIN { print 1.1*$recordings }")" \
    "smoothed D on two ranks, recordings $recordings apart"
control endTime 0.255

# Jumps after which the solver stops at its cap become shorter, and then there are none. So with a run that is carried on.
set_entries system/fvSolution nCorrectors 300
capped() {
    expect_log 'stopped at its cap of 300 correctors after a jump of 2 steps: the next jumps have 1 at most' \
        'stopped at its cap of 300 correctors (nCorrectors) up to time .*, after a jump of one step'
    [ "$(entry jumps) $(entry surrogate_steps) $(entry jumps_to_the_cap)" = '2 3 2' ] || fail "expected a jump of two steps and one of one"
}
jumps 'smoothing none; solverSteps 5;'
capped
cp -r 0.19 ..
# Its fourth step after the jump of two
clean_case
cp -r ../0.19 . && control startTime 0.19
cat log.run > ../log.first
solve
expect_log 'goes on from its state at time 0.19'
cat ../log.first >> log.run
capped
control startTime 0.1
jumps 'solverSteps 5;'
[ "$(entry surrogate_steps) $(entry jumps_to_the_cap)" = '4 0' ] || fail "with smoothing a jump was found too long"

# What is wrong is found before the run begins
clean_case && cp -r ../full/0.1 .
expect_errors <<'EOD'
mode replace; model any; solverSteps 10; surrogateSteps 2; smoothing { length 0; } => is 0 cells; expected more than 0
mode replace; model any; solverSteps 10; surrogateSteps 2; smoothing { length 0; } => To hand over what was predicted: smoothing none
mode replace; model any; solverSteps 10; surrogateSteps 2; smoothing { width 2; } => Unknown entry width in .*smoothing
EOD
