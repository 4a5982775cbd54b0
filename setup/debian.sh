#!/usr/bin/env bash
# Installs the Debian packages that m4gn needs, and nothing when all are there.
#   setup/debian.sh [core|all|solids4foam|package]    core: build and run; all (default): also what fetches libtorch, and what the
#                                             tests need; solids4foam: what that is built with; package: what setup/package.sh needs
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

packages=(
    libpetsc-real-dev libslepc-real-dev
    libopenmpi-dev openmpi-bin libhdf5-openmpi-dev libmetis-dev
    libopenblas0-pthread libopenblas-dev
    gmsh g++ make cmake ninja-build pkg-config libclang-dev bzip2 ca-certificates
)
foam_sourced || packages+=(openfoam)
if [ "${1:-all}" = all ]; then
    packages+=(python3 python3-pip python3-venv python3-sphinx python3-myst-parser furo)
    # Later releases do not have it, and other versions format otherwise
    if grep -qsx VERSION_CODENAME=bookworm /etc/os-release; then packages+=(clang-format-14); fi
fi
if [ "${1:-all}" = solids4foam ]; then packages+=(libeigen3-dev); fi
if [ "${1:-all}" = package ]; then packages+=(dpkg-dev file); fi

# package:upstream series that m4gn is built and tested with, those of Debian 12 and of Debian 13
series=(
    openfoam:1912 libpetsc-real-dev:3.18/3.22 libslepc-real-dev:3.18/3.22 libopenmpi-dev:4.1/5.0
    libhdf5-openmpi-dev:1.10/1.14 libmetis-dev:5.1/5.2 gmsh:4.8/4.13
)

sudo=(sudo)

missing() {
    dpkg-query -W -f '${db:Status-Status} ${Package}\n' "${packages[@]}" 2>/dev/null |
        awk -v all="${packages[*]}" '
            $1 == "installed" { there[$2] = 1 }
            END { n = split(all, p, " "); for (i = 1; i <= n; i++) if (!(p[i] in there)) print p[i] }'
}

as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    elif command -v sudo >/dev/null; then
        "${sudo[@]}" "$@"
    else
        echo "not root, and sudo is not installed" >&2
        return 1
    fi
}

apt() {
    # sudo keeps no settings of a proxy
    as_root env DEBIAN_FRONTEND=noninteractive ${http_proxy:+"http_proxy=$http_proxy"} ${https_proxy:+"https_proxy=$https_proxy"} \
        apt-get -y -q -o Acquire::Retries=3 -o DPkg::Lock::Timeout=300 "$@"
}

install_packages() {
    local candidates
    # The lists are refreshed only where they do not know a package, or know a version that is gone.
    candidates=$(apt-cache policy "$@" | grep -c 'Candidate: [^(]' || true)
    [ "$candidates" -eq $# ] || apt update
    apt install --no-install-recommends "$@" || { apt update && apt install --no-install-recommends "$@"; }
}

check_series() {
    local entry package expected one version
    for entry in "${series[@]}"; do
        package=${entry%%:*} expected=${entry#*:}
        if [ "$package" = openfoam ] && foam_sourced; then continue; fi
        version=$(dpkg-query -W -f '${Version}' "$package" 2>/dev/null) || continue
        # Its OSHA1stream takes no single characters from GCC 14's library on
        if [[ $package = openfoam && $version = 1912.200626-3+b1 ]]; then
            warn "this OpenFOAM ends each run that has a function object with 'error in IOstream \"sha1\"': source one of openfoam.com"
        fi
        for one in ${expected//\// }; do
            case ${version#*:} in "$one" | "$one"[.+~-]*) continue 2 ;; esac
        done
        warn "$package is $version, and m4gn is tested with ${expected//\// and }: it may not build or behave the same"
    done
}

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
    warn "this is not a Debian system: install the counterparts of these yourself: ${packages[*]}"
    exit 0
fi

mapfile -t wanted < <(missing)
if [ ${#wanted[@]} -gt 0 ]; then
    # sudo may have to ask for a password, which it cannot do from inside a logged step.
    if [ "$(id -u)" -ne 0 ] && command -v sudo >/dev/null; then
        if [ -n "${CI:-}" ] || [ ! -t 0 ]; then sudo+=(-n); else sudo -v || true; fi
    fi
    step "Debian packages (${#wanted[@]})" install_packages "${wanted[@]}" ||
        die "apt-get could not install: ${wanted[*]}" \
            "As root, type: apt-get update && apt-get install --no-install-recommends ${wanted[*]}" \
            "and then run this again. m4gn is made for Debian 12 (bookworm) and 13 (trixie), component main."
fi
check_series
