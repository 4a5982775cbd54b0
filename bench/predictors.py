#!/usr/bin/env python3
"""What a guess of the solution saves a solver: work and time with each predictor, by turns.

    bench/predictors.py run/beam/full --end 0.3
    bench/predictors.py run/cylinder/full --start 5 --end 6 --linear-solver "PCG; preconditioner DIC"

CASE is a case that has been run or can be; it is copied, not touched. With solidDisplacementFoam the guess is of the
displacement (function object m4gnPredictor), and the work is counted in correctors; with other solvers it is of the pressure
(linear solver m4gnPredicted), and the work is counted in iterations of the linear solver. Differences are those of the last
fields from the run without a guess, the largest one over the largest value. Needs env.sh sourced and the solver of the case.
"""

import argparse
import json
import pathlib
import re
import shutil
import statistics
import sys
import tempfile

import foam_case


def prepare(arguments: argparse.Namespace, folder: pathlib.Path, predictor: str) -> str:
    """A copy of the case with this predictor ('plain': as it is); the name of its solver."""
    interval = float(arguments.end) - float(arguments.start)
    entries = (
        f"libs (m4gnAccelerators);\nendTime {arguments.end};\nwriteControl runTime;\nwriteInterval {interval};\n"
        "writeFormat ascii;\nwritePrecision 12;\n"
    )
    solver = foam_case.copy(arguments.case, folder, arguments.start, entries)
    objects = ""
    if solver == "solidDisplacementFoam":
        if predictor != "plain":
            objects += f"predictor {{ type m4gnPredictor; libs (m4gnAccelerators); predictor {predictor}; }}\n"
    else:
        solution = folder / "system/fvSolution"
        linear = arguments.linear_solver
        if predictor != "plain":
            linear = f"m4gnPredicted; predictor {predictor}; linearSolver {linear}"
        changed, count = re.subn(r"(\bp\s*\{[^}]*?\bsolver\s+)\w+\s*;", rf"\g<1>{linear};", solution.read_text(), count=1)
        if not count:
            sys.exit(f"{solution}: no solver for p")
        solution.write_text(changed)
    foam_case.set_functions(folder, objects)
    return solver


def work(solver: str, folder: pathlib.Path) -> int:
    """Correctors of a solid, iterations for the pressure of a flow."""
    log = (folder / "log").read_text()
    if solver == "solidDisplacementFoam":
        return log.count("Solving for Dx")
    return sum(int(n) for n in re.findall(r"Solving for p,.*No Iterations (\d+)", log))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", type=pathlib.Path, metavar="CASE")
    parser.add_argument("--start", default="0", help="time to start from (default 0)")
    parser.add_argument("--end", required=True, help="time to end at")
    parser.add_argument("--linear-solver", default="GAMG", help="for the pressure, with its further entries (default GAMG)")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each kind; times are medians (default 3)")
    parser.add_argument("--json", type=pathlib.Path, help="write the figures to this file")
    arguments = parser.parse_args()
    kinds = ["plain", "none", "linear", "quadratic", "auto"]
    times: dict[str, list[float]] = {kind: [] for kind in kinds}
    figures: dict[str, dict] = {}
    with tempfile.TemporaryDirectory() as scratch:
        for repeat in range(arguments.repeats):
            for kind in kinds:
                folder = pathlib.Path(scratch) / f"{kind}-{repeat}"
                folder.mkdir()
                solver = prepare(arguments, folder, kind)
                times[kind].append(foam_case.run([solver], folder))
                if repeat == 0:
                    figures[kind] = {"work": work(solver, folder)}
                    name = "D" if solver == "solidDisplacementFoam" else "U"
                    values = foam_case.field(folder, name, arguments.end)
                    if kind == "plain":
                        plain = values
                    largest = max(abs(v) for v in plain)
                    figures[kind]["difference"] = max(abs(a - b) for a, b in zip(plain, values)) / largest
                shutil.rmtree(folder)
    unit = "correctors" if solver == "solidDisplacementFoam" else "iterations"
    print(f"{'predictor':10} {unit:>11} {'of plain':>9} {'time s':>8} {'of plain':>9} {'difference':>11}")
    for kind in kinds:
        row = figures[kind]
        row["seconds"] = statistics.median(times[kind])
        # Of the same round, so that what else the machine does weighs on both
        row["time_ratio"] = statistics.median(a / b for a, b in zip(times[kind], times["plain"]))
        row["work_ratio"] = row["work"] / max(figures["plain"]["work"], 1)
        print(
            f"{kind:10} {row['work']:11} {row['work_ratio']:9.3f} {row['seconds']:8.2f} {row['time_ratio']:9.3f} {row['difference']:11.1e}"
        )
    if arguments.json:
        arguments.json.write_text(json.dumps({"solver": solver, "unit": unit, "predictors": figures}, indent=1) + "\n")


if __name__ == "__main__":
    main()
