#!/usr/bin/env bash
# Makes the Python environment in which the solid data sets are computed (tools/m4gn_solids), in the cache.
#   setup/solids.sh    quick when there is nothing to do
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

requirements=$M4GN_HOME/tools/m4gn_solids/requirements.txt
environment=$M4GN_CACHE/solids

# The requirements are pinned for one Python: a second one would have other wheels.
find_python() {
    local candidate
    for candidate in /usr/bin/python3.11 python3.11 python3; do
        if "$candidate" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null; then
            command -v "$candidate"
            return
        fi
    done
    return 1
}

# The marker comes last, and the environment is never where it is not whole.
make_environment() {
    local new=$environment.tmp
    rm -rf "$new" "$environment"
    "$python" -m venv "$new" &&
        "$new/bin/python" -m pip install --disable-pip-version-check --no-cache-dir --progress-bar off --retries 5 \
            --no-deps --only-binary=:all: --require-hashes --requirement "$requirements" &&
        "$new/bin/python" -c 'import felupe, h5py, scipy.linalg' &&
        cksum <"$requirements" >"$new/.complete" &&
        mv -T "$new" "$environment"
}

complete() {
    [ "$(cat "$environment/.complete" 2>/dev/null)" = "$(cksum <"$requirements")" ] && "$environment/bin/python" -c '' 2>/dev/null
}

main() {
    complete && return
    [ "$(uname -m)" = x86_64 ] || die "the solid data sets need wheels for x86_64, and this is $(uname -m)"
    python=$(find_python) || die "no Python 3.11 with venv was found" \
        "Type setup/debian.sh all (or: apt-get install python3-venv) and run this again."
    step "Python environment for solids (60 MB)" make_environment ||
        die "the Python environment for the solid data sets could not be made in $environment" \
            "The packages come from the Python package index: check the network and pip's settings" \
            "($python -m pip config list), and that 300 MB are free, and run this again."
}

complete || with_lock solids main
