#!/usr/bin/env bash
# m4gnSurrogate with surrogates (dmd) and turbulence models with wall functions: a square in a wind, some 1,000 cells. All fields of the
# model are handed over, none of its wall functions is evaluated between, and what is positive stays so.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_square case

while read -r model names wall; do
    turbulence "$model" "$wall"
    plain 0.4 0.8 1.2
    # From where the first fit has its states
    clean_case
    cp -r ../plain/0.4 .
    control startTime 0.4
    surrogate 'mode replace; surrogates (dmd); timeStart 0.6; dmd { snapshotInterval 0.005; minSnapshots 24; jumpTolerance 0.05; fitTolerance 0.05; }'
    solve
    control startTime 0
    replaces 0.15 "$model"
    expect_log "^m4gn: the dmd surrogate advances.*$names"
    # A field that has left its bounds
    expect_silence '[Bb]ounding' '[Ww]arning\|WARNING'
    for name in U ${names//,/}; do
        close_to ../plain "$(calc "0.25*$(difference ../plain/1.2/$name ../plain/0.8/$name)")" 1.2/$name
    done
done <<'EOD'
kOmegaSST omega nutkWallFunction
kEpsilon epsilon nutkWallFunction
SpalartAllmaras nuTilda nutUSpaldingWallFunction
EOD
