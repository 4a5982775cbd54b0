#!/usr/bin/env python3
"""A step of m4gn against NVIDIA PhysicsNeMo's MeshGraphNet and the project's own libtorch model.

All contestants are the same network (the same random weights; their outputs are compared first) on the same graph, in
processes of their own that live through the whole comparison and take turns: start-up is not measured, and a machine
that slows down slows all of them. PhysicsNeMo runs in the Python that --physicsnemo names (bench/README.md), in inference mode, as
it comes, with its options for speed (do_concat_trick, torch.compile), and under bf16 autocast.

With --train a step is one update in training (forward, backward, Adam) with batches of --batch graphs, in place of one
application.

The figures: fp32_vs_physicsnemo and bf16_vs_physicsnemo are its time as it comes over m4gn's in fp32 and bf16,
..._vs_physicsnemo_fastest the same for the fastest of its ways in fp32, bf16_vs_physicsnemo_bf16 for the fastest of its
ways in bf16; fp32_vs_tch and bf16_vs_tch are for the libtorch model. With --train: train_vs_physicsnemo (as it comes),
train_vs_physicsnemo_fastest (of all its ways, bf16 autocast with them) and train_vs_torch (m4gn's own training on libtorch, in the
precision that suits it best) over m4gn's native training in the precision that suits it best.
"""

import argparse
import contextlib
import itertools
import json
import os
import pathlib
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

from physicsnemo_worker import DEFAULT, VARIANTS

HOME = pathlib.Path(__file__).resolve().parent.parent
CACHE = pathlib.Path(
    os.environ.get("M4GN_CACHE")
    or pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache") / "m4gn"
)
TORCH = "2.11.0"


class Failure(Exception):
    """What went wrong and what to do about it."""


def main():
    args = arguments()
    try:
        figures = compare(args, args.physicsnemo)
        if args.json:
            args.json.write_text(json.dumps(figures, indent=2) + "\n")
    except (Failure, OSError, KeyboardInterrupt) as failure:
        print(f"compare.py: {failure or 'stopped'}", file=sys.stderr)
        return 1
    return 0


def arguments():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    add = parser.add_argument
    add("--layers", type=positive, nargs="+", default=[7, 15], metavar="L", help="message-passing layers (7 15)")
    add("--threads", type=positive, nargs="+", default=[1, 2], metavar="T", help="threads (1 2)")
    add("--width", type=positive, default=128, metavar="W", help="latent width (128)")
    add("--hidden", type=positive, default=2, metavar="H", help="hidden layers of each perceptron (2)")
    add("--nodes", type=positive, default=1900, metavar="N", help="nodes of the graph (1900)")
    add("--train", action="store_true", help="compare a step of training")
    add("--batch", type=positive, nargs="+", default=[2, 8], metavar="B", help="with --train: graphs in a batch (2 8)")
    add("--rounds", type=positive, default=15, metavar="R", help="turns of each contestant (15)")
    add("--m4gn", type=pathlib.Path, metavar="FILE", help="the program m4gn (of this checkout's target/release, or in PATH)")
    add("--json", type=pathlib.Path, metavar="FILE", help="write the figures to this file")
    add("--physicsnemo", type=pathlib.Path, metavar="PYTHON", help="a Python with PhysicsNeMo (README.md); without, the libtorch model only")
    add("--without-paper", action="store_true", help="leave out M4GN of the paper's size against the libtorch model")
    add("--no-compile", action="store_true", help="do not try PhysicsNeMo with torch.compile (a minute or more each)")
    return parser.parse_args()


def positive(text):
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("expected a positive number")
    return value


# Contestants


class Process:
    """A program that answers lines, on cores of its own choice."""

    def __init__(self, name, command, threads, variables=None):
        self.name = name
        self.errors = tempfile.TemporaryFile("w+")
        use = set(cores()[:threads])
        clean = {k: v for k, v in os.environ.items() if not k.startswith(("OMP_", "GOMP_", "KMP_", "MKL_"))}
        self.process = subprocess.Popen(
            [str(part) for part in command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            text=True,
            env=clean | {"OMP_NUM_THREADS": str(threads)} | (variables or {}),
            preexec_fn=lambda: os.sched_setaffinity(0, use),
        )
        self.description = json.loads(self.line())

    def line(self):
        line = self.process.stdout.readline()
        if not line:
            self.process.wait()
            self.errors.seek(0)
            raise Failure(f"{self.name} ended: {self.errors.read().strip()[-2000:]}")
        return line

    def ask(self, line):
        with contextlib.suppress(BrokenPipeError):
            self.process.stdin.write(line + "\n")
            self.process.stdin.flush()
        return self.line()

    def close(self):
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            self.process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class Contestant:
    """A step of a process, and the wall and processor times that it took, ms."""

    def __init__(self, name, process, request="run"):
        self.name, self.process, self.request = name, process, request
        self.times = []

    def run(self):
        wall, processor = map(float, self.process.ask(self.request).split())
        return wall, processor

    def turn(self):
        # The first step finds the caches full of the others' data, which no rollout does.
        self.run()
        self.times += [self.run() for _ in range(2)]

    def median(self):
        return statistics.median(wall for wall, _ in self.times)

    def processor(self):
        return statistics.median(processor for _, processor in self.times)


def by_turns(contestants, rounds):
    contestants = list(dict.fromkeys(contestants))
    for contestant in contestants:
        contestant.times = []
    for _ in range(rounds):
        for contestant in contestants:
            contestant.turn()
            # Threads of the last one may still be spinning.
            time.sleep(0.02)


def cores():
    return sorted(os.sched_getaffinity(0))


def compare(args, python):
    m4gn = args.m4gn or next(
        (p for p in [HOME / "target/release/m4gn", shutil.which("m4gn")] if p and pathlib.Path(p).is_file()), None
    )
    if m4gn is None or not pathlib.Path(m4gn).is_file():
        raise Failure("the program m4gn was not found: build it with setup/build.sh, or name it with --m4gn FILE")
    if max(args.threads) > len(cores()):
        raise Failure(f"--threads {max(args.threads)}: this machine gives {len(cores())} cores")
    results = []
    with tempfile.TemporaryDirectory() as scratch:
        cases = [(f"MeshGraphNet, {layers} layers", layers, []) for layers in args.layers]
        if not args.without_paper:
            cases.append(("M4GN of the paper's size, 7 layers and 4 of the transformer", 7, ["--segments", "36"]))
        for number, (title, layers, extra) in enumerate(cases):
            folder = pathlib.Path(scratch) / str(number)
            shape = ["--layers", layers, "--width", args.width, "--hidden", args.hidden, *extra]
            network = json.loads(run([m4gn, "bench", "--export", folder, *shape, "--nodes", args.nodes]))
            for threads, batch in itertools.product(args.threads, args.batch if args.train else [0]):
                print(
                    f"\n{title}, width {args.width}, {network['parameters']} parameters; {network['nodes']} nodes, "
                    f"{network['edges']} directed edges; {threads} thread{'s' if threads > 1 else ''}"
                    + (f"; training, {batch} graphs in a batch" if batch else ""),
                    flush=True,
                )
                # PhysicsNeMo has no M4GN.
                rival = None if extra else python
                results.append(match(args, m4gn, rival, folder, network, layers, threads, shape, batch))
                results[-1]["network"] = "m4gn" if extra else "mgn"
    figures = {"machine": machine(), "width": args.width, "results": results}
    if len(results) == 1:
        figures |= {k: v for k, v in results[0].items() if "_vs_" in k}
    return figures


def run(command):
    done = subprocess.run([str(x) for x in command], capture_output=True, text=True)
    if done.returncode != 0:
        raise Failure(done.stderr.strip())
    return done.stdout


def with_libtorch():
    """Variables with which m4gn finds libtorch."""
    libtorch = os.environ.get("LIBTORCH") or CACHE / f"libtorch-{TORCH}-cpu"
    paths = [f"{libtorch}/lib", os.environ.get("LD_LIBRARY_PATH", "")]
    return {"LD_LIBRARY_PATH": ":".join(p for p in paths if p)}


@contextlib.contextmanager
def starter(network):
    """Starts processes with a network of this size; they end together."""
    with contextlib.ExitStack() as stack:

        def start(*process):
            made = Process(*process)
            stack.callback(made.close)
            if made.description["parameters"] != network["parameters"]:
                found = made.description["parameters"]
                raise Failure(f"{made.name} has {found} parameters, expected {network['parameters']}")
            return made

        yield start


def show(everybody, ms):
    """A line for each contestant, with its time over those of m4gn."""
    print(f"  {'':<36} {'ms a step (quartiles)':>29}   over fp32  over bf16   processor ms")
    for contestant in dict.fromkeys(everybody.values()):
        low, _, high = statistics.quantiles([wall for wall, _ in contestant.times], n=4)
        median = contestant.median()
        print(
            f"  {contestant.name:<36} {median:8.2f} ({low:8.2f} {high:8.2f})  {median / ms['fp32']:10.2f} "
            f"{median / ms['bf16']:10.2f} {contestant.processor():14.2f}",
            flush=True,
        )


def match(args, m4gn, python, folder, network, layers, threads, shape, batch):
    """One network on one number of threads; its training with batches of one size, where that is not 0."""
    network_of = ["--train", *shape, "--batch", batch] if batch else ["--model", folder / "model.safetensors"]
    command = [m4gn, "bench", "--worker", *network_of, "--nodes", args.nodes, "--threads", threads]
    with starter(network) as start:
        everybody, row = {}, {"layers": layers, "threads": threads}
        for precision in ["fp32", "bf16"]:
            own = [*command, "--precision", precision]
            everybody[precision] = Contestant(f"m4gn, {precision}", start("m4gn", own, threads))
            if batch or precision == "fp32":
                process = start("m4gn on libtorch", [*own, "--backend", "torch"], threads, with_libtorch())
                everybody[f"torch_{precision}"] = Contestant(f"m4gn on libtorch, {precision}", process)
        if python:
            everybody |= physicsnemo(args, m4gn, python, folder, threads, start, row, batch)
        by_turns(everybody.values(), args.rounds)
        ms = row["ms"] = {name: c.median() for name, c in everybody.items()}
        row["processor_ms"] = {name: c.processor() for name, c in everybody.items()}
        if batch:
            best = min(ms["fp32"], ms["bf16"])
            row |= {"batch": batch, "train_vs_torch": min(ms["torch_fp32"], ms["torch_bf16"]) / best}
            if python:
                row["train_vs_physicsnemo"] = ms["physicsnemo"] / best
                row["train_vs_physicsnemo_fastest"] = min(ms["physicsnemo_fastest"], ms["physicsnemo_bf16"]) / best
        else:
            for name, rival in itertools.product(["fp32", "bf16"], ["torch_fp32", "physicsnemo", "physicsnemo_fastest"]):
                if rival in ms:
                    row[f"{name}_vs_{rival.replace('torch_fp32', 'tch')}"] = ms[rival] / ms[name]
            if python:
                row["bf16_vs_physicsnemo_bf16"] = ms["physicsnemo_bf16"] / ms["bf16"]
        show(everybody, ms)
        return row


def physicsnemo(args, m4gn, python, folder, threads, start, row, batch):
    """As it comes, and its fastest ways here in fp32 and under bf16 autocast."""
    run([m4gn, "convert", folder / "model.safetensors", "--as", "physicsnemo", "--out", folder / "physicsnemo.safetensors"])
    names = [name for name, (_, compiled) in VARIANTS.items() if not (compiled and args.no_compile)]
    request = {"folder": str(folder), "threads": threads, "variants": names, "batch": batch}
    script = [python, HOME / "bench/physicsnemo_worker.py", json.dumps(request)]
    variables = {"LD_LIBRARY_PATH": "", "CUDA_VISIBLE_DEVICES": "", "TORCHINDUCTOR_CACHE_DIR": str(CACHE / "torchinductor")}
    process = start("PhysicsNeMo", script, threads, variables)
    found = row["physicsnemo"] = process.description
    for name, why in found["failed"].items():
        print(f"  PhysicsNeMo ({name}) does not run here: {why}", flush=True)
    errors = ", ".join(f"{name} {error:.0e}" for name, error in found["errors"].items())
    print(f"  its outputs differ from m4gn's by, relative to the largest: {errors}", flush=True)
    ways = {
        kind: {name: Contestant(f"PhysicsNeMo {kind}, {name}", process, f"run {kind} {name}") for name in found[kind]}
        for kind in ["fp32", "bf16"]
    }
    by_turns([way for kind in ways.values() for way in kind.values()], 3)
    row["physicsnemo_ways"] = {kind: {name: c.median() for name, c in way.items()} for kind, way in ways.items()}
    for kind, way in row["physicsnemo_ways"].items():
        print(f"  its ways in {kind}: " + ", ".join(f"{name} {ms:.1f} ms" for name, ms in way.items()), flush=True)
    fastest = {kind: min(way.values(), key=Contestant.median) for kind, way in ways.items()}
    return {
        "physicsnemo": ways["fp32"][DEFAULT],
        "physicsnemo_fastest": fastest["fp32"],
        "physicsnemo_bf16": fastest["bf16"],
    }


def machine():
    with contextlib.suppress(OSError):
        for line in open("/proc/cpuinfo"):
            if line.startswith("model name"):
                return f"{line.split(':', 1)[1].strip()}, {len(cores())} cores"
    return "unknown"


if __name__ == "__main__":
    sys.exit(main())
