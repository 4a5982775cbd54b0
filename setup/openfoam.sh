#!/usr/bin/env bash
# The one probe for OpenFOAM: which installation, headers, libraries and compiler flags.
#   setup/openfoam.sh --print     KEY=VALUE lines (for CMake)
#   setup/openfoam.sh --export    the same as shell code: eval "$(setup/openfoam.sh --export)"
# M4GN_FOAM_INCLUDES is separated by ':', M4GN_FOAM_DEFINES by ' ' and without -D.
# shellcheck disable=SC2034  # M4GN_FOAM_* are printed by name at the end
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

tried=()

fail() {
    if [ ${#tried[@]} -gt 0 ]; then tried=("tried:" "${tried[@]/#/  }"); fi
    die "no usable OpenFOAM was found: $1" "${tried[@]}" \
        "Debian 12: type setup/debian.sh && setup/openfoam-source.sh" \
        "Your own OpenFOAM (openfoam.com, v1912 or later): source its etc/bashrc and run this again."
}

# openfoam.org's and foam-extend's classes are other ones
refuse_others() {
    [ -n "${WM_PROJECT_DIR:-}" ] && [ ! -f "$WM_PROJECT_DIR/META-INFO/api-info" ] || return 0
    local name=${WM_PROJECT:-} version=${WM_PROJECT_VERSION:-} bashrc=$WM_PROJECT_DIR/etc/bashrc
    [ -n "$name" ] || name=$(sed -n 's/^export WM_PROJECT=//p' "$bashrc" 2>/dev/null || true)
    [ -n "$version" ] || version=$(sed -n 's/^export WM_PROJECT_VERSION=//p' "$bashrc" 2>/dev/null || true)
    case $name-$version in
        foam-*) fail "what is sourced is foam-extend $version in $WM_PROJECT_DIR, and m4gn needs OpenFOAM of openfoam.com" ;;
        *-dev | *-[0-9] | *-[0-9].* | *-[0-9][0-9] | *-[0-9][0-9].*)
            fail "what is sourced is OpenFOAM $version of the OpenFOAM Foundation (openfoam.org) in $WM_PROJECT_DIR, and m4gn needs that of openfoam.com" ;;
    esac
}

probe_sourced() {
    if [ -z "${WM_PROJECT_DIR:-}" ]; then
        tried+=("a sourced OpenFOAM: WM_PROJECT_DIR is not set")
        return 1
    elif ! foam_sourced; then
        tried+=("a sourced OpenFOAM: $WM_PROJECT_DIR/src/OpenFOAM/lnInclude does not exist (no headers)")
        # Debian's may be sourced, and has none
        [ "$(realpath -m "$WM_PROJECT_DIR")" = /usr/share/openfoam ] ||
            fail "the one that is sourced has no headers: compile it, install its -dev package, or unset WM_PROJECT_DIR for Debian's"
        return 1
    fi
    M4GN_FOAM_KIND=sourced
    M4GN_FOAM_PROJECT_DIR=$WM_PROJECT_DIR
    M4GN_FOAM_SRC=$WM_PROJECT_DIR/src
    M4GN_FOAM_LIBDIR=${FOAM_LIBBIN:-$WM_PROJECT_DIR/platforms/${WM_OPTIONS:-linux64GccDPInt32Opt}/lib}
    M4GN_FOAM_MPI_LIBDIR=$M4GN_FOAM_LIBDIR/${FOAM_MPI:-sys-openmpi}
    label_size=${WM_LABEL_SIZE:-32}
    precision=${WM_PRECISION_OPTION:-DP}
}

probe_debian() {
    local lib=/usr/lib/libOpenFOAM.so
    if [ ! -e "$lib" ]; then
        tried+=("Debian's OpenFOAM: $lib does not exist (package libopenfoam)")
        return 1
    elif [ ! -f "$FOAM_SOURCE/.complete" ]; then
        tried+=("Debian's OpenFOAM: $lib is there, its headers are not in $FOAM_SOURCE (setup/openfoam-source.sh)")
        return 1
    fi
    M4GN_FOAM_KIND=debian
    M4GN_FOAM_PROJECT_DIR=/usr/share/openfoam
    M4GN_FOAM_SRC=$FOAM_SOURCE/src
    M4GN_FOAM_LIBDIR=/usr/lib
    M4GN_FOAM_MPI_LIBDIR=/usr/lib/openmpi-system
    label_size=32
    precision=DP
}

find_version() {
    local info=$M4GN_FOAM_SRC/../META-INFO/api-info version
    version=$(sed -n 's/^api=//p' "$info" 2>/dev/null || true)
    [ -n "$version" ] || version=$(printf '%s' "${WM_PROJECT_VERSION:-}" | sed -n 's/^v\{0,1\}\([0-9]\{4\}\).*/\1/p')
    [ -n "$version" ] || {
        tried+=("the version: no 'api=' in $info, and WM_PROJECT_VERSION='${WM_PROJECT_VERSION:-}' is not like v1912")
        fail "its version is unknown (m4gn needs OpenFOAM of openfoam.com)"
    }
    [ "$version" -ge 1912 ] || fail "version $version is older than 1912"
    M4GN_FOAM_VERSION=$version
}

find_standard() {
    local rules=$M4GN_FOAM_SRC/../wmake/rules/General/Gcc/c++ std
    std=$(sed -n 's/.*-std=c++\([0-9]*\).*/\1/p' "$rules" 2>/dev/null | head -n 1 || true)
    if [ -z "$std" ]; then std=14; if [ "$M4GN_FOAM_VERSION" -ge 2312 ]; then std=17; fi; fi
    if [ "$std" -lt 14 ]; then std=14; fi
    M4GN_FOAM_CXXSTD=$std
}

find_includes() {
    local library dir
    M4GN_FOAM_INCLUDES=
    for library in "${FOAM_LIBRARIES[@]}"; do
        dir=$M4GN_FOAM_SRC/$library/lnInclude
        if [ -d "$dir" ]; then
            M4GN_FOAM_INCLUDES+=${M4GN_FOAM_INCLUDES:+:}$dir
        elif [ "$library" = finiteVolume ] || [ "$library" = meshTools ]; then
            tried+=("$dir: does not exist")
            fail "headers of the library $library are missing (run wmakeLnInclude, or compile OpenFOAM)"
        fi
    done
    M4GN_FOAM_INCLUDES+=:$M4GN_FOAM_SRC/transportModels
}

refuse_others
probe_sourced || probe_debian || fail "none has both libraries and headers"
[ -e "$M4GN_FOAM_LIBDIR/libOpenFOAM.so" ] || {
    tried+=("$M4GN_FOAM_LIBDIR/libOpenFOAM.so: does not exist")
    fail "its libraries are missing"
}
[ "$precision" = DP ] || fail "it is compiled with WM_PRECISION_OPTION=$precision, and m4gn needs DP"
find_version
find_standard
find_includes
# v1912's ListLoopM.H puts __restrict__ on pointers that alias in in-place products (tmp<tensorField> & tensorField);
# GCC 12 at -O2 then gives wrong values, silently. Defining it away costs nothing measurable.
M4GN_FOAM_DEFINES="OPENFOAM=$M4GN_FOAM_VERSION WM_$precision WM_LABEL_SIZE=$label_size NoRepository __restrict__="

case ${1:---print} in
    --print) format='%s=%s\n' ;;
    --export) format='export %s=%q\n' ;;
    *) die "unknown option '$1'" "usage: setup/openfoam.sh [--print|--export]" ;;
esac
for key in KIND PROJECT_DIR VERSION SRC INCLUDES LIBDIR MPI_LIBDIR DEFINES CXXSTD; do
    name=M4GN_FOAM_$key
    # shellcheck disable=SC2059  # one of the two formats above
    printf "$format" "$name" "${!name}"
done
