#!/usr/bin/env python3
"""What m4gn adds to the start of a solver: milliseconds and shared libraries.

    bench/start.py CASE [HOME:CASE ...] --repeats 10

CASE is a case with its function objects in place, whose start time has fields; HOME is another checkout of m4gn that is built, to compare
with (M4GN_HOME in the case's dictionaries is then HOME). Each case is copied and run for one time step, with its function objects and without
them (-noFunctionObjects), all by turns; the difference is the start of m4gn and its first execution. Needs env.sh sourced and the solver of
the case.
"""

import argparse
import json
import os
import pathlib
import re
import statistics
import subprocess
import sys
import tempfile

import foam_case


def environment(home: pathlib.Path) -> dict[str, str]:
    """That of this process, with the libraries of a checkout in front."""
    libraries = f"{home / 'lib'}:{os.environ.get('LD_LIBRARY_PATH', '')}"
    return {**os.environ, "M4GN_HOME": str(home), "LD_LIBRARY_PATH": libraries}


def libraries(command: list[str], folder: pathlib.Path, env: dict[str, str]) -> int:
    """How many shared libraries the loader has initialised by the end."""
    traced = {**env, "LD_DEBUG": "files"}
    done = subprocess.run(command, cwd=folder, env=traced, capture_output=True, text=True)
    return len(set(re.findall(r"calling init: (\S+)", done.stderr)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="+", metavar="CASE")
    parser.add_argument("--repeats", type=int, default=10, help="runs of each (default 10)")
    parser.add_argument("--start", default="0", help="time to start from (default 0)")
    parser.add_argument("--json", type=pathlib.Path, help="write the figures to this file")
    arguments = parser.parse_args()
    own = pathlib.Path(__file__).resolve().parent.parent
    with tempfile.TemporaryDirectory() as scratch:
        runs = []
        for number, case in enumerate(arguments.cases):
            home, _, path = case.rpartition(":")
            folder = pathlib.Path(scratch) / str(number)
            folder.mkdir()
            step = re.search(r"^\s*deltaT\s+([-+.\deE]+);", (pathlib.Path(path) / "system/controlDict").read_text(), flags=re.M)
            if not step:
                sys.exit(f"{path}/system/controlDict: no entry deltaT with a number")
            end = float(arguments.start) + float(step.group(1))
            entries = f"endTime {end:.12g};\nwriteControl timeStep;\nwriteInterval 1000000;\n"
            solver = foam_case.copy(pathlib.Path(path), folder, arguments.start, entries)
            env = environment(pathlib.Path(home).resolve() if home else own)
            runs += [(case, "without", [solver, "-noFunctionObjects"], folder, env), (case, "with", [solver], folder, env)]
        times = [[1000 * foam_case.run(*what[2:]) for what in runs] for _ in range(arguments.repeats + 1)][1:]
        medians = [statistics.median(column) for column in zip(*times)]
        figures = []
        print(f"{'case':40} {'without ms':>10} {'with ms':>10} {'m4gn ms':>10} {'libraries':>10} {'more':>6}")
        for i in range(0, len(runs), 2):
            counts = [libraries(*what[2:]) for what in runs[i : i + 2]]
            row = {"case": runs[i][0], "without_ms": medians[i], "with_ms": medians[i + 1], "libraries": counts}
            figures.append(row)
            print(
                f"{row['case'][-40:]:40} {medians[i]:10.1f} {medians[i + 1]:10.1f} {medians[i + 1] - medians[i]:10.1f}"
                f" {counts[1]:10} {counts[1] - counts[0]:6}"
            )
        if arguments.json:
            arguments.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
