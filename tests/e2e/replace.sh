#!/usr/bin/env bash
# m4gnSurrogate, mode replace: the times of a run, two ranks against one, the solvers and time schemes.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
half='^m4gn: replacedFraction = 0.5 '

# From 0.02: two steps of 0.01 at a time, five of the solver in between
beside=$(drag forces)
ride "$jump"
table=postProcessing/test/0/surrogate.dat
[ "$(grep -vc '^#' $table)" -eq 1 ] || { cat $table; fail "expected one jump"; }
expect_log "$half"
# The flux is handed back free of divergence
below "$(awk '!/^#/ { print $6 }' $table)" 1e-7 "divergence of the flux, 1/s"
for time in 0.01 0.02 0.03 0.04 0.05 0.06; do [ -f $time/U ] || fail "nothing was written at $time"; done
# Ten steps, the surrogate's two, ten more, and each only once
times=$(awk '!/^#/ { print $1 }' postProcessing/forces/0/coefficient.dat)
[ "$(wc -l <<< "$times")" -eq 22 ] || { echo "$times"; fail "expected forces at 22 times"; }
[ -z "$(sort <<< "$times" | uniq -d)" ] || fail "forces were computed twice at one time"
[ -f 0/m4gnSegment ] || fail "no 0/m4gnSegment"
keep serial 0.03 0.04

# Two ranks, segments computed there and segments handed over
for segments in computed stored; do
    cp 0/m4gnSegment 0/m4gnSegmentDict .. 2> /dev/null || true
    clean_case
    [ $segments = computed ] || cp ../m4gnSegment ../m4gnSegmentDict 0
    solve 2
    [ $segments = computed ] || expect_log 'segments read from 0/m4gnSegment'
    runs reconstructPar
    close_to ../serial 1e-4 0.0{3,4}/{U,p}
done

# A network on coarser graphs (`random_model FILE 1 levels`), on one rank and on two
unset beside
ride "${jump/"$small_model"/"$M4GN_HOME/tests/e2e/levels.safetensors"}"
expect_log "$half"
same_on_two_ranks 1e-4 0.04/{U,p}

# The other solvers, and second order in time
beside=$(drag forces)
laminar
sed -i 's/^PISO/PIMPLE { nCorrectors 2; nOuterCorrectors 1; }\nPISO/; s/^    U$/    "(U|UFinal)"/' system/fvSolution
for solver in pisoFoam pimpleFoam; do
    for scheme in Euler backward; do
        ddt_scheme $scheme
        control application $solver
        ride "$jump"
        expect_log "$half"
        [ -f 0.06/U ] || fail "$solver, $scheme did not come to its end"
        echo "$solver, $scheme: came to its end"
    done
done

# Time steps that the solver adjusts
control deltaT '0.0005; adjustTimeStep yes; maxCo 0.8'
ride "$jump"
jumped + 2
