#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd) and turbulence models with wall functions: a square in a wind, some 1,000 cells. All fields of the
# model are handed over, none of its wall functions is evaluated between, and what is positive stays so.
# shellcheck source=tests/e2e/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_square case

while read -r model names wall; do
    turbulence "$model" "$wall"
    plain pimpleFoam 0.8 1.2
    function_object m4gnSurrogate 'mode replace; surrogates (dmd); timeStart 0.6; dmd { snapshotInterval 0.005; minSnapshots 24; jumpTolerance 0.05; fitTolerance 0.05; }'
    runs pimpleFoam
    replaces 0.15 "$model"
    grep -q "^m4gn: the dmd surrogate advances.*$names" log.run || fail "$model: expected $names among what is handed over"
    ! grep -i 'bounding\|warning' log.run || fail "$model: a field has left its bounds"
    for name in U ${names//,/}; do
        hold=$(difference ../plain/1.2/$name ../plain/0.8/$name)
        below "$(difference ../plain/1.2/$name 1.2/$name)" "$(awk "BEGIN { print 0.25*$hold }")" "$model: largest error of $name"
    done
done <<'EOD'
kOmegaSST omega nutkWallFunction
kEpsilon epsilon nutkWallFunction
SpalartAllmaras nuTilda nutUSpaldingWallFunction
EOD
