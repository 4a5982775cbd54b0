# shellcheck shell=bash disable=SC2034
# Paths, pinned versions and small functions shared by the set-up, Allrun and Alltest. Sourced, never run.

# With it, cd may go elsewhere and prints where
unset CDPATH
M4GN_HOME=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)
# awk, EPOCHREALTIME and apt-cache write by the locale: decimal commas, translated words
export LC_ALL=C.UTF-8
: "${HOME:=$(getent passwd "$(id -u)" | cut -d: -f6)}"
# Downloads live outside the checkout, so that a fresh clone does not fetch them again.
M4GN_CACHE=${M4GN_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/m4gn}
case $M4GN_CACHE in /*) ;; *) M4GN_CACHE=$PWD/$M4GN_CACHE ;; esac
M4GN_LOGS=$M4GN_HOME/target/log
export HOME M4GN_HOME M4GN_CACHE

# Debian's OpenFOAM brings no headers: they come from the source of the same version.
FOAM_VERSION=1912
FOAM_TARBALL=openfoam_1912.200626.orig.tar.bz2
FOAM_SHA256=c75ca0f04cc4f49708296c1926cbde9d0138b3fef298fed54270dfe29e2df404
FOAM_SOURCE=$M4GN_CACHE/openfoam-1912.200626-1
# The folders of its src/ whose headers are offered to the compiler.
FOAM_LIBRARIES=(
    OpenFOAM OSspecific/POSIX finiteVolume meshTools surfMesh fileFormats
    transportModels/incompressible transportModels/compressible
    TurbulenceModels/turbulenceModels TurbulenceModels/incompressible TurbulenceModels/compressible
    thermophysicalModels/basic thermophysicalModels/specie
    functionObjects/forces functionObjects/field
    parallel/decompose/decompositionMethods parallel/decompose/decompose parallel/reconstruct/reconstruct
    dynamicMesh dynamicFvMesh sampling conversion lagrangian/basic fvOptions genericPatchFields
)

# link_headers SRC: the lnInclude folders of these libraries.
link_headers() {
    local src=$1 library
    for library in "${FOAM_LIBRARIES[@]}"; do
        # Its exit status says nothing, so look at what it made.
        (cd "$src" && WM_ARCH=linux64 ../wmake/wmakeLnInclude -silent "$library")
        [ -n "$(ls -A "$src/$library/lnInclude")" ] || { echo "no headers in $src/$library"; return 1; }
    done
}

# tch 0.24 needs exactly this libtorch; the two CUDA wheels are the ones that it was built against.
TORCH_VERSION=2.11.0
TORCH_SHA256=7aa2f9bbc6d4595ba72138026b2074be1233186150e9292865e04b7a63b8c67a
CUDART_VERSION=13.0.96
CUDART_SHA256=7f82250d7782aa23b6cfe765ecc7db554bd3c2870c43f3d1821f1d18aebf0548
CUPTI_VERSION=13.0.85
CUPTI_SHA256=4eb01c08e859bf924d222250d2e8f8b8ff6d3db4721288cf35d14252a4d933c8
TORCH_DIR=$M4GN_CACHE/libtorch-$TORCH_VERSION-cpu

warn() { printf 'warning: %s\n' "$*" >&2; }

# die MESSAGE [HINT...]: what failed, then one line per thing to do about it.
die() {
    printf '\nerror: %s\n' "$1" >&2
    shift
    if [ $# -gt 0 ]; then printf '       %s\n' "$@" >&2; fi
    exit 1
}

# Lists of folders for compilers, linkers and loaders are separated by colons
for path in "$M4GN_HOME" "$M4GN_CACHE"; do
    case $path in *:*) die "m4gn cannot be in $path, for the colon in it" "Move the checkout, or set M4GN_CACHE to another folder." ;; esac
done
unset path

# configure SOURCE BUILD [OPTION...]: CMake, anew where BUILD was made elsewhere: of a checkout that was moved or copied it refuses its cache.
configure() {
    local source build=$2
    source=$(cd "$1" && pwd -P) || return
    shift 2
    grep -qsxF "CMAKE_HOME_DIRECTORY:INTERNAL=$source" "$build/CMakeCache.txt" || rm -rf "$build"
    # For cmake --build behind it
    export CMAKE_BUILD_PARALLEL_LEVEL=${CMAKE_BUILD_PARALLEL_LEVEL:-$(compilers)}
    cmake -S "$source" -B "$build" -G Ninja "$@"
}

# The log file of a step.
log_of() { printf '%s/%s.log' "$M4GN_LOGS" "$(printf '%s' "$1" | tr -cs 'A-Za-z0-9._-' '-')"; }

# Says now and then how far a step is, until it is ended or the script is gone.
ticker() {
    local name=$1 log=$2 began=$SECONDS every=60
    if [ -t 1 ]; then every=1; fi
    # Waiting for input that never comes: a sleep would outlive this.
    exec 7<> <(:)
    while ! read -rt "$every" -u 7 && kill -0 $$ 2>/dev/null; do
        if [ -t 1 ]; then
            printf '\r  %-48s ...     %4d s' "$name" $((SECONDS - began))
        else
            printf '    %d s: %s\n' $((SECONDS - began)) "$(sed -n '/[^ ]/p' "$log" | tail -n 1 | tr -d '\r' | cut -c 1-100)"
        fi
    done
}

# step NAME COMMAND...: runs a command with its output in a log file and prints one line with the seconds it took.
# On failure it prints the end of the log and returns the command's status. The status STEP_SKIPPED says that the command was
# skipped; the last line of its log is then the reason.
step() {
    local name=$1 log began ticker rc=0
    shift
    log=$(log_of "$name")
    mkdir -p "$M4GN_LOGS"
    : >"$log"
    began=$SECONDS
    if [ -t 1 ]; then printf '  %-48s ...' "$name"; else printf '  %s ...\n' "$name"; fi
    ticker "$name" "$log" &
    ticker=$!
    "$@" >>"$log" 2>&1 </dev/null || rc=$?
    { kill "$ticker" && wait "$ticker"; } 2>/dev/null || true
    if [ -t 1 ]; then printf '\r'; fi
    if [ "$rc" -eq 0 ]; then
        printf '  %-48s ok      %4d s\n' "$name" $((SECONDS - began))
    elif [ "$rc" -eq "${STEP_SKIPPED:--1}" ]; then
        printf '  %-48s skipped (%s)\n' "$name" "$(tail -n 1 "$log" | sed 's/^skipped: //')"
    else
        printf '  %-48s FAILED  %4d s\n' "$name" $((SECONDS - began))
        printf '    status %d, what %s says of failures, and its end:\n' "$rc" "$log" >&2
        grep -nE -B 8 -A 6 'panicked at|\.\.\. FAILED|^error(\[|:)|signal: ' "$log" | head -n 80 | sed 's/^/    | /' >&2 || true
        tail -n "${STEP_TAIL:-25}" "$log" | sed 's/^/    | /' >&2
    fi
    return "$rc"
}

# with_lock NAME COMMAND...: one process at a time may fill a part of the cache.
with_lock() {
    local name=$1
    shift
    { mkdir -p "$M4GN_CACHE" && : >>"$M4GN_CACHE/.$name.lock"; } ||
        die "$M4GN_CACHE cannot be written to" "It keeps what is downloaded. Set M4GN_CACHE to a folder of yours, and run this again."
    (flock -n 9 || { echo "  waiting for another set-up, which fills $M4GN_CACHE" && flock 9; } && "$@") 9>"$M4GN_CACHE/.$name.lock"
}

# True where the user has sourced an OpenFOAM of their own, with headers to compile against.
foam_sourced() {
    [ -n "${WM_PROJECT_DIR:-}" ] && [ -d "$WM_PROJECT_DIR/src/OpenFOAM/lnInclude" ]
}

# solids4foam_environment: the solver of SOLIDS4FOAM_INST_DIR, else the one that setup/solids4foam.sh has put into the cache, is found by
# its name. False: there is none.
solids4foam_environment() {
    local folder=${SOLIDS4FOAM_INST_DIR:-$M4GN_CACHE/solids4foam}
    [ -x "$folder/bin/solids4Foam" ] || [ -x "$folder/solids4Foam" ] || return 1
    export SOLIDS4FOAM_INST_DIR=$folder SOLIDS4FOAM_DIR=${SOLIDS4FOAM_DIR:-$folder/source} \
        SOLIDS4FOAM_LIB_DIR=${SOLIDS4FOAM_LIB_DIR:-$folder/lib} \
        PATH=$folder:$folder/bin:$PATH LD_LIBRARY_PATH=$folder:$folder/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
}

# The cores that this process may use. (nproc alone answers with OMP_NUM_THREADS, which is 1 in tests.)
cores() { env -u OMP_NUM_THREADS nproc; }

# compilers [OTHERS]: how many run at once beside so many others: one a core, and no more than the memory has room for, 1.5 GB each
compilers() {
    local room
    room=$(awk -v others="${1:-0}" '/^MemAvailable:/ { print int($2/1.5e6) - others }' /proc/meminfo)
    printf '%s\n' "$(cores)" "$((room > 0 ? room : 1))" | sort -n | head -n 1
}

need_cargo() {
    local bin=${CARGO_HOME:-$HOME/.cargo}/bin
    if ! command -v cargo >/dev/null && [ -x "$bin/cargo" ]; then PATH=$bin:$PATH; fi
    command -v cargo >/dev/null || die "cargo was not found: not on PATH, not in $bin" \
        "Install the Rust toolchain with rustup (https://rustup.rs), then run this again."
    local needed found jobs
    needed=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' "$M4GN_HOME/Cargo.toml")
    found=$(cargo --version | cut -d' ' -f2) || die "$(command -v cargo) does not run" "With rustup, type: rustup default stable"
    printf '%s\n' "$needed" "$found" | sort -VC || die "$(command -v cargo) is version $found, and m4gn needs $needed or later" \
        "With rustup (https://rustup.rs), type: rustup update stable, and put $bin first in PATH. Then run this again."
    # The scripts and the documents name target/release; a target folder set elsewhere would break that.
    export CARGO_TARGET_DIR=$M4GN_HOME/target CARGO_NET_RETRY=${CARGO_NET_RETRY:-5}
    jobs=$(compilers)
    if [ "$jobs" -lt "$(cores)" ]; then export CARGO_BUILD_JOBS=${CARGO_BUILD_JOBS:-$jobs}; fi
}

# OpenMPI refuses root and more ranks than cores by default (PRTE: from version 5 on), and its shared-memory copies fail in containers;
# one thread per rank is what m4gn assumes.
mpi_environment() {
    export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMPI_MCA_rmaps_base_oversubscribe=1 \
        PRTE_MCA_rmaps_default_mapping_policy=${PRTE_MCA_rmaps_default_mapping_policy:-:oversubscribe} \
        OMPI_MCA_btl_vader_single_copy_mechanism=none OMPI_MCA_mpi_yield_when_idle=1 \
        OMP_NUM_THREADS=${OMP_NUM_THREADS:-1} OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
}
