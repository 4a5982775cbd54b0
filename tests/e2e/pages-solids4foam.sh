#!/usr/bin/env bash
# Takes minutes.
# The tutorial of docs/tutorials that needs solids4foam, with one draw and to 1 s.
# shellcheck source=tests/e2e/_follow.sh
. "$(dirname "${BASH_SOURCE[0]}")/_follow.sh"
needs_solids4foam
ln -s "$M4GN_HOME/models" models
follow solids4foam-beam 's/--count 3/--count 1 --end 1/'
grep -q 'D %' run/rubber.html || fail 'the report has no error of the displacement'
