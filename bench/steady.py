"""Extrapolation of simpleFoam's iterations beside simpleFoam alone: iterations and time to its own force.

    setup/openfoam.sh --export          # an environment with simpleFoam
    bench/steady.py CASE --patches 'walls' --end 500 [--first 100] [--gap 10] [--states 5] [--pause 60]

CASE is a case with its mesh. It is run alone, and in pieces: after `first` iterations, and each `pause` iterations from there on, the
state becomes the combination of the last `states` states, `gap` iterations apart, whose change would be the smallest if an iteration were
linear (reduced rank extrapolation, Sidi 1991): all fields and the flux, boundary values included, by the same weights, which sum to 1, so that
the flux stays conservative. The change is measured in U, k and the like, each over its own size; what is positive stays between half and
twice what the solver left. Told are the iterations and the processor time from which on the force stays within .1 % of
what the run alone ends at.
"""

import argparse
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import numpy

LISTS = re.compile(r"nonuniform List<(scalar|vector)>\s*(\d+)\s*\(")
POSITIVE = {"k", "epsilon", "omega", "nuTilda", "nut", "alphat"}


def put(case, name, value):
    """An entry of controlDict."""
    path = case / "system/controlDict"
    path.write_text(path.read_text() + f"\n{name} {value};\n")


def run(case, end, write):
    """To iteration `end`. Gives the processor time of each iteration in s."""
    for name, value in (("endTime", end), ("startFrom", "latestTime"), ("writeInterval", write)):
        put(case, name, value)
    done = subprocess.run(["simpleFoam"], cwd=case, capture_output=True, text=True)
    (case / f"log.{end}").write_text(done.stdout + done.stderr)
    if done.returncode:
        sys.exit(f"{case}: simpleFoam failed: {done.stdout[-1000:]}{done.stderr[-1000:]}")
    times = [float(t) for t in re.findall(r"ExecutionTime = ([\d.]+)", done.stdout)]
    return list(numpy.diff(times, prepend=times[0])) if times else []


class Field:
    """The lists of numbers of an ASCII file, in one row, and the text between them."""

    def __init__(self, path):
        self.text, self.spans, values = path.read_text(), [], []
        for found in LISTS.finditer(self.text):
            ends = [self.text.find(end, found.end() - 1) for end in ("\n)\n", ");")]
            end = min(e for e in ends if e >= 0)
            row = numpy.array(re.sub("[()]", " ", self.text[found.end() : end]).split(), float)
            if row.size != int(found[2]) * (3 if found[1] == "vector" else 1):
                sys.exit(f"{path}: a list of {found[2]} has {row.size} numbers")
            self.spans.append((found.end(), end, 3 if found[1] == "vector" else 1))
            values.append(row)
        self.sizes = [v.size for v in values]
        self.values = numpy.concatenate(values) if values else numpy.zeros(0)

    def write(self, path, values):
        parts, at, first = [], 0, 0
        for (begin, end, width), size in zip(self.spans, self.sizes):
            rows = values[first : first + size].reshape(-1, width)
            one = ("{:.15g}" if width == 1 else "({:.15g} {:.15g} {:.15g})").format
            parts += [self.text[at:begin], "\n", "\n".join(one(*row) for row in rows)]
            at, first = end, first + size
        path.write_text("".join(parts) + self.text[at:])


def extrapolate(case, now, gap, states):
    """Puts a combination of the states up to iteration `now` in its place. Says whether it did."""
    folders = [case / str(now - gap * i) for i in reversed(range(states))]
    names = sorted(p.name for p in folders[-1].iterdir() if p.is_file())
    fields = {n: [Field(f / n) for f in folders] for n in names if all((f / n).is_file() for f in folders)}
    # A patch may have become uniform: such a field is left.
    fields = {n: f for n, f in fields.items() if all(g.sizes == f[-1].sizes for g in f)}
    changes = []
    for name, given in fields.items():
        if name in ("p", "phi"):
            continue
        rows = numpy.array([f.values for f in given])
        size = numpy.sqrt(((rows[-1] - rows[-1].mean()) ** 2).sum()) or 1.0
        changes.append(numpy.diff(rows, axis=0) / size)
    if not changes:
        return False
    change = numpy.concatenate(changes, axis=1).T
    gram = change.T @ change
    weights = numpy.linalg.solve(gram + 1e-10 * numpy.trace(gram) * numpy.eye(len(gram)), numpy.ones(len(gram)))
    weights /= weights.sum()
    if not numpy.isfinite(weights).all():
        return False
    for name, given in fields.items():
        last = given[-1].values
        values = sum(w * f.values for w, f in zip(weights, given[1:]))
        if name in POSITIVE:
            values = numpy.clip(values, 0.5 * last, 2 * last)
        given[-1].write(folders[-1] / name, values)
    return True


def quantities(case):
    """Iterations, and of each the pressure and viscous force on the patches together."""
    rows = {}
    for file in sorted(case.glob("postProcessing/steadyForces/*/force.dat"), key=lambda f: int(f.parent.name)):
        for line in file.read_text().splitlines():
            numbers = re.sub("[()]", " ", line).split()
            if numbers and not line.startswith("#"):
                rows[int(float(numbers[0]))] = [float(x) for x in numbers[1:4]]
    return numpy.array(sorted(rows)), numpy.array([rows[i] for i in sorted(rows)])


def reached(iterations, force, end):
    """The iteration from which on the force is within .1 % of `end`; none: never."""
    off = numpy.linalg.norm(force - end, axis=1) > 1e-3 * numpy.linalg.norm(end)
    late = numpy.flatnonzero(off)
    at = 0 if late.size == 0 else late[-1] + 1
    return int(iterations[at]) if at < len(iterations) else None


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("case", type=pathlib.Path)
    options.add_argument("--patches", required=True, help="whose force is looked at: a name or a regular expression")
    for name, value in (("end", 500), ("first", 100), ("gap", 10), ("states", 5), ("pause", 60)):
        options.add_argument(f"--{name}", type=int, default=value)
    given = options.parse_args()
    if given.first < given.gap * given.states or given.pause < given.gap * given.states:
        sys.exit("first and pause: expected at least gap x states iterations")
    with tempfile.TemporaryDirectory() as folder:
        end = None
        for kind in ("alone", "extrapolated"):
            case = pathlib.Path(folder) / kind
            shutil.copytree(given.case, case, symlinks=True)
            # Both go on to the end.
            remove = ["foamDictionary", "-entry", "SIMPLE.residualControl", "-remove", "system/fvSolution"]
            subprocess.run(remove, cwd=case, capture_output=True)
            functions = (
                f'steadyForces {{ type forces; libs (forces); patches ("{given.patches}"); rho rhoInf; rhoInf 1; CofR (0 0 0); '
                "writeControl timeStep; writeInterval 1; }"
            )
            put(case, "functions", "{ " + functions + " }\nwriteFormat ascii")
            for name, value in (("writeControl", "timeStep"), ("writePrecision", 15), ("timePrecision", 10), ("purgeWrite", 0)):
                put(case, name, value)
            if kind == "alone":
                seconds = run(case, given.end, given.end)
            else:
                seconds, now, made = [], 0, 0
                while now < given.end:
                    now = min(given.end, now + given.pause if now else given.first)
                    seconds += run(case, now, given.gap)
                    made += now < given.end and extrapolate(case, now, given.gap, given.states)
            iterations, force = quantities(case)
            end = force[-1] if end is None else end
            at = reached(iterations, force, end)
            time = f"{sum(seconds[:at]):.1f} s" if at else "-"
            extra = "" if kind == "alone" else f", {made} extrapolations"
            print(f"{kind}: {at or 'never'} iterations, {time}, force at the end {force[-1]}{extra}")


if __name__ == "__main__":
    main()
