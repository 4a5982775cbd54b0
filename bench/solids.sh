#!/usr/bin/env bash
# Beams of rubber in solids4foam, by each way to run them: segregated, with m4gnAnderson, with Newton-Krylov, with surrogates. Processor time of the
# whole run over the segregated solver's, and over that of the fastest plain solver with no larger error; errors of D, stress and force at the clamp.
#   bench/solids.sh FOLDER [--newton FOLDER] [--only PATTERN]    docs/lab/2026-11-solids.md
# --newton: a solids4foam with Newton-Krylov (setup/solids4foam.sh SOURCE FOLDER; ~/.cache/m4gn/solids4foam-snes). A command that was stopped goes on.
. "$(dirname "${BASH_SOURCE[0]}")/../tests/e2e/common.sh"
needs_solids4foam

usage='usage: bench/solids.sh FOLDER [--newton FOLDER] [--only PATTERN]'
[ $# -gt 0 ] || die "no folder was given" "$usage"
cd "$OLDPWD" && mkdir -p "$1" && folder=$(realpath "$1")
shift
newton=$M4GN_CACHE/solids4foam-snes only=.
while [ $# -gt 0 ]; do
    case $1 in
        --newton) newton=$2 ;;
        --only) only=$2 ;;
        *) die "unknown argument $1" "$usage" ;;
    esac
    shift 2
done
cd "$folder"
echo 'dmd { snapshotInterval 0.06; }' > dmd

# hybrid PART NAME OPTIONS...: 'm4gn hybrid' of this row, in its folder PART; what it found is in NAME.json
hybrid() {
    local part=$row/$1 name=$row/$2
    shift 2
    m4gn hybrid --family "$family" --set "along=$along" --set "across=$across" --set "step=$step" --count "$count" --seed 4321 --end "$end" \
        --out "$part" --json "$name.json" "$@" > "$name.log" 2>&1 < /dev/null || warn "not all runs ended: $folder/$name.log"
}

# Each equation has its own tightly solved run: the branch's differs from that of 2.2 by its stabilisation, and so does the solution on a mesh.
# Rows that name a fit have Newton-Krylov alone, which is the fastest plain solver.
while read -r family along across step end count fit; do
    # Those that are pressed have one cell along the cylinder
    deep=$across
    [ "$family" != pressed-rubber ] || deep=1
    row=$family-$((along * across * deep))-$end
    grep -q -- "$only" <<< "$row" || continue
    mkdir -p "$row"
    (
        export SOLIDS4FOAM_INST_DIR=$newton
        unset SOLIDS4FOAM_DIR SOLIDS4FOAM_LIB_DIR
        solids4foam_environment || die "there is no solids4foam in $newton" "setup/solids4foam.sh builds it of its branch feature-petsc-snes."
        if [ -n "$fit" ]; then
            hybrid newton newton --set algorithm=newton-krylov --set tolerance=1e-2 --variant "dmd-newton=$fit" --baseline none
        else
            hybrid newton newton --set algorithm=newton-krylov --set tolerance=1e-8 --variant dmd-newton=dmd,anderson=off,tolerance=1e-4 \
                --baseline newton-2=tolerance=1e-2 --baseline newton-4=tolerance=1e-4
        fi
    )
    if [ -z "$fit" ]; then
        # Nobody can say beforehand what a contact will be, so that dmd refuses the pressed beams
        variant=(--variant dmd=dmd)
        [ "$family" != pressed-rubber ] || variant=()
        hybrid plain plain "${variant[@]}" --baseline anderson-6=anderson=on --baseline anderson-4=anderson=on,tolerance=1e-4 --keep-cases
        model=$M4GN_HOME/models/$family.safetensors
        [ ! -e "$model" ] || hybrid plain network --model "$model" --baseline none
    fi
    python3 "$M4GN_HOME/bench/solids.py" "$row"
done <<'EOD'
vibrating-rubber 20 2 2e-3 6.64 12
vibrating-rubber 40 4 5e-3 6.64 12 dmd
vibrating-rubber 56 6 5e-3 6.64 12 dmd
vibrating-rubber 78 8 5e-3 6.64 12 dmd
pressed-rubber 20 2 5e-3 3 12
pressed-rubber 40 4 5e-3 3 12
EOD
