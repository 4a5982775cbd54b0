#!/usr/bin/env bash
# README, results: the row of twelve rubber beams pressed by a cylinder, on the first draw of its command and to 0.6 s. In any draw the
# cylinder has reached the beam by 0.25 s.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam
runs m4gn hybrid --family pressed-rubber --count 1 --end 0.6 --baseline a4=anderson=on,tolerance=1e-4 --out hybrid --json hybrid.json
below "$(figure a4 displacement)" 1 'a4: error of D, % of its root mean square'
