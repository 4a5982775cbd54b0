#!/usr/bin/env bash
# Fetches the headers that belong to Debian's OpenFOAM (the package ships none) into the cache:
# the source of the same version, and the lnInclude folders of the libraries that m4gn compiles against.
#   setup/openfoam-source.sh              the headers
#   setup/openfoam-source.sh tutorials    some tutorials of the same version: prints their folder
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# The mirrors that this machine's own apt uses, then Debian's.
mirrors() {
    # shellcheck disable=SC2016  # apt expands these, not the shell
    apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 'Component: main' 2>/dev/null |
        grep -E '^https?://.*/debian/?$' | sort -u || true
    echo http://deb.debian.org/debian
}

download() {
    local file=$1 mirror
    while read -r mirror; do
        echo "trying ${mirror%/}"
        if /usr/lib/apt/apt-helper -o APT::Sandbox::User=root -o Acquire::Retries=3 download-file \
            "${mirror%/}/pool/main/o/openfoam/$FOAM_TARBALL" "$file" "SHA256:$FOAM_SHA256"; then
            return 0
        fi
    done < <(mirrors | awk '!seen[$0]++')
    return 1
}

intact() { echo "$FOAM_SHA256  $M4GN_CACHE/$FOAM_TARBALL" | sha256sum --check --quiet; }

# A tarball that was put into the cache by hand will do.
fetch() {
    intact || { rm -f "$M4GN_CACHE/$FOAM_TARBALL" && download "$M4GN_CACHE/$FOAM_TARBALL" && intact; }
}

# A function that `step` runs has to chain its commands: the shell ignores `set -e` inside a tested command.
unpack() {
    local tmp=$FOAM_SOURCE.tmp
    rm -rf "$tmp" "$FOAM_SOURCE" &&
        mkdir -p "$tmp" &&
        tar -xjf "$M4GN_CACHE/$FOAM_TARBALL" -C "$tmp" --strip-components=1 --wildcards \
            '*/src' '*/wmake/wmakeLnInclude' '*/wmake/scripts' '*/META-INFO' '*/COPYING' &&
        link_headers "$tmp/src" &&
        echo "$stamp" >"$tmp/.complete" &&
        mv -T "$tmp" "$FOAM_SOURCE" &&
        rm -f "$M4GN_CACHE/$FOAM_TARBALL"
}

unpack_tutorials() {
    local tmp=$tutorials.tmp
    rm -rf "$tmp" &&
        mkdir -p "$tmp" &&
        tar -xjf "$M4GN_CACHE/$FOAM_TARBALL" -C "$tmp" --strip-components=2 --wildcards "${chosen[@]/#/*/tutorials/}" &&
        echo "$FOAM_SHA256 ${chosen[*]}" >"$tmp/.complete" &&
        rm -rf "$tutorials" &&
        mv -T "$tmp" "$tutorials" &&
        rm -f "$M4GN_CACHE/$FOAM_TARBALL"
}

tutorials=$FOAM_SOURCE-tutorials
# The tutorials that the tests use
chosen=(incompressible/{icoFoam,nonNewtonianIcoFoam,pisoFoam,pimpleFoam} compressible/rhoPimpleFoam multiphase/interFoam
    heatTransfer/buoyantPimpleFoam)
stamp="$FOAM_SHA256 $(printf '%s\n' "${FOAM_LIBRARIES[@]}" | cksum)"
complete() { [ "$(cat "$FOAM_SOURCE/.complete" 2>/dev/null)" = "$stamp" ]; }

have_source() {
    step "OpenFOAM $FOAM_VERSION source (45 MB)" fetch ||
        die "the source of Debian's OpenFOAM could not be downloaded" \
            "Fetch $FOAM_TARBALL by hand (pool/main/o/openfoam on any Debian mirror) into $M4GN_CACHE, or" \
            "source an OpenFOAM of your own that has headers, and run this again."
}

have_tutorials() {
    [ "$(cat "$tutorials/.complete" 2>/dev/null)" = "$FOAM_SHA256 ${chosen[*]}" ] && return
    have_source
    step "OpenFOAM $FOAM_VERSION tutorials" unpack_tutorials ||
        die "the tutorials of OpenFOAM could not be unpacked into $tutorials" \
            "Free some disk space (90 MB are needed) or set M4GN_CACHE to another folder, and run this again."
}

main() {
    complete && return
    have_source
    step "OpenFOAM $FOAM_VERSION headers" unpack ||
        die "the source of OpenFOAM could not be unpacked into $FOAM_SOURCE" \
            "Free some disk space (80 MB are needed) or set M4GN_CACHE to another folder, and run this again."
}
case ${1:-headers} in
    headers) complete || with_lock openfoam main ;;
    tutorials)
        with_lock openfoam have_tutorials >&2
        echo "$tutorials"
        ;;
    *) die "unknown part '$1'" "usage: setup/openfoam-source.sh [headers|tutorials]" ;;
esac
