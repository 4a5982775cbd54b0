#!/usr/bin/env bash
# The error that handing over makes by itself: a surrogate that is always right (oracle.c) jumps, and the drag of the
# solver's next steps is compared with the run without it. Measured when this was written: 1 % on the first step
# without an error of the surrogate, 0.3 % with a smooth one of 0.02 m/s (32 % if the flux were not projected).
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_oracle
make_case case
: > any

sed -i 's/^endTime .*/endTime 1.35;/; s/^writeInterval .*/writeInterval 10;/' system/controlDict
forces=$(drag forces)
coefficients=postProcessing/forces/0/coefficient.dat

# error SCHEME ERROR: largest relative error of drag on the first, and on the fifth, step after the two jumps
error_of_drag() {
    join -j 1 <(awk '!/^#/ { printf "%.4f %s\n", $1, $2 }' ../full.dat) <(awk '!/^#/ { printf "%.4f %s\n", $1, $2 }' $coefficients) |
        awk '{ d = $3/$2 - 1; if (d < 0) d = -d; sub(/0+$/, "", $1)
               if ($1 == "1.102" || $1 == "1.252") { if (d > first) first = d }
               if ($1 == "1.11" || $1 == "1.26") { if (d > fifth) fifth = d } }
             END { print first + 0, fifth + 0 }'
}

for scheme in Euler backward; do
    sed -i "/ddtSchemes/,/}/s/default .*/default $scheme;/" system/fvSchemes
    clean_case
    function_object m4gnRecorder
    echo "$forces" >> system/functions
    runs icoFoam
    mv $coefficients ../full.dat

    for error in 0 0.02; do
        clean_case
        # 1 to 1.1, 25 steps to 1.15, to 1.25, 25 steps to 1.3
        function_object m4gnSurrogate 'mode replace; model any; timeStart 1; solverSteps 25; surrogateSteps 2;'
        echo "$forces" >> system/functions
        ORACLE_ERROR=$error runs icoFoam
        [ "$(grep -c '^m4gn: jumped 2 steps' log.run)" -eq 2 ] || fail "expected two jumps of two steps"
        read -r first fifth <<< "$(error_of_drag)"
        below "$first" 0.03 "$scheme, velocity error $error m/s: drag error on the first step"
        below "$fifth" 0.02 "$scheme, velocity error $error m/s: drag error on the fifth step"
        awk "BEGIN { exit !($first > 0) }" || fail "the steps after the jumps were not found"
    done
done
# A model without a pressure: it is solved for from the velocity, at the times of the surrogate that others look at as well
drag_of_jumps() {
    join -j 1 <(awk '!/^#/ { printf "%.4f %s\n", $1, $2 }' ../full.dat) <(awk '!/^#/ { printf "%.4f %s\n", $1, $2 }' $coefficients) |
        awk '{ d = $3/$2 - 1; if (d < 0) d = -d; sub(/0+$/, "", $1)
               if ($1 == "0.25" || $1 == "0.3" || $1 == "0.4" || $1 == "0.45") { n++; if (d > worst) worst = d } }
             END { print n + 0, worst + 0 }'
}
clean_case
function_object m4gnRecorder 'fields (U);'
runs icoFoam
for pressure in '' 'projection { pressure predicted; }'; do
    clean_case
    function_object m4gnSurrogate "mode replace; model any; timeStart 0.2; timeEnd 0.5; solverSteps 25; surrogateSteps 2; $pressure"
    echo "$forces" >> system/functions
    runs icoFoam
    read -r times worst <<< "$(drag_of_jumps)"
    [ "$times" -eq 4 ] || fail "$times times of the surrogate with forces, expected 4"
    case $pressure in
        '') below "$worst" 0.02 "drag error at the surrogate's times, pressure solved" ;;
        *) below 0.03 "$worst" "least drag error at the surrogate's times with the pressure of the last solved time ($worst)" ;;
    esac
done
clean_case
function_object m4gnSurrogate 'mode replace; model any; timeStart 1; solverSteps 25; surrogateSteps 2; projection { pressure guessed; }'
refused 'pressure: expected solved or predicted, found guessed' icoFoam
sed -i 's/guessed/solved/' system/functions
echo 'transportModel CrossPowerLaw;' >> constant/transportProperties
refused 'transportProperties has no constant viscosity nu' icoFoam
echo "hand-over: passed"
