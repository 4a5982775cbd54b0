#!/usr/bin/env python3
"""Table of a row of bench/solids.sh: processor time of whole runs, over the segregated solver's and over that of the fastest plain solver
whose error of D is no larger; errors of D, of the stress and of the force on the clamp, over their root mean square; error of the force over
its range. Median, worst in brackets."""
import json
import math
import pathlib
import statistics
import sys


def read(folder):
    """Seconds, errors and replaced share by run and draw; which runs are plain; the name of the solver that is compared with."""
    runs, plain, first = {}, set(), None
    for part in ("newton", "plain", "network"):
        file = folder / f"{part}.json"
        if not file.exists():
            continue
        found = json.loads(file.read_text())
        plain |= {v["name"] for v in found["variants"] if "surrogates" not in v}
        settings = dict(s.split("=") for s in found["settings"])
        own = "segregated" if part != "newton" else f"newton-{round(-math.log10(float(settings['tolerance'])))}"
        for case in found["cases"]:
            if case["full"]:
                first = own
                plain.add(own)
                runs.setdefault(own, {})[case["index"]] = (case["full"]["cost"]["processor"], 0.0, 0.0, 0.0, 0.0, None)
            for name, run in case["runs"].items():
                score = run["score"]
                runs.setdefault("network" if name == "hybrid" else name, {})[case["index"]] = (
                    run["cost"]["processor"], score["displacement"], score["stress"], score["reaction"],
                    score["reaction_of_range"], score["replaced"])
    return runs, plain, first


def shown(values, scale=1.0):
    values = [scale * v for v in values if v is not None]
    if not values:
        return "-"
    worst = f" ({max(values):.2g})" if len(values) > 1 else ""
    return f"{statistics.median(values):.2g}{worst}"


def main():
    folder = pathlib.Path(sys.argv[1])
    runs, plain, first = read(folder)

    def middle(name, figure):
        return statistics.median(v[figure] for v in runs[name].values())

    def over(name, rival):
        return [v[0] / runs[rival][i][0] for i, v in runs[name].items() if i in runs[rival]]

    print(f"{folder.name}, {len(runs[first])} draws, {middle(first, 0):.4g} s with {first}\n")
    print(f"| run | time over {first} | over the fastest plain solver as near | D % | stress % | force % | force/range % | replaced |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    for name in sorted(runs, key=lambda n: middle(n, 0)):
        near = [p for p in plain & runs.keys() if p != name and middle(p, 1) <= middle(name, 1)]
        rival = min(near, key=lambda p: middle(p, 0), default=None)
        ratio = f"{shown(over(name, rival))} {rival}" if rival else "-"
        errors = [shown([v[figure] for v in runs[name].values()], scale) for figure, scale in ((1, 100), (2, 100), (3, 100), (4, 100), (5, 1))]
        print(f"| {name} | {shown(over(name, first))} | {ratio} | {' | '.join(errors)} |")
    print(flush=True)


main()
