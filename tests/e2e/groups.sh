#!/usr/bin/env bash
# A network that lives on groups of cells: the groups are stored as m4gnGroup, the same ones on two ranks.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
cells=$(sed -n 's/^ *note .*nCells: *\([0-9]*\).*/\1/p' constant/polyMesh/owner)

ride "mode observe; $small resolution off;"
[ ! -e 0/m4gnGroup ] || fail "groups were stored for a network on the cells"

ride "mode observe; $small resolution 0.06;"
groups=$(sed -n 's/^m4gn: model .* segments, \([0-9]*\) groups of cells, ready in .*/\1/p' log.run)
[ "$(labels 0/m4gnGroup | wc -l)" = "$groups" ] || fail "m4gnGroup has $(labels 0/m4gnGroup | wc -l) groups, the log says '$groups'"
[ "$groups" -gt 20 ] && [ $((groups*4)) -lt $((cells*3)) ] || fail "$groups groups of $cells cells"
mv 0/m4gnGroup ..
clean_case
solve 2
cmp <(values ../m4gnGroup) <(values 0/m4gnGroup) || fail "two ranks have other groups"
for p in processor0 processor1; do [ -f $p/0/m4gnGroup ] || fail "$p has no groups"; done

ride "mode observe; $small resolution 0.06; writeSegments no;"
[ ! -e 0/m4gnGroup ] || fail "groups were stored in spite of writeSegments no"
echo "groups: $groups of $cells cells"
