#!/usr/bin/env bash
# Takes minutes.
# The tutorials of docs/tutorials that need no solids4foam; tests/claims/vibrating-rubber.sh follows the other one.
. "$(dirname "${BASH_SOURCE[0]}")/_follow.sh"

# Behind the first jump of each surrogate
runs m4gn tutorial cylinder -- --repeats 1 --end 4.5
for kind in dmd network; do grep -q '^m4gn: jumped ' run/cylinder/$kind/log.icoFoam || fail "first-hybrid-run: $kind has not jumped"; done
follow first-hybrid-run
[ -s run/cylinder/loose/log.icoFoam ] || fail 'first-hybrid-run: there is no loose run'
# To wider tolerances, from the end of the full run, where the wake is developed
follow mean-with-interval 's/relative 0.005/relative 0.01/; s/relative 0.02/relative 0.05/; s/rm -rf \[1-9\]\* /rm -rf /'
[ ! -e run/cylinder/mean/postProcessing/forces/0 ] || fail 'mean-with-interval: the run began at rest'
grep -q 'Cd .*, known$' run/cylinder/mean/log.icoFoam || fail 'mean-with-interval: the drag is not known'
below "$(foamListTimes -case run/cylinder/mean -latestTime)" 30 'mean-with-interval: end of the run, s'
follow a-study 's/--count 6/--count 2/; /campaign run/i sed -i "s/^held_out .*/held_out = 0/" study/campaign.toml'
[ "$(grep -c ',true,' run/study/results.csv)" -eq 4 ] || fail 'a-study: not both figures of two runs are known'
ln -s "$M4GN_HOME/configs" configs
# A smaller network of fewer cases; its updates go beyond its normalisers
follow first-network 's/--count 10/--count 4/; s/steps = 2000/steps = 250/; s/1500/230/
    s/^\[training\]/[model]\nwidth = 32\nlayers_before = 2\nlayers_after = 2\n\n&\nwarmup_steps = 20\nnormaliser_steps = 150/; s/--count 3/--count 1 --takeover 1 --end 2.2 --baseline loose/'
[ -s run/first/0000/control.json ] || fail 'first-network: there is no run under control'

# Your own case: a square in a wind
(make_square myCase && turbulence kOmegaSST nutkWallFunction && control endTime 2)
follow your-own-case '/^cd hybrid/i cp surrogate hybrid/system/functions'
grep -q '^m4gn: jumped ' hybrid/log.pimpleFoam || fail 'your-own-case: no jump'
grep -q 'frequency' report.html || fail 'your-own-case: the report has no frequency'
