#!/usr/bin/env bash
# The tutorials of docs/tutorials, followed to the letter: blocks behind <!-- run --> are run, those behind <!-- file NAME --> become that file.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# follow PAGE [SED]: what it has its reader do, with these changes of its sizes, from the folder that has run/
follow() {
    python3 - "$M4GN_HOME/docs/tutorials/$1.md" >"$1.sh" <<'PYTHON'
import re, sys
text = open(sys.argv[1]).read()
for kind, name, block in re.findall(r"^<!-- (run|file) ?(\S*) -->\n\n((?: {4}.*\n|\n(?= {4}))+)", text, re.M):
    block = re.sub("^ {4}", "", block, flags=re.M)
    print(block if kind == "run" else f"cat > {name} <<'END'\n{block}END")
PYTHON
    sed -i "${2:-}" "$1.sh"
    [ "$(wc -l <"$1.sh")" -gt 2 ] || fail "$1: nothing to follow"
    (cd "$work" && runs bash -eo pipefail "$1.sh")
}

cd "$work"
runs m4gn tutorial cylinder -- --repeats 1
follow first-hybrid-run
[ -s run/cylinder/loose/log.icoFoam ] || fail 'first-hybrid-run: there is no loose run'
follow mean-with-interval
grep -q 'Cd .*, known$' run/cylinder/mean/log.icoFoam || fail 'mean-with-interval: the drag is not known'
below "$(foamListTimes -case run/cylinder/mean -latestTime)" 30 'mean-with-interval: end of the run, s'
follow a-study 's/--count 6/--count 3/; /campaign run/i sed -i "s/^held_out .*/held_out = 0/" study/campaign.toml'
[ "$(grep -c ',true,' run/study/results.csv)" -eq 6 ] || fail 'a-study: not both figures of three runs are known'
ln -s "$M4GN_HOME/configs" configs
follow first-network 's/steps = 2000/steps = 600/; s/1500/560/; s/--count 3/--count 1/'
[ -s run/first/0000/control.json ] || fail 'first-network: there is no run under control'
