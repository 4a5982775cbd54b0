# shellcheck shell=bash
# What the tutorials' Allrun do alike. Sourced by one that has set here, its folder.
# shellcheck source=setup/common.sh
. "$here/../../../setup/common.sh"
# shellcheck source=env.sh
. "$M4GN_HOME/env.sh"
mpi_environment

# shellcheck disable=SC2154  # here
results=$(realpath -m -- "${M4GN_RUN:-$M4GN_HOME/run}")/$(basename "$here")
repeats=3

# own_option NAME VALUE: takes an option that this tutorial has beside --repeats, --end and --model; status 1: it has none of this name
own_option() { return 1; }

# read_options OPTION...
read_options() {
    while [ $# -gt 0 ]; do
        case $1 in
            -h | --help) usage; exit 0 ;;
            --repeats) repeats=${2:-} ;;
            --end) endTime=${2:-} ;;
            --model) model=${2:+$(realpath -m -- "$2")} ;;
            *) own_option "$1" "${2:-}" || { usage >&2; echo "unknown argument '$1'" >&2; exit 2; } ;;
        esac
        shift 2 || { usage >&2; echo "an option has no value" >&2; exit 2; }
    done
    case $repeats in '' | *[!0-9]* | 0) echo "--repeats: expected a positive number" >&2; exit 2 ;; esac
    case $endTime in '' | *[!0-9.]*) echo "--end: expected a time in seconds" >&2; exit 2 ;; esac
    [ -f "$model" ] || die "there is no model $model" "Give one with --model FILE"
}

# needs PROGRAM...
needs() {
    local program remedy="Type ./Allrun --setup-only in $M4GN_HOME"
    [ -e "$M4GN_HOME/Allrun" ] || remedy="Install the packages that m4gn recommends, gmsh among them"
    for program in "$@" decomposePar mpirun m4gn; do
        command -v "$program" > /dev/null || die "$program is not in PATH" "$remedy"
    done
}

# anew FILE...: the folder of the results, without these of an earlier run
anew() {
    rm -rf "$@"
    mkdir -p "$results" || die "the results cannot be put into $results" "Type: m4gn tutorial $(basename "$here") --out FOLDER"
    aside=$(mktemp -d "$results/old.XXXXXX")
    trap 'rm -rf "$aside"' EXIT
}

# literal TEXT: as sed's replacement in s|||
literal() { sed 's/[&|\\]/\\&/g' <<< "$1"; }

# logged LOG COMMAND...: runs in the current folder; shows the log's end when it fails.
logged() {
    local log=$1
    shift
    "$@" > "$log" 2>&1 || {
        local status=$?
        tail -n 25 "$log" >&2
        die "$1 ended with status $status in $PWD" "The whole log is $PWD/$log"
    }
}

# timed CASE COMMAND...: runs the solver afresh, appends its wall time to CASE/wall.
timed() {
    local case=$1 began old
    shift
    cd "$case"
    # Set aside, not deleted: a file system may be slow to make files just after it has deleted many
    old=$(mktemp -d "$aside/XXXXXX")
    find . -maxdepth 1 -name '[0-9]*' ! -name 0 -exec mv -t "$old" {} +
    rm -rf postProcessing 0/m4gnSegment
    began=$EPOCHREALTIME
    # shellcheck disable=SC2154  # of the tutorial
    logged "log.$solver" "$@"
    awk "BEGIN{printf \"%.2f\n\", $EPOCHREALTIME - $began}" | tee -a wall
}

median() { sort -n "$1" | awk '{v[NR] = $1} END {printf "%.2f", NR % 2 ? v[(NR + 1)/2] : (v[NR/2] + v[NR/2 + 1])/2}'; }

# by_turns KIND...: the solver in the cases of these names; the first is that without a surrogate
by_turns() {
    local i kind seconds separator
    for ((i = 1; i <= repeats; ++i)); do
        printf '  run %d of %d' "$i" "$repeats"
        separator=:
        for kind in "$@"; do
            seconds=$(timed "$results/$kind" "$solver")
            printf '%s %s %s s' "$separator" "$kind" "$seconds"
            separator=,
        done
        echo
    done
    printf '  medians'
    separator=:
    for kind in "$@"; do
        printf '%s %s %s s' "$separator" "$kind" "$(median "$results/$kind/wall")"
        separator=,
    done
    echo
}

# on_two_ranks KIND: the case KIND-np2
on_two_ranks() {
    local seconds
    cd "$results/$1-np2"
    logged log.decomposePar decomposePar
    seconds=$(timed "$PWD" mpirun -np 2 "$solver" -parallel)
    printf '  %s on two ranks: %s s\n\n' "$1" "$seconds"
}

# replaced KIND: the share of its time that was not solved
replaced() { sed -n 's/^m4gn: \(replacedFraction.*\)/\1\n/p' "$results/$1/log.$solver"; }
