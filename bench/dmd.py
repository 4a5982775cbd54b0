"""PyDMD's HODMD beside m4gn-dmd on the same snapshots: eigenvalues, time, memory.

    python3 -m venv /tmp/pydmd && /tmp/pydmd/bin/pip install pydmd
    cargo build --release -p m4gn-dmd --example decompose
    /tmp/pydmd/bin/python bench/dmd.py [--numbers 20000] [--states 40] [--delays 8] [--rank 12]

The snapshots are waves that travel and decay, with noise of 1e-3, so that the rank cuts off what is there. Exit status 1 where
an eigenvalue differs by more than 1e-8.
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import time
import tracemalloc

import numpy
from pydmd import HODMD


def snapshots(numbers, states):
    """[numbers, states], the mean taken away."""
    random = numpy.random.default_rng(7)
    x = numpy.linspace(0, 2 * numpy.pi, numbers)[:, None]
    k = numpy.arange(states)[None, :]
    waves = sum(0.5**n * 0.997 ** (n * k) * numpy.sin(n * x - 0.41 * n**0.5 * k) for n in range(1, 6))
    waves = waves + 1e-3 * random.standard_normal((numbers, states))
    return waves - waves.mean(axis=1, keepdims=True)


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, value in (("numbers", 20000), ("states", 40), ("delays", 8), ("rank", 12)):
        options.add_argument(f"--{name}", type=int, default=value)
    given = options.parse_args()
    states = snapshots(given.numbers, given.states)

    tracemalloc.start()
    begun = time.perf_counter()
    peer = HODMD(svd_rank=given.rank, svd_rank_extra=-1, d=given.delays).fit(states)
    seconds = time.perf_counter() - begun
    memory = tracemalloc.get_traced_memory()[1]

    program = pathlib.Path(__file__).resolve().parents[1] / "target/release/examples/decompose"
    with tempfile.NamedTemporaryFile() as file:
        numpy.ascontiguousarray(states.T).tofile(file.name)
        text = subprocess.run(
            [program, file.name, *map(str, (given.states, given.delays, given.rank))],
            check=True, capture_output=True, text=True,
        ).stdout
    own = json.loads(text)
    ours = numpy.array([complex(*e) for e in own["eigenvalues"]])
    theirs = numpy.asarray(peer.eigs)
    distance = numpy.abs(ours[:, None] - theirs[None, :])
    print(f"eigenvalues: {len(ours)} and {len(theirs)}")
    print(f"largest difference: {max(distance.min(axis=1).max(), distance.min(axis=0).max()):.1e}")
    print(f"PyDMD: {seconds:.3f} s, {memory / 2**20:.0f} MiB beyond the snapshots")
    print(
        f"m4gn:  {own['products_s']:.3f} s for the inner products as the states come, {own['fit_s'] * 1e3:.1f} ms for the fit, "
        f"{own['stride_s'] * 1e3:.2f} ms a stride, {own['bytes'] / 2**20:.0f} MiB with the snapshots"
    )
    if len(ours) != len(theirs) or max(distance.min(axis=1).max(), distance.min(axis=0).max()) > 1e-8:
        sys.exit(1)


if __name__ == "__main__":
    main()
