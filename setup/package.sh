#!/usr/bin/env bash
# Makes Debian packages of what setup/build.sh has built: setup/package.sh [FOLDER]    (target/package)
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
# Folders of packages are for all users
umask 022
folder=$(realpath -m "${1:-$M4GN_HOME/target/package}")
[ -e "$M4GN_HOME/lib/libm4gnFoam.so" ] || die "m4gn is not built" "Type setup/build.sh core"
"$M4GN_HOME/setup/debian.sh" package
foam=$("$M4GN_HOME/setup/openfoam.sh" --export)
eval "$foam"
[ "$(cat "$M4GN_HOME/target/openfoam/.probe" 2>/dev/null)" = "$foam" ] ||
    die "lib was not built for the OpenFOAM that is found here, $M4GN_FOAM_VERSION in $M4GN_FOAM_PROJECT_DIR" \
        "Type setup/build.sh core in this shell, or source the OpenFOAM that lib was built for, and run this again."
# The folder may have more than ours
work=$M4GN_HOME/target/package-build
rm -rf "$work"
mkdir -p "$work" "$folder"
"$M4GN_HOME/target/release/m4gn" shell-files "$work/files"
strip --strip-debug -o "$work/files/m4gn" "$M4GN_HOME/target/release/m4gn"
cmake -S "$M4GN_HOME/cmake/package" -B "$work/build" -DOPENFOAM="$M4GN_FOAM_VERSION" -DKIND="$M4GN_FOAM_KIND" \
    -DFILES="$work/files" >"$work/log"
(cd "$work/build" && cpack -B "$work") >>"$work/log" ||
    die "the packages could not be made" "What CMake said is in $work/log"
rm -f "$folder"/m4gn_*.deb "$folder"/m4gn-openfoam*.deb
mv "$work"/*.deb "$folder"
rm -rf "$work"
ls "$folder"/*.deb
