#!/usr/bin/env bash
# Builds m4gn and puts the libraries into lib/.
#   setup/build.sh [core|all]    core: m4gn, the OpenFOAM bridge, the function objects; all (default): also libtorch's part
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
# shellcheck source=setup/cargo-cache.sh
. "$M4GN_HOME/setup/cargo-cache.sh"
cd "$M4GN_HOME"

what=${1:-all}
case $what in core | all) ;; *) die "unknown part '$what'" "usage: setup/build.sh [core|all]" ;; esac
need_cargo
foam=$(setup/openfoam.sh --export)
eval "$foam"
packages=(--workspace --exclude m4gn-torch)
if [ "$what" = all ]; then
    export LIBTORCH=${LIBTORCH:-$TORCH_DIR}
    packages=(--workspace)
fi

# A library is replaced in one go: a solver that runs keeps the one it has loaded. What ships has no debug information.
publish() {
    local file=$CARGO_TARGET_DIR/release/$1 new=lib/.$1.$$
    mkdir -p lib && strip --strip-debug -o "$new" "$file" || return
    if cmp -s "$new" "lib/$1"; then rm "$new"; else mv -T "$new" "lib/$1"; fi
}

build_crates() {
    cargo build --release --locked "${packages[@]}" &&
        publish libm4gn.so &&
        publish libm4gn_slepc.so &&
        publish libm4gn_foam_bridge.so &&
        { [ "$what" = core ] || publish libm4gn_torch.so; }
}

# Another OpenFOAM than last time: nothing of the old build fits.
configure_function_objects() {
    if [ "$(cat target/openfoam/.probe 2>/dev/null)" != "$foam" ]; then
        rm -rf target/{openfoam,solids4foam} lib/libm4gn{Foam,Accelerators,Averages,Solids4Foam}.so || return
    fi
    configure openfoam target/openfoam -DCMAKE_BUILD_TYPE=Release -DM4GN_CORE_FOLLOWS=ON \
        -DM4GN_AVERAGES_ARCHIVE="$CARGO_TARGET_DIR/release/libm4gn_averages_capi.a" && echo "$foam" >target/openfoam/.probe
}

# What has failed beside cargo fails again, and is told
build_function_objects() {
    wait "$beside" || true
    trap - EXIT
    configure_function_objects && cmake --build target/openfoam
}

# Neither Cargo nor Ninja sees that the system's libraries are those of another release
system=$(basename "$(cargo_cache_dir)")
[ "$(cat target/.system 2>/dev/null || echo "$system")" = "$system" ] || rm -rf target/{release,openfoam,solids4foam,tests}
mkdir -p target && echo "$system" >target/.system
if [ ! -e target/release/.fingerprint ]; then step "dependencies kept from earlier" cargo_cache_restore || true; fi
# OpenFOAM's templates take minutes to compile: in the time and memory that cargo leaves, as libraries are linked at the end only
mkdir -p "$M4GN_LOGS"
spare=${CMAKE_BUILD_PARALLEL_LEVEL:-$(compilers "${CARGO_BUILD_JOBS:-$(cores)}")}
(configure_function_objects && exec nice -n 19 ninja -C target/openfoam -j "$spare" objects) \
    >"$M4GN_LOGS/function-objects-beside-cargo.log" 2>&1 </dev/null &
beside=$!
trap 'kill "$beside" 2>/dev/null || true' EXIT
step "m4gn ($what)" build_crates ||
    die "the Rust part of m4gn did not build" \
        "The messages of Cargo and the compiler are above and in $M4GN_LOGS. Where they tell of" \
        "- a download, check the network and its proxy (https_proxy), and run this again" \
        "- no space left on device, free some, and run this again" \
        "- a system library that was not found, type setup/debian.sh" \
        "- a compiler that was killed (signal: 9), it found no memory: type" \
        "  CARGO_BUILD_JOBS=1 CMAKE_BUILD_PARALLEL_LEVEL=1 setup/build.sh $what" \
        "All else is a fault of m4gn: please report it with that file."
cargo_cache_has "$what" || step "dependencies kept for the next clone" cargo_cache_save "$what" ||
    warn "the compiled dependencies could not be kept in $M4GN_CACHE: a fresh clone will compile them again"
step "function objects for OpenFOAM $M4GN_FOAM_VERSION" build_function_objects ||
    die "lib/libm4gnFoam.so did not build against OpenFOAM $M4GN_FOAM_VERSION ($M4GN_FOAM_SRC)" \
        "To see what was probed, type setup/openfoam.sh. To build against Debian's OpenFOAM, run this again in a" \
        "shell in which no other one is sourced."
# The library for the solids4foam that is found is built with the others' headers
if (solids4foam_environment); then "$M4GN_HOME/setup/solids4foam.sh" | sed '/^export/d'; fi
