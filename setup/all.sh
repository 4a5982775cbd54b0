#!/usr/bin/env bash
# The whole set-up and build, quick when there is nothing to do.
#   setup/all.sh [core|all]    core: what runs (no libtorch, no Python); all (default): also training
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

what=${1:-all}
# What cannot be mended here is told before minutes of downloads
need_cargo
case $(realpath -m "${WM_PROJECT_DIR:-/usr/share/openfoam}") in
    # Debian's comes with the packages
    /usr/share/openfoam) ;;
    *) "$M4GN_HOME/setup/openfoam.sh" >/dev/null ;;
esac
"$M4GN_HOME/setup/debian.sh" "$what"
foam_sourced || "$M4GN_HOME/setup/openfoam-source.sh"
if [ "$what" = all ]; then "$M4GN_HOME/setup/libtorch.sh"; fi
"$M4GN_HOME/setup/build.sh" "$what"
