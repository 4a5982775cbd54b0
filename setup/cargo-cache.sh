# shellcheck shell=bash
# Keeps compiled dependencies (libtorch's bindings alone take minutes) for the next fresh clone. Sourced, never run.
#
# A target folder shared by clones would not do: Cargo tells one clone's m4gn from another's by file times only. So
# each checkout has its own target/, and only what comes from the registry is copied into it when it is empty. Cargo
# checks every piece as usual and rebuilds what does not fit; a cache that is stale or gone costs only time.

# Of each compiler and release of Debian: bindings are made of its MPI and HDF5.
cargo_cache_dir() {
    printf '%s/cargo/%s' "$M4GN_CACHE" "$({ rustc -vV && grep -sE '^(ID|VERSION_ID)=' /etc/os-release; } | cksum | cut -d' ' -f1)"
}

# What a build has compiled grows from kind to kind.
cargo_cache_kinds=(core all tests)

# cargo_cache_fuller KIND: that kind and those that hold more.
cargo_cache_fuller() { printf '%s\n' "${cargo_cache_kinds[@]}" | sed -n "/^$1\$/,\$p"; }

# cargo_cache_kept KIND: what is kept of such builds, newest first.
cargo_cache_kept() {
    find "$(cargo_cache_dir)" -mindepth 1 -maxdepth 1 -type d -name "*-$1" -printf '%T@ %p\n' 2>/dev/null |
        sort -rn | cut -d' ' -f2-
}

cargo_cache_name() { cat "$M4GN_HOME"/Cargo.{lock,toml} "$M4GN_HOME/.cargo/config.toml" | cksum | cut -d' ' -f1; }

# cargo_cache_has KIND: the dependencies of this checkout are kept already, of this kind or a fuller one.
cargo_cache_has() {
    local path kind
    path=$(cargo_cache_dir)/$(cargo_cache_name)
    for kind in $(cargo_cache_fuller "$1"); do
        if [ -d "$path-$kind" ]; then return 0; fi
    done
    return 1
}

# cargo_cache_restore: fills an empty target/release from the fullest kind that is kept of such a checkout, else of any, the newest of it.
cargo_cache_restore() {
    local release=$CARGO_TARGET_DIR/release part=$CARGO_TARGET_DIR/restored kind kept= own= path
    path=$(cargo_cache_dir)/$(cargo_cache_name)
    for kind in "${cargo_cache_kinds[@]}"; do
        kept=$({ cargo_cache_kept "$kind"; echo "$kept"; } | sed -n 1p)
        if [ -d "$path-$kind" ]; then own=$path-$kind; fi
    done
    kept=${own:-$kept}
    if [ -e "$release/.fingerprint" ] || [ -z "$kept" ]; then return 0; fi
    # Fingerprints come last: a copy that is interrupted would leave libraries that Cargo takes for whole
    rm -rf "$part" "${release:?}"/{deps,build} &&
        mkdir -p "$release" &&
        cp -a --reflink=auto "$kept" "$part" &&
        mv -t "$release" "$part"/{deps,build,.fingerprint}
    rm -rf "$part"
}

# cargo_cache_save KIND: keeps the dependencies of this build, in place of all that is kept of this kind or a lesser.
cargo_cache_save() {
    local release=$CARGO_TARGET_DIR/release path tmp kind
    path=$(cargo_cache_dir)/$(cargo_cache_name)-$1
    tmp=$path.tmp$$
    mkdir -p "$tmp"
    # Libraries and build scripts of the registry only: nothing of this checkout's packages, no test programs.
    (cd "$release" &&
        { find deps -maxdepth 1 \( -name 'lib*' -o -name '*.d' \) ! -name '*m4gn*' -print0 &&
            find build .fingerprint -mindepth 1 -maxdepth 1 ! -name '*m4gn*' -print0; } |
        xargs -0 cp -a --reflink=auto --parents -t "$tmp") || { rm -rf "$tmp"; return 1; }
    mv -T "$tmp" "$path" 2>/dev/null || rm -rf "$tmp"
    for kind in "${cargo_cache_kinds[@]}"; do
        cargo_cache_kept "$kind" | grep -vxF "$path" | xargs -r -d '\n' rm -rf --
        if [ "$kind" = "$1" ]; then break; fi
    done
    # Those of compilers that are gone, and what was left by an interruption
    find "$M4GN_CACHE/cargo" -mindepth 1 -maxdepth 1 -mtime +90 -exec rm -rf {} +
    find "$M4GN_CACHE/cargo" -mindepth 2 -maxdepth 2 -name '*.tmp*' -mmin +60 -exec rm -rf {} +
}
