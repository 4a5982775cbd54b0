#!/usr/bin/env bash
# Every method of segmentation from the dictionary of a function object: the same segments on one rank and on two.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 0.002

for entries in 'method metis;' 'method slic;' 'method slic-mdodl; obstacles (cylinder); connected no;' \
    'method slic-mdode; distanceScale 0.1; connected yes; modes 8;'; do
    ride "mode observe; $small segments { count 16; $entries }"
    mv 0/m4gnSegment whole
    solve 2
    runs reconstructPar -withZero -fields '(m4gnSegment)'
    [ "$(values whole | wc -l)" -gt 800 ] && [ "$(values whole | sort -u | wc -l)" -eq 16 ] ||
        fail "$entries: expected 16 segments"
    cmp -s <(values whole) <(values 0/m4gnSegment) || fail "$entries: two ranks found other segments"
    md5sum <(values whole) | cut -c 1-32 >> ../answers
    echo "$entries: 16 segments, the same on two ranks"
done
[ "$(sort -u ../answers | wc -l)" -eq 4 ] || fail "two of the methods gave the same segments"
