#!/usr/bin/env bash
# Takes minutes.
# The tutorial of docs/tutorials that needs solids4foam, with one draw and to 0.8 s, behind the network's first jump.
# shellcheck source=tests/e2e/_follow.sh
. "$(dirname "${BASH_SOURCE[0]}")/_follow.sh"
needs_solids4foam
ln -s "$M4GN_HOME/models" models
follow solids4foam-beam 's/--count 3/--count 1 --end 0.8/'
[ "$(grep -c '^0000  full ' log.run)" -eq 1 ] || fail 'the plain run is not there for the second command'
grep -q 'D %' run/rubber.html || fail 'the report has no error of the displacement'
