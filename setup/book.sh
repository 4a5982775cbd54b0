#!/usr/bin/env bash
# Renders docs/ as web pages: setup/book.sh [FOLDER]    (target/book)
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"
folder=$(realpath -m "${1:-$M4GN_HOME/target/book}")
# Debian's Python, which has Debian's Sphinx: one of the user's own may come before it in PATH
/usr/bin/python3 -m sphinx -q -W --keep-going -E "$M4GN_HOME/docs" "$folder" ||
    die "the book could not be rendered" "Sphinx, MyST and Furo are packages that setup/debian.sh installs."
echo "$folder/index.html"
