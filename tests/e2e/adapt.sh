#!/usr/bin/env bash
# m4gnSurrogate, adapt: with six times the viscosity of the training, on a coarser mesh, the shipped model learns the case from the
# solver's steps, and the hybrid run is nearer to the full one; two ranks agree with one; a restart is the uninterrupted run,
# also after the run was killed while the model learned.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
sed -i 's/1e-3/6e-3/' constant/transportProperties
sed -i 's/^endTime .*/endTime 1.15;/; s/^writeInterval .*/writeInterval 0.05;/' system/controlDict
runs icoFoam
mkdir ../full && cp -r [01].* ../full

# One stride of the solver, 0.05 s, before each jump of 0.25 s: from 0.5 to 0.75, from 0.8 to 1.05
surrogate() {
    function_object m4gnSurrogate "mode replace; model cylinder-flow.safetensors; timeStart 0.5; solverSteps 25; surrogateSteps 5;
        $*"
}
# error: root mean square of the difference of U from the full run at 0.75, in front of the first solver step
error() {
    paste <(values ../full/0.75/U) <(values 0.75/U) |
        awk '{ s += ($1-$4)^2 + ($2-$5)^2 } END { printf "%.12g", sqrt(s/(2*NR)) }'
}
# carried_on FROM TEXT WHAT: from the time FROM the run says TEXT and comes to the fields of ../whole at 1.05
carried_on() {
    local time
    for time in [01].*; do
        awk "BEGIN { exit !($time > $1) }" && rm -rf "$time"
    done
    rm -rf postProcessing
    sed -i "s/^startTime .*/startTime $1;/" system/controlDict
    runs icoFoam
    grep -q "$2" log.run || fail "$3: a run that is carried on does not say: $2"
    for field in U p; do
        below "$(difference ../whole/1.05/$field 1.05/$field)" 1e-4 "$field at 1.05, $3, restarted at $1"
    done
}
surrogate ''
clean_case
runs icoFoam
before=$(error)

clean_case
surrogate 'adapt { mode during; start 0.1; steps 150; stepsEach 4; threads 2; writeModel yes; }'
runs icoFoam
grep '^m4gn: adapted' log.run || { tail -n 20 log.run; fail "nothing was adapted"; }
[ "$(grep -c '^m4gn: adapted in' log.run)" -eq 2 ] || fail "expected two rounds"
after=$(error)
below "$after" "$(awk "BEGIN { print 0.9*$before }")" "error of U after the first jump, not adapted $before"
summary=postProcessing/test/0/summary.json
grep -q '"adapt_runs": 2,' $summary || { cat $summary; fail "the summary does not tell of the adaptation"; }
m4gn info postProcessing/test/0/adapted.safetensors > log.info || { cat log.info; fail "the adapted model cannot be read"; }
grep -q stride log.info || { cat log.info; fail "the adapted model is not described"; }
[ -f 0.75/uniform/test.state ] || fail "no state at 0.75"
mkdir ../whole && cp -r [01].* ../whole

# Carried on from the end of the first jump: weights, frames and random numbers are those of the uninterrupted run
carried_on 0.75 'goes on from its state at time 0.75' learned
# Killed while it learns: what is lost are the steps of that round, and the next run makes them
surrogate 'adapt { mode during; start 0.1; steps 1000000; stepsEach 4; threads 2; }'
clean_case
sed -i 's/^startTime .*/startTime 0;/' system/controlDict
: > log.killed
icoFoam > log.killed 2>&1 &
solver=$!
until grep -q '^Time = 0.5$' log.killed; do
    kill -0 $solver 2> /dev/null || { tail -n 20 log.killed; fail "the run that was to be killed has ended"; }
    sleep 0.1
done
sleep 2
kill -9 $solver
wait $solver 2> /dev/null || true
grep -q 'm4gn: adapted' log.killed && fail "the round was to be killed, and has ended"
[ -f 0.45/uniform/test.state ] || fail "no state at 0.45"
surrogate 'adapt { mode during; start 0.1; steps 150; stepsEach 4; threads 2; }'
carried_on 0.45 'goes on from its state at time 0.45' 'killed while it learned'
sed -i 's/^startTime .*/startTime 0.75;/' system/controlDict
# A damaged state is refused
cp 0.75/uniform/test.state ../state
printf 'damaged' > 0.75/uniform/test.state
refused 'is not the state of a run' icoFoam
sed -i 's/^startTime .*/startTime 0;/' system/controlDict

clean_case
# Observed, it learns before it is compared
function_object m4gnSurrogate "mode observe; model cylinder-flow.safetensors; timeStart 0.5; adapt { start 0.1; steps 10; }"
runs icoFoam
grep -q '^m4gn: adapted in' log.run || fail "mode observe: nothing was adapted"

# Before the first jump alone, on two ranks as on one
surrogate 'adapt { mode before; start 0.1; steps 20; precision fp32; }'
clean_case
runs icoFoam
mkdir ../serial && cp -r 0.75 ../serial
clean_case
on_two_ranks icoFoam
[ "$(grep -c '^m4gn: adapted in' log.run)" -eq 1 ] || fail "expected one round on two ranks"
runs reconstructPar -time 0.75
for field in U p; do
    below "$(difference ../serial/0.75/$field 0.75/$field)" 1e-3 "$field at 0.75, 2 ranks"
done

# What is wrong is said before the run begins
clean_case
surrogate 'adapt { method ridge; }'
refused 'unknown field `method`' icoFoam
surrogate 'adapt { mode later; }'
refused 'later' icoFoam
surrogate 'adapt { learning_rate 1; }'
refused 'learningRate' icoFoam
surrogate 'adapt { heldBack 2; }'
refused 'heldBack: found 2, expected' icoFoam
echo "adapt: passed"
