#!/usr/bin/env bash
# README, results: the row of three rubber beams pressed by a cylinder, on the first draw of its command.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
needs_solids4foam
hybrid --family pressed-rubber --model "$M4GN_HOME/models/pressed-rubber.safetensors"
claim hybrid displacement 7 0.8
