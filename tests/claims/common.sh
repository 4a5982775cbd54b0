# shellcheck shell=bash
# Rows of the README's table of results, by their own command on one draw. Sourced.
. "$(dirname "${BASH_SOURCE[0]}")/../e2e/_follow.sh"

# hybrid OPTIONS...: 'm4gn hybrid' of one draw, without cheaper plain solvers but those given; a second one goes on with the runs of the first
hybrid() { runs m4gn hybrid --count 1 --baseline none --keep-cases --out hybrid --json hybrid.json "$@"; }

# figure VARIANT FIGURE: median of a figure of the variant's runs
figure() { python3 -c 'import json, sys; print(json.load(open("hybrid.json"))["summary"][0]["runs"][sys.argv[1]][sys.argv[2]]["median"])' "$@"; }

# claim VARIANT FIGURE BOUND REPLACED: the figure of the variant's run, at most BOUND, while at least this share of its time was replaced
claim() {
    local figure replaced
    read -r figure replaced < <(python3 - "$1" "$2" <<'PYTHON'
import json, sys
variant, figure = sys.argv[1:]
found = json.load(open("hybrid.json"))
print(found["summary"][0]["runs"][variant][figure]["median"], found["cases"][0]["runs"][variant]["score"]["replaced"])
PYTHON
    )
    below "$figure" "$3" "$1, $replaced of the time replaced: $2"
    awk "BEGIN { exit !($replaced >= $4) }" || fail "$1: $replaced of the time was replaced, expected at least $4"
}
