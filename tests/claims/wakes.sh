#!/usr/bin/env bash
# README, results: the rows of the twelve wakes, on the first draw of their command and to 6 s.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
hybrid --seed 4321 --model "$M4GN_HOME/models/cylinder-flow.safetensors" --end 6
claim dmd end 0.011 0.4
claim dmd-loose end 0.08 0.4
claim hybrid end 0.3 0.8
