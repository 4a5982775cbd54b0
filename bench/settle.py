"""Time until a wake has settled, plain and with cutTransient: python bench/settle.py [--jumps] [--only-tell] FULL...

FULL: plain runs of cylinder-flow that have U every 0.05 s (m4gn hybrid --keep-cases). Each runs again in ../cut, with cutTransient, and
without jumps in time where --jumps is not given. A wake has settled when what
Uy varies by over a period stays within 2 % of what it is at the end of the plain run, or of a hundredth of the flow's speed where that is more."""
import os, re, subprocess, sys
import numpy as np
from foam_case import copied, field, times

DMD = "snapshotInterval 0.05; cutTransient yes; "
ALONE = "fitTolerance 1e-9; jumpTolerance 1e-9; "  # no jumps in time


def course(case):
    """Times and Uy there, and the speed at the end."""
    names = times(case)
    u = [field(f"{case}/{t}/U") for t in names]
    return np.array([float(t) for t in names]), np.array([x[:, 1] for x in u]), (u[-1] ** 2).sum(1).mean() ** 0.5


def period(uy):
    """States in a period of the last 60."""
    late = uy[-60:] - uy[-60:].mean(0)
    power = (abs(np.fft.rfft(late * np.hanning(len(late))[:, None], 1024, axis=0)) ** 2).sum(1)
    power[:10] = 0
    return min(max(round(1024 / power.argmax()), 4), 20)


def fluctuation(uy, states):
    return np.array([uy[max(i - states + 1, 0) : i + 1].var(0).mean() ** 0.5 for i in range(len(uy))])


def settled(time, size, end, least, states, share=0.02):
    off = abs(size - end) > share * max(end, least)
    off[: states - 1] = True
    return time[min(np.flatnonzero(off)[-1] + 1, len(time) - 1)]


def cut(full, entries):
    case = os.path.join(os.path.dirname(full.rstrip("/")), "cut")
    copied(full, case, entries)
    log = open(f"{case}/log.icoFoam", "w")
    subprocess.run(["icoFoam"], cwd=case, stdout=log, stderr=subprocess.STDOUT, check=True)
    return case


def processor(case):
    return float(re.findall(r"ExecutionTime = ([0-9.]+)", open(f"{case}/log.icoFoam").read())[-1])


def main(arguments):
    tell = "--only-tell" in arguments
    entries = DMD + ("" if "--jumps" in arguments else ALONE)
    ratios = []
    print("| case | plain, s | cut short, s | ratio | amplitude at the end, over the plain one's | changes | processor time |\n| --- | --- | --- | --- | --- | --- | --- |")
    for full in (a for a in arguments if os.path.isdir(a)):
        case = os.path.join(os.path.dirname(full.rstrip("/")), "cut") if tell else cut(full, entries)
        (time, uy, speed), (t_cut, u_cut, _) = course(full), course(case)
        states = period(uy)
        plain, short = fluctuation(uy, states), fluctuation(u_cut, states)
        end, least = plain[-20:].mean(), 0.01 * speed
        a, b = settled(time, plain, end, least, states), settled(t_cut, short, end, least, states)
        told = re.findall(r"start-up: .*?(brought to [^,]*|taken up again|kept)", open(f"{case}/log.icoFoam").read())
        did = ", ".join(t.replace("brought ", "").replace("taken up again", "undone") for t in told) or "none"
        ratios.append((b / a, a))
        name = os.path.basename(os.path.dirname(os.path.abspath(full)))
        last = short[-20:].mean()
        print(f"| {name} | {a:.2f} | {b:.2f} | {b / a:.2f} | {last / max(end, least):.3f} | {did} | {processor(case) / processor(full):.2f} |", flush=True)
    slow = [r for r, a in ratios if a > 4]
    all_of = [r for r, _ in ratios]
    print(f"all: median {np.median(all_of):.2f}, worst {max(all_of):.2f}" + (f"; plain above 4 s: median {np.median(slow):.2f}, worst {max(slow):.2f}" if slow else ""))


main(sys.argv[1:])
