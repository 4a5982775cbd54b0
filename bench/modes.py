#!/usr/bin/env python3
"""Modes and segments of a large mesh: m4gn beside scipy's eigsh and pymetis on the same matrix.

Makes an environment of its own outside the checkout, exports the matrix from m4gn, runs both sides alternately in
processes of their own, and prints medians of the wall time and of the peak resident memory (VmHWM).
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

PACKAGES = ["numpy==2.4.6", "scipy==1.17.1", "pymetis==2025.2.2", "h5py==3.16.0"]
ROOT = pathlib.Path(__file__).resolve().parent.parent
CACHE = pathlib.Path(os.environ.get("M4GN_CACHE", pathlib.Path.home() / ".cache" / "m4gn"))


def environment():
    """The Python of an environment with the pinned packages."""
    place = CACHE / "venv-modes"
    python = place / "bin" / "python"
    stamp = place / "packages"
    if not stamp.exists() or stamp.read_text() != "\n".join(PACKAGES):
        subprocess.run([sys.executable, "-m", "venv", str(place)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "--quiet", *PACKAGES], check=True)
        stamp.write_text("\n".join(PACKAGES))
    return str(python)


def peak_mb():
    with open("/proc/self/status") as status:
        for line in status:
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    return float("nan")


def theirs(path, modes, segments):
    """In the environment: the other side's work on the exported matrix."""
    import h5py
    import numpy as np
    import pymetis
    import scipy.sparse as sp
    import scipy.sparse.linalg as sl

    with h5py.File(path) as f:
        k = sp.csr_matrix((f["data"][:], f["indices"][:].astype(np.int32), f["indptr"][:].astype(np.int32)))
        volumes = f["volumes"][:]
    k.sum_duplicates()
    start = time.perf_counter()
    values, _ = sl.eigsh(k.tocsc(), k=modes, M=sp.diags(volumes).tocsc(), sigma=0)
    eigen = time.perf_counter()
    # The graph without its loops.
    loops = k.indices == np.repeat(np.arange(k.shape[0], dtype=np.int32), np.diff(k.indptr))
    counts = np.diff(k.indptr) - np.add.reduceat(loops, k.indptr[:-1])
    pymetis.part_graph(
        segments, xadj=np.concatenate([[0], np.cumsum(counts)]).astype(np.int32), adjncy=k.indices[~loops]
    )
    end = time.perf_counter()
    print(
        json.dumps(
            {
                "seconds": end - start,
                "eigen_s": eigen - start,
                "metis_s": end - eigen,
                "peak_mb": peak_mb(),
                "eigenvalues": sorted(values.tolist()),
            }
        )
    )


def run(command, timeout):
    env = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, env=env)
    except subprocess.TimeoutExpired:
        return {"seconds": float("inf"), "peak_mb": float("nan"), "failed": f"stopped after {timeout} s"}
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
        return {"seconds": float("inf"), "peak_mb": float("nan"), "failed": last}
    return json.loads(done.stdout.strip().splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=200_000)
    parser.add_argument("--shape", default="quads", choices=["quads", "triangles", "hexahedra", "disk"])
    parser.add_argument("--modes", type=int, default=6)
    parser.add_argument("--segments", type=int, default=36)
    parser.add_argument("--rounds", type=int, default=3, help="runs of each side, alternating")
    parser.add_argument("--timeout", type=int, default=1800, help="of one run, s")
    parser.add_argument("--json", help="also write the figures to this file")
    parser.add_argument("--theirs", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.theirs:
        return theirs(arguments.theirs, arguments.modes, arguments.segments)

    python = environment()
    build = ["cargo", "build", "--release", "--example", "modal_cost"]
    subprocess.run(build, cwd=ROOT, check=True)
    target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    example = [str(target / "release" / "examples" / "modal_cost")]
    example += ["--cells", str(arguments.cells), "--shape", arguments.shape, "--modes", str(arguments.modes)]
    figures = {"m4gn": [], "m4gn, modes only": [], "scipy + pymetis": []}
    with tempfile.TemporaryDirectory() as folder:
        matrix = str(pathlib.Path(folder) / "matrix.h5")
        subprocess.run([*example, "--export", matrix], check=True)
        other = [python, __file__, "--theirs", matrix, "--modes", str(arguments.modes)]
        sides = {
            "m4gn": [*example, "--segments", str(arguments.segments)],
            "m4gn, modes only": [*example, "--segments", "0"],
            "scipy + pymetis": [*other, "--segments", str(arguments.segments)],
        }
        for _ in range(arguments.rounds):
            for name, command in sides.items():
                figures[name].append(run(command, arguments.timeout))

    cells = next((r["cells"] for r in figures["m4gn"] if "cells" in r), arguments.cells)
    print(f"{cells} {arguments.shape}, {arguments.modes} modes, {arguments.segments} segments, one thread,")
    print(f"medians of {arguments.rounds} alternating runs\n")
    print(f"{'':<20}{'wall time, s':>14}{'peak memory, MB':>18}")
    for name, runs in figures.items():
        seconds = statistics.median(r["seconds"] for r in runs)
        memory = statistics.median(r["peak_mb"] for r in runs)
        print(f"{name:<20}{seconds:>14.2f}{memory:>18.0f}")
        for failed in {r["failed"] for r in runs if "failed" in r}:
            print(f"    {failed}")
    eigen = [r["eigen_s"] for r in figures["scipy + pymetis"] if "eigen_s" in r]
    if eigen:
        metis = statistics.median(r["metis_s"] for r in figures["scipy + pymetis"] if "metis_s" in r)
        print(f"    of which eigsh {statistics.median(eigen):.2f} s, part_graph {metis:.2f} s")
    ours = figures["m4gn, modes only"][0].get("eigenvalues")
    others = figures["scipy + pymetis"][0].get("eigenvalues")
    if ours and others:
        off = max(abs(a / b - 1) for a, b in zip(ours, others))
        print(f"\nlargest relative difference of the eigenvalues: {off:.1e}")
    if arguments.json:
        pathlib.Path(arguments.json).write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
