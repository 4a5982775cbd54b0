#!/usr/bin/env bash
# Makes Debian packages of what setup/build.sh has built: setup/package.sh [FOLDER]    (target/package)
set -euo pipefail
# shellcheck source=setup/common.sh
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
folder=$(realpath -m "${1:-$M4GN_HOME/target/package}")
[ -e "$M4GN_HOME/lib/libm4gnFoam.so" ] || die "m4gn is not built" "Type setup/build.sh core"
"$M4GN_HOME/setup/debian.sh" package
foam=$("$M4GN_HOME/setup/openfoam.sh" --export)
eval "$foam"
rm -rf "$folder"
mkdir -p "$folder"
"$M4GN_HOME/target/release/m4gn" shell-files "$folder/files"
strip --strip-debug -o "$folder/files/m4gn" "$M4GN_HOME/target/release/m4gn"
cd "$folder"
cmake -S "$M4GN_HOME/cmake/package" -B build -DOPENFOAM="$M4GN_FOAM_VERSION" -DFILES="$folder/files" >log
cd build
cpack -B "$folder" >>../log || die "the packages could not be made" "What CMake said is in $folder/log"
rm -rf "$folder"/{_CPack_Packages,build,files}
ls "$folder"/*.deb
