# shellcheck shell=bash
# Tutorials of docs/tutorials, followed to the letter: blocks behind <!-- run --> are run, those behind <!-- file NAME --> become that file. Sourced.
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
