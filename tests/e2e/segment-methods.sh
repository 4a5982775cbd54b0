#!/usr/bin/env bash
# Every method of segmentation from the dictionary of a function object: the same segments on one rank and on two.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case
sed -i 's/^endTime .*/endTime 0.002;/' system/controlDict

segments() {
    function_object m4gnSurrogate "mode observe; model \"$small_model\"; segments { count 16; $* }"
}

for entries in 'method metis;' 'method slic;' 'method slic-mdodl; obstacles (cylinder); connected no;' \
    'method slic-mdode; distanceScale 0.1; connected yes; modes 8;'; do
    clean_case
    segments "$entries"
    runs icoFoam
    mv 0/m4gnSegment whole
    on_two_ranks icoFoam
    runs reconstructPar -withZero -fields '(m4gnSegment)'
    [ "$(values whole | wc -l)" -gt 800 ] && [ "$(values whole | sort -u | wc -l)" -eq 16 ] ||
        fail "$entries: expected 16 segments"
    cmp -s <(values whole) <(values 0/m4gnSegment) || fail "$entries: two ranks found other segments"
    md5sum <(values whole) | cut -c 1-32 >> ../answers
    echo "$entries: 16 segments, the same on two ranks"
done
[ "$(sort -u ../answers | wc -l)" -eq 4 ] || fail "two of the methods gave the same segments"
echo "segment-methods: passed"
