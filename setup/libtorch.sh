#!/usr/bin/env bash
# Fetches libtorch (CPU) into the cache, from the PyPI wheel that has it. Only training and the full tests need it.
# A libtorch of your own is used instead where LIBTORCH names its folder.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/common.sh"

downloads=$M4GN_CACHE/wheels

# The first Python that has pip; the wheels are data for us, so its version does not matter.
find_python() {
    local candidate
    for candidate in /usr/bin/python3 python3; do
        if "$candidate" -m pip --version >/dev/null 2>&1; then
            echo "$candidate"
            return
        fi
    done
    return 1
}

fetch() {
    mkdir -p "$downloads" || return
    cat >"$downloads/requirements.txt" <<EOF
torch==$TORCH_VERSION --hash=sha256:$TORCH_SHA256
nvidia-cuda-runtime==$CUDART_VERSION --hash=sha256:$CUDART_SHA256
nvidia-cuda-cupti==$CUPTI_VERSION --hash=sha256:$CUPTI_SHA256
EOF
    "$python" -m pip download --disable-pip-version-check --no-cache-dir --progress-bar off --retries 5 \
        --no-deps --only-binary=:all: --python-version 3.11 --implementation cp \
        --platform manylinux_2_28_x86_64 --platform manylinux_2_25_x86_64 --platform manylinux2014_x86_64 \
        --require-hashes --requirement "$downloads/requirements.txt" --dest "$downloads"
}

unpack() {
    local tmp=$TORCH_DIR.tmp
    rm -rf "$tmp" "$TORCH_DIR"
    "$python" - "$downloads" "$tmp" <<'EOF' || return
import pathlib, shutil, sys, zipfile

downloads, target = map(pathlib.Path, sys.argv[1:])
wanted = {
    "torch-*.whl": ["torch/include/", "torch/lib/libtorch_cpu.so", "torch/lib/libc10.so", "torch/lib/libgomp.so.1"],
    # libtorch_cpu.so of this wheel is linked to both, also where there is no GPU
    "nvidia_cuda_runtime-*.whl": ["nvidia/cu13/lib/libcudart.so.13"],
    "nvidia_cuda_cupti-*.whl": ["nvidia/cu13/lib/libcupti.so.13"],
}
for pattern, prefixes in wanted.items():
    (wheel,) = downloads.glob(pattern)
    with zipfile.ZipFile(wheel) as archive:
        for prefix in prefixes:
            names = [n for n in archive.namelist() if n.startswith(prefix) and not n.endswith("/")]
            if not names:
                sys.exit(f"{wheel.name} has no {prefix}")
            for name in names:
                path = target / name.removeprefix("torch/").removeprefix("nvidia/cu13/")
                path.parent.mkdir(parents=True, exist_ok=True)
                with archive.open(name) as source, open(path, "wb") as sink:
                    shutil.copyfileobj(source, sink)
EOF
    # The wheel's own libtorch.so drags in the CUDA libraries; the linker needs only the name.
    echo 'INPUT(-ltorch_cpu)' >"$tmp/lib/libtorch.so" &&
        echo "$TORCH_VERSION" >"$tmp/build-version" &&
        echo "$stamp" >"$tmp/.complete" &&
        mv -T "$tmp" "$TORCH_DIR" &&
        rm -rf "$downloads"
}

stamp="$TORCH_SHA256 $CUDART_SHA256 $CUPTI_SHA256"
complete() { [ "$(cat "$TORCH_DIR/.complete" 2>/dev/null)" = "$stamp" ]; }

main() {
    complete && return
    [ "$(uname -m)" = x86_64 ] || die "libtorch is fetched for x86_64 only, and this is $(uname -m)" \
        "Set LIBTORCH to the folder of a libtorch $TORCH_VERSION and run this again."
    python=$(find_python) || die "no Python with pip was found, which downloads libtorch" \
        "Type setup/debian.sh all (or: apt-get install python3-pip) and run this again."
    step "libtorch $TORCH_VERSION (550 MB)" fetch ||
        die "libtorch could not be downloaded from the Python package index" \
            "Check the network and pip's settings ($python -m pip config list), or set LIBTORCH to the folder of a" \
            "libtorch $TORCH_VERSION (the 'torch' folder of a Python installation will do), and run this again."
    step "libtorch unpacked" unpack ||
        die "libtorch could not be unpacked into $TORCH_DIR" \
            "Free some disk space (1.2 GB are needed) or set M4GN_CACHE to another folder, and run this again."
}

if [ -n "${LIBTORCH:-}" ] && [ "$LIBTORCH" != "$TORCH_DIR" ]; then
    [ -e "$LIBTORCH/lib/libtorch_cpu.so" ] || die "LIBTORCH=$LIBTORCH holds no lib/libtorch_cpu.so" \
        "Unset it to have libtorch $TORCH_VERSION fetched, or set it to a folder with include/ and lib/."
else
    complete || with_lock libtorch main
fi
