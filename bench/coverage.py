#!/usr/bin/env python3
"""How often the error control's estimate of a jump holds, on cases that no training has seen.

    m4gn hybrid --model MODEL --count 12 --seed 4321 --plain none --keep-cases --out run/twelve
    bench/coverage.py run/twelve --model MODEL --start 3 --strides 10

The full run of each draw is carried on from --start with the surrogate in mode observe: beside the solver it takes a stride, from which the
control expects an error after each number of strides, and then a rollout of --strides strides, whose errors are measured. For
each tolerance the rollout is cut where the control would have ended the jump. Prints, for each tolerance, how many jumps
there were, in how many the error at the end was at most the tolerance, how long they were, and which share of the time they
would replace where each jump costs one stride of the solver. Needs env.sh sourced and the solver of the cases.
"""

import argparse
import hashlib
import json
import pathlib
import shutil
import sys

import foam_case

TOLERANCES = [0.005, 0.01, 0.015, 0.02, 0.03, 0.05, 0.07, 0.1]


def observe(full: pathlib.Path, folder: pathlib.Path, start: str, model: pathlib.Path, strides: int) -> pathlib.Path:
    """Runs the solver from the full run's state at `start` with an observer; its table."""
    table = folder / f"postProcessing/coverage/{start}/surrogateError.dat"
    finished, of_model = folder / "finished", hashlib.sha1(model.read_bytes()).hexdigest()
    if table.is_file() and finished.is_file() and finished.read_text() == of_model:
        return table
    if not (full / start / "U").is_file():
        sys.exit(f"{full}: no fields at time {start}; expected those of 'm4gn hybrid --keep-cases'")
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    solver = foam_case.copy(full, folder, start, "writeInterval 1e9;\n")
    foam_case.set_functions(
        folder,
        f'coverage {{ type m4gnSurrogate; libs (m4gnFoam); mode observe; model "{model}"; rolloutSteps {strides}; precision auto; '
        "control { tolerance 0.1; } }\n",
    )
    foam_case.run([solver], folder)
    finished.write_text(of_model)
    return table


def rollouts(table: pathlib.Path) -> list[list[tuple[float, float]]]:
    """(error, estimate) after 1, 2, ... strides of each whole rollout."""
    columns, all_rollouts = [], []
    for line in table.read_text().splitlines():
        words = line.split()
        if line.startswith("#"):
            columns = words[1:]
            continue
        row = dict(zip(columns, map(float, words)))
        if row["steps"] == 1:
            all_rollouts.append([])
        all_rollouts[-1].append((row["error"], row["estimate"]))
    longest = max(map(len, all_rollouts))
    return [r for r in all_rollouts if len(r) == longest]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=pathlib.Path, help="--out of m4gn hybrid --keep-cases")
    parser.add_argument("--model", type=pathlib.Path, required=True)
    parser.add_argument("--start", default="3", help="time from which is observed (a folder of the full runs)")
    parser.add_argument("--strides", type=int, default=10, help="longest jump")
    parser.add_argument("--json", type=pathlib.Path, help="write the figures to this file")
    args = parser.parse_args()
    found = {}
    for case in sorted(p for p in args.cases.iterdir() if (p / "full/system").is_dir()):
        table = observe(case / "full", case / f"coverage-{args.strides}", args.start, args.model.resolve(), args.strides)
        found[case.name] = rollouts(table)
    if not found:
        sys.exit(f"{args.cases}: no case with a folder 'full'; expected --out of 'm4gn hybrid --keep-cases'")
    print(f"{len(found)} cases, {sum(map(len, found.values()))} rollouts of {args.strides} strides")
    print("tolerance  jumps of starts  within  worst case  mean strides  replaced")
    figures = []
    for tolerance in TOLERANCES:
        jumps, starts, within, strides, worst = 0, 0, 0, 0, 1.0
        for case in found.values():
            own = [0, 0]
            for rollout in case:
                starts += 1
                allowed = 0
                while allowed < len(rollout) and rollout[allowed][1] <= tolerance:
                    allowed += 1
                if allowed:
                    held = rollout[allowed - 1][0] <= tolerance
                    own = [own[0] + held, own[1] + 1]
                    strides += allowed
            within += own[0]
            jumps += own[1]
            if own[1]:
                worst = min(worst, own[0] / own[1])
        share = within / jumps if jumps else None
        figures.append(
            {
                "tolerance": tolerance,
                "starts": starts,
                "jumps": jumps,
                "within": share,
                "worst_case": worst if jumps else None,
                "mean_strides": strides / jumps if jumps else 0,
                "replaced": strides / (strides + starts),
            }
        )
        f = figures[-1]
        held = f"{100 * share:6.1f} %  {100 * worst:8.0f} %" if jumps else "     -           - "
        print(
            f"{tolerance:9.3f}  {jumps:5} of {starts:5}  {held}  {f['mean_strides']:12.1f}  {100 * f['replaced']:7.0f} %"
        )
    if args.json:
        args.json.write_text(json.dumps({"cases": len(found), "strides": args.strides, "tolerances": figures}, indent=2))


if __name__ == "__main__":
    main()
