#!/usr/bin/env python3
"""Whether memory or the cost of a step grows over many steps of a solver with m4gn.

    bench/long_run.py CASE --steps 20000

CASE is a case with its function objects in place, whose start time has fields; it is copied, and run for so many steps without writing.
Prints memory (resident) and wall time a step in each tenth of the run. Steps are those of Time: the solver's and the surrogate's. Needs
env.sh sourced and the solver of the case.
"""

import argparse
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import foam_case


def resident(pid: int) -> float:
    """Memory of a process, MB; 0 when it is gone."""
    try:
        text = pathlib.Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    found = re.search(r"VmRSS:\s*(\d+) kB", text)
    return int(found.group(1)) / 1000 if found else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", type=pathlib.Path, metavar="CASE")
    parser.add_argument("--steps", type=int, default=20000, help="steps of Time (default 20000)")
    parser.add_argument("--start", default="0", help="time to start from (default 0)")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(scratch) / "case"
        folder.mkdir()
        entries = "endTime 1e9;\nwriteControl timeStep;\nwriteInterval 1000000000;\n"
        solver = foam_case.copy(arguments.case, folder, arguments.start, entries)
        process = subprocess.Popen([solver], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        tenth = max(arguments.steps // 10, 1)
        steps, printed, began, tail = 0, 0, time.monotonic(), []
        print(f"{'steps':>8} {'memory MB':>10} {'ms a step':>10}")
        for line in process.stdout:
            tail = tail[-20:] + [line]
            found = re.match(r"Time = |m4gn: jumped (\d+) steps", line)
            if not found:
                continue
            steps += int(found.group(1) or 1)
            if steps - printed >= tenth:
                now = time.monotonic()
                print(f"{steps:8} {resident(process.pid):10.1f} {1000 * (now - began) / (steps - printed):10.2f}", flush=True)
                printed, began = steps, now
            if steps >= arguments.steps:
                process.kill()
                process.wait()
                return
        sys.exit(f"{solver} ended after {steps} steps:\n{''.join(tail)}")


if __name__ == "__main__":
    main()
