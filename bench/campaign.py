"""Of the columns of bench/campaign.sh in this folder: what they took, and what they are off the runs of auto that went cold to the end."""

import collections
import glob
import json
import math
import os


def records(folder):
    return {os.path.basename(os.path.dirname(p)): json.load(open(p)) for p in sorted(glob.glob(f"{folder}/*/done"))}


def seconds(record):
    cost = record["cost"]
    return cost["prepare"] + cost["start"] + cost["solver"] + cost["states"]


checks = records("auto/checks")
cold = sum(map(seconds, checks.values())) / len(checks) if checks else math.nan
print(f"cold, plain, to the end: {cold:.2f} s a run, of {len(checks)} runs")
print("| column | runs | processor time [s] | of it mesh | start | states | to the end, over it | the flow's time [s] | not known | within, of checks | started |")
for column in [c for c in ["until", "nearest", "auto", "dmd"] if os.path.isdir(c)]:
    runs = records(f"{column}/runs")
    within, compared, worst = 0, 0, 0.0
    for name in runs.keys() & checks.keys():
        for quantity, own in runs[name]["quantities"].items():
            other = checks[name]["quantities"][quantity]
            halves = [f["half_width"] for f in (own, other)]
            difference = abs(own["value"] - other["value"])
            if None not in halves:
                within, compared = within + (difference <= math.hypot(*halves)), compared + 1
            worst = max(worst, difference / abs(other["value"]))
    total = sum(map(seconds, runs.values()))
    unknown = sum(any(f["known"] is False for f in r["quantities"].values()) for r in runs.values())
    starts = collections.Counter(r["start"]["kind"] + (" mapped" if r["start"]["mapped"] else "") for r in runs.values())
    parts = [sum(r["cost"][part] for r in runs.values()) for part in ("prepare", "start", "states")]
    flow = sum(r["end_time"] for r in runs.values())
    print(f"| {column} | {len(runs)} | {total:.1f} | {' | '.join(f'{p:.1f}' for p in parts)} | {len(runs) * cold / total:.2f} | {flow:.4g} | {unknown} | {within} of {compared}, "
          f"at most {100 * worst:.2g} % off | {', '.join(f'{k} {v}' for k, v in starts.items())} |")
