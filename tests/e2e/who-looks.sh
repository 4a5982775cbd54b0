#!/usr/bin/env bash
# Who looks at a run does not change it: the flow is the same for each write interval and with other function objects, and these see a flux
# that is conservative at each stride.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 0.9 writeFormat binary writePrecision 16
surrogate="surrogate { type m4gnSurrogate; libs (m4gnFoam); mode replace; model cylinder-flow.safetensors; timeStart 0.5; solverSteps 25;
    surrogateSteps 5; }"
# run NAME INTERVAL OTHERS...
run() {
    clean_case
    control writeInterval "$2"
    echo "$surrogate ${*:3}" > system/functions
    solve
    keep "$1" 0.9 postProcessing
}
flux() { echo "$1 { type surfaceFieldValue; libs (fieldFunctionObjects); fields (phi); operation sum; regionType patch; name $1; writeFields no; log no; }"; }
run often 0.05
run seldom 0.9
run seen 0.9 "$(flux inlet)" "$(flux outlet)"
for other in seldom seen; do (cd ../$other && same_bytes ../often 0.9/{U,p,phi}); done

sums() { grep -v '#' ../seen/postProcessing/"$1"/0/*.dat; }
below "$(paste <(sums inlet) <(sums outlet) | awk '
    $1 > 0.5 { off = ($2 + $4)/$2; off = off < 0 ? -off : off; if (off > most) most = off; ++n }
    END { print (n > 20 ? most : 1) }')" 1e-6 "largest imbalance of the flux"
