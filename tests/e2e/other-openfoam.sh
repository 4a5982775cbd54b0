#!/usr/bin/env bash
# The function objects and the bridge compile against the headers of another OpenFOAM than this machine's: M4GN_OTHER_OPENFOAM is the
# folder of its source, with src, wmake and META-INFO in it. Takes some minutes.
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
[ -n "${M4GN_OTHER_OPENFOAM:-}" ] || skip "M4GN_OTHER_OPENFOAM does not name the source of another OpenFOAM"
[ -f "$M4GN_OTHER_OPENFOAM/META-INFO/api-info" ] || fail "$M4GN_OTHER_OPENFOAM has no META-INFO/api-info"

mkdir foam libraries
cp -r "$M4GN_OTHER_OPENFOAM"/{src,wmake,META-INFO} foam
runs link_headers foam/src
export WM_PROJECT_DIR=$work/foam FOAM_LIBBIN=$work/libraries FOAM_MPI=. WM_LABEL_SIZE=32 WM_PRECISION_OPTION=DP
# Nothing is linked: CMake looks whether the libraries are there
names=$(sed -n '/^find_package(OpenFOAM/,/)/p' "$M4GN_HOME/openfoam/CMakeLists.txt" | tr -d '()' | tr ' ' '\n' | grep '^[a-z]' | grep -v find_package)
for name in OpenFOAM Pstream $names; do
    : | cc -shared -x c - -o "libraries/lib$name.so"
done
runs cmake -S "$M4GN_HOME/openfoam" -B build -G Ninja -DCMAKE_BUILD_TYPE=None
grep -q "$(sed -n 's/^api=//p' foam/META-INFO/api-info)" build/build.ninja || fail "another version of OpenFOAM was configured"
runs ninja -C build -k 0 objects
rooms=$(find build -name '*.o' | wc -l)
[ "$rooms" -gt 10 ] || fail "$rooms rooms were compiled"
# What cxx has made of the bridge's lib.rs is the same for all versions
foam=$("$M4GN_HOME/setup/openfoam.sh" --export)
eval "$foam"
# shellcheck disable=SC2012  # the newest
bridge=$(ls -td "$M4GN_HOME"/target/release/build/m4gn-foam-bridge-*/out/cxxbridge/include | head -n 1)
printf '#include "%s"\n' "$M4GN_HOME"/cpp/bridge/*.C > bridge.C
# shellcheck disable=SC2046,SC2086  # one word each
runs c++ -std=c++"$M4GN_FOAM_CXXSTD" -fsyntax-only -Wall $(printf -- '-D%s ' $M4GN_FOAM_DEFINES) -isystem "$bridge" \
    -I"$M4GN_HOME/cpp/bridge" -I"$M4GN_HOME/openfoam/case" -I"$M4GN_HOME/cpp/include" \
    $(sed 's/^/-isystem /; s/:/ -isystem /g' <<< "$M4GN_FOAM_INCLUDES") bridge.C
echo "other-openfoam: $rooms rooms and the bridge compile with OpenFOAM $(sed -n 's/^api=//p' foam/META-INFO/api-info)"
