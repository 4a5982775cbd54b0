#!/usr/bin/env bash
# m4gnSurrogate with surrogates (network dmd): the network jumps until a fit holds, then the fit; carried on; mode observe.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 4 writeInterval 0.25 writeFormat binary
set_entries system/fvSolution tolerance 1e-7 relTol 0.05
both='surrogates (network dmd); model cylinder-flow.safetensors; timeStart 2; dmd { snapshotInterval 0.05; }'
strides=postProcessing/test/0/strides.dat

# Observing leaves the run alone, and has errors of both
plain 4
ride "mode observe; $both rolloutSteps 10;"
same_bytes ../plain 4/{U,p,phi}
errors=postProcessing/test/0/surrogateError.dat
for who in network dmd; do
    awk -v who=$who '!/^#/ && $2 == who && $6 > 0 { ++n } END { exit n < 5 }' $errors || { cat $errors; fail "no rollouts of $who"; }
    decided "means of $who" "of('end', surrogate='$who')[0]['errors']['U']['rollout'] > 0"
done

# In the solver's place; a drag is held
beside=$(drag forces | sed 's/type forceCoeffs;/& timeStart 0.3;/')
grep -q 'timeStart 0.3' <<< "$beside" || fail "no drag that is published later: $beside"
held() { echo "mode replace; $both quantities ( { object $1; result $2; tolerance 0.5; } );"; }
ride "$(held forces Cd)"
decided "the drag at the end of a jump" "of('quantities')[0]['quantities'][0]['result'] == 'Cd'"
decided "who jumps" "of('jump_begun', surrogate='dmd') and of('stride', surrogate='dmd', decision='jumps')"
[ "$(entry quantities_judged)" -ge 1 ] && [ -n "$(entry worst_forces_Cd)" ] || fail "the summary does not tell of the drag"
below 0.2 "$(entry replaced_fraction)" "least that is replaced"
[ "$(entry jumps)" = $(($(entry jumps_network) + $(entry jumps_dmd))) ] || fail "jumps of both are not all jumps"
# A fit that holds goes before the network: there is one when the network may begin
awk '!/^#/ { if ($5 == "jumps") ++jumps[$2] } END { exit !jumps["dmd"] || jumps["network"] > jumps["dmd"] }' $strides ||
    { cat $strides; fail "the network jumps beside a fit"; }
held_drag() { echo "$(entry quantities_judged "$1") $(entry quantities_beyond "$1") $(entry worst_forces_Cd "$1")"; }
drags=$(held_drag 0)
keep whole [0-9]* postProcessing

# Carried on
carry_on 3.25
same_bytes ../whole 4/{U,p,phi}
[ "$(held_drag 3.25)" = "$drags" ] || fail "the drag is judged otherwise: $(held_drag 3.25), expected $drags"

# What is not there is named, and each of them needs its own
beside=$(drag forces)
control startTime 0 endTime 0.01
clean_case
expect_errors <<EOD
$(held forces Cq) => the result Cq of forces, which it does not have
$(held nobody Cd) => nobody, which is no other function object
mode replace; surrogates (network dmd); dmd { snapshotInterval 0.05; } => model
mode replace; surrogates (dmd dmd); => each once
EOD
