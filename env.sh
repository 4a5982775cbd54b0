# shellcheck shell=bash
# Source this (bash or zsh): m4gn on PATH, and its libraries where OpenFOAM finds them, so that a case's controlDict
# may say: libs (m4gnFoam);

if [ -n "${ZSH_VERSION:-}" ]; then
    # shellcheck disable=SC2296  # zsh's name of the file being sourced
    eval 'M4GN_HOME=$(dirname "$(realpath "${(%):-%x}")")'
else
    M4GN_HOME=$(dirname "$(realpath "${BASH_SOURCE[0]}")")
fi
export M4GN_HOME

case ":$PATH:" in
    *":$M4GN_HOME/target/release:"*) ;;
    *) export PATH="$M4GN_HOME/target/release:$PATH" ;;
esac
case ":${LD_LIBRARY_PATH:-}:" in
    *":$M4GN_HOME/lib:"*) ;;
    *) export LD_LIBRARY_PATH="$M4GN_HOME/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}" ;;
esac
# Debian's OpenFOAM needs no more than this; one that is sourced already stays.
if [ -z "${WM_PROJECT_DIR:-}" ] && [ -d /usr/share/openfoam/etc ]; then
    export WM_PROJECT_DIR=/usr/share/openfoam
fi
# A library loads into the OpenFOAM that it was built for
if [ -n "${WM_PROJECT_DIR:-}" ] && [ -e "$M4GN_HOME/target/openfoam/.probe" ] &&
    ! grep -qxF "export M4GN_FOAM_PROJECT_DIR=$(printf %q "$WM_PROJECT_DIR")" "$M4GN_HOME/target/openfoam/.probe"; then
    echo "warning: m4gn's function objects are built for another OpenFOAM than $WM_PROJECT_DIR, and will not load into its solvers:" \
        "type '$M4GN_HOME/setup/build.sh core' in this shell" >&2
fi
