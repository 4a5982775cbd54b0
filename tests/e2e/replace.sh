#!/usr/bin/env bash
# m4gnSurrogate, mode replace: the times of a run, two ranks against one, the solvers and time schemes.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case

# From 0.02: two steps of 0.01 at a time, five of the solver in between
function_object m4gnSurrogate "mode replace; model \"$small_model\"; timeStart 0.02; solverSteps 5; surrogateSteps 2;"
drag forces >> system/functions
runs icoFoam
table=postProcessing/test/0/surrogate.dat
[ "$(grep -vc '^#' $table)" -eq 1 ] || { cat $table; fail "expected one jump"; }
grep -q '^m4gn: replacedFraction = 0.5 ' log.run || fail "expected half of 0.02 to 0.06 to be replaced"
# The flux is handed back free of divergence
below "$(awk '!/^#/ { print $6 }' $table)" 1e-7 "divergence of the flux, 1/s"
for time in 0.01 0.02 0.03 0.04 0.05 0.06; do [ -f $time/U ] || fail "nothing was written at $time"; done
# Ten steps, the surrogate's two, ten more, and each only once
times=$(awk '!/^#/ { print $1 }' postProcessing/forces/0/coefficient.dat)
[ "$(wc -l <<< "$times")" -eq 22 ] || { echo "$times"; fail "expected forces at 22 times"; }
[ -z "$(sort <<< "$times" | uniq -d)" ] || fail "forces were computed twice at one time"
[ -f 0/m4gnSegment ] || fail "no 0/m4gnSegment"
mkdir ../serial && cp -r 0.* ../serial

# Two ranks, segments computed there and segments handed over
for segments in computed stored; do
    [ $segments = stored ] && keep=0/m4gnSegment || keep=
    cp 0/m4gnSegment 0/m4gnSegmentDict .. 2> /dev/null || true
    clean_case
    [ -z "$keep" ] || cp ../m4gnSegment ../m4gnSegmentDict 0
    on_two_ranks icoFoam
    [ -z "$keep" ] || grep -q 'segments read from 0/m4gnSegment' log.run || fail "the segments were not read"
    runs reconstructPar
    for time in 0.03 0.04; do
        for field in U p; do
            below "$(difference ../serial/$time/$field $time/$field)" 1e-4 "$field at $time, 2 ranks, segments $segments"
        done
    done
done

# A network on coarser graphs (`random_model FILE 1 levels`), on one rank and on two
mv system/functions ..
function_object m4gnSurrogate "mode replace; model \"$M4GN_HOME/tests/e2e/levels.safetensors\"; timeStart 0.02; solverSteps 5; surrogateSteps 2;"
clean_case
runs icoFoam
grep -q '^m4gn: replacedFraction = 0.5 ' log.run || fail "the network on coarser graphs replaced nothing"
rm -r ../serial && mkdir ../serial && cp -r 0.* ../serial
clean_case
on_two_ranks icoFoam
runs reconstructPar
for field in U p; do below "$(difference ../serial/0.04/$field 0.04/$field)" 1e-4 "$field at 0.04, 2 ranks, coarser graphs"; done
mv ../functions system

# The other solvers, and second order in time
echo 'FoamFile { version 2.0; format ascii; class dictionary; object x; } simulationType laminar; transportModel Newtonian; nu 1e-3;' |
    tee constant/turbulenceProperties > constant/transportProperties
sed -i 's/div(phi,U).*/div(phi,U) Gauss linear; div((nuEff*dev2(T(grad(U))))) Gauss linear;/' system/fvSchemes
sed -i 's/^PISO/PIMPLE { nCorrectors 2; nOuterCorrectors 1; }\nPISO/; s/^    U$/    "(U|UFinal)"/' system/fvSolution
for solver in icoFoam pisoFoam pimpleFoam; do
    for scheme in Euler backward; do
        sed -i "/ddtSchemes/,/}/s/default .*/default $scheme;/" system/fvSchemes
        clean_case
        runs $solver
        grep -q '^m4gn: replacedFraction = 0.5 ' log.run || fail "$solver, $scheme: no time was replaced"
        [ -f 0.06/U ] || fail "$solver, $scheme did not come to its end"
        echo "$solver, $scheme: came to its end"
    done
done

# Time steps that the solver adjusts
clean_case
sed -i 's/^deltaT .*/deltaT 0.0005; adjustTimeStep yes; maxCo 0.8;/' system/controlDict
runs pimpleFoam
grep -q '^m4gn: jumped 2 steps' log.run || fail "pimpleFoam with adjustTimeStep did not jump"
echo "replace: passed"
