#!/usr/bin/env bash
# Messages and small things that users met: each was wrong once.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
make_case case endTime 0.02

# Entries that are no dictionaries are errors, not warnings
expect_errors <<EOD
mode observe; $small nodeTypes outlet; => Entry nodeTypes of .* is no dictionary
mode observe; $small segments 16; => Entry segments of .* is no dictionary
mode observe; $small resolution on; => resolution: expected auto, off or a positive length in m
EOD
expect_errors m4gnRecorder <<< 'provenance none; => Entry provenance of .* is no dictionary'
expect_errors m4gnSegments <<< 'segments 16; => Entry segments of .* is no dictionary'
# A resolution may be a word; groups.sh has a switch of OpenFOAM's and a length
ride "mode observe; $small resolution auto;"

# postProcess -time 0 writes to 0, whatever startFrom says
: > system/functions
solve
control startFrom latestTime
echo 'type m4gnSegments; libs (m4gnFoam); segments { count 16; modes 4; }' > system/m4gnSegments
runs postProcess -func m4gnSegments -time 0
if [ ! -f 0/m4gnSegment ] || [ ! -f 0/m4gnMode1 ]; then find . -name 'm4gn*'; fail "-time 0 did not write to 0"; fi
[ -z "$(ls 0.02/m4gn* 2> /dev/null)" ] || fail "-time 0 wrote to the last time"

# A shell in which another OpenFOAM is sourced than the one that the function objects are built for
WM_PROJECT_DIR=$work/another bash -c '. "$1/env.sh"' . "$M4GN_HOME" 2> log.run
expect_log "built for another OpenFOAM than $work/another"
bash -c '. "$1/env.sh"' . "$M4GN_HOME" 2> log.run
expect_silence OpenFOAM

# A serial run that has computed modes ends without a warning
expect_silence 'Finalizing MPI'
control startFrom startTime
function_object m4gnSegments 'segments { count 16; modes 4; } recompute yes;'
solve
expect_silence 'Finalizing MPI'

# A folder that cannot be in a list of folders
refused 'm4gn cannot be in .*/a:b, for the colon in it' env M4GN_CACHE=a:b "$M4GN_HOME/setup/all.sh" core

# What 'm4gn segment' says about a patch that it does not know
clean_case
rm -f 0/m4gn*
: > system/functions
sed -i '/^    outlet/,/}/s/type .*/type fixedGradient; gradient uniform (0 0 0);/' 0/U
sed -i '/^    outlet/,/}/{s/type .*/type zeroGradient;/; /value/d}' 0/p
refused '--node-type outlet=outlet' m4gn segment .
runs m4gn segment . --node-type outlet=outlet

# env.sh finds its folder also where cd prints what it finds, and through a link
ln -s "$M4GN_HOME/env.sh" env-link.sh
(cd "$M4GN_HOME/.." && for file in "$(basename "$M4GN_HOME")/env.sh" "$work/env-link.sh"; do
    # shellcheck disable=SC2016  # of the inner shell
    [ "$(CDPATH=. bash -c '. "$1"; echo "$M4GN_HOME"' . "$file")" = "$M4GN_HOME" ] || fail "$file does not find its folder"
done)

# Another OpenFOAM than openfoam.com's is refused by name where the build is configured
for other in OpenFOAM-13 OpenFOAM-dev foam-4.1; do
    mkdir -p "$other/etc"
    printf 'export WM_PROJECT=%s\nexport WM_PROJECT_VERSION=%s\n' "${other%-*}" "${other#*-}" > "$other/etc/bashrc"
    name="OpenFOAM ${other#*-} of the OpenFOAM Foundation"
    [ "$other" != foam-4.1 ] || name='foam-extend 4.1'
    refused "what is sourced is $name .*$other, and m4gn needs .*openfoam.com" env -u WM_PROJECT -u WM_PROJECT_VERSION \
        WM_PROJECT_DIR="$PWD/$other" cmake -S "$M4GN_HOME/openfoam" -B "$work/refused"
done

# One without headers is not replaced by Debian's
mkdir -p runtime/META-INFO && echo api=2412 > runtime/META-INFO/api-info
refused 'the one that is sourced has no headers: .*-dev package' env WM_PROJECT_DIR="$PWD/runtime" "$M4GN_HOME/setup/all.sh" core

# A checkout that was moved, or copied, is configured anew
mkdir -p "$work/old/source" && echo 'cmake_minimum_required(VERSION 3.18)
project(moved NONE)' > "$work/old/source/CMakeLists.txt"
runs configure "$work/old/source" "$work/old/build"
touch "$work/old/build/kept"
runs configure "$work/old/source" "$work/old/build"
[ -e "$work/old/build/kept" ] || fail "a build folder that is where it was made is made anew"
cp -r "$work/old" "$work/copy"
runs configure "$work/copy/source" "$work/copy/build"
grep -q "$work/copy/source" "$work/copy/build/CMakeCache.txt" || fail "the copy is that of the old folder"

# What cannot build m4gn, as Debian's own cargo, is refused before anything is installed
mkdir -p old-cargo OpenFOAM-13/src/OpenFOAM/lnInclude && printf '#!/bin/sh\necho cargo 1.63.0\n' > old-cargo/cargo && chmod +x old-cargo/cargo
refused 'old-cargo/cargo is version 1.63.0, and m4gn needs .* or later' env PATH="$PWD/old-cargo:$PATH" "$M4GN_HOME/setup/all.sh" core
refused 'OpenFOAM 13 of the OpenFOAM Foundation' env -u WM_PROJECT -u WM_PROJECT_VERSION WM_PROJECT_DIR="$PWD/OpenFOAM-13" \
    "$M4GN_HOME/setup/all.sh" core
