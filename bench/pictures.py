"""Pictures of the book: python bench/pictures.py RUN FOLDER

RUN: the folder run/cylinder of the tutorial. Writes strip.svg, what solver and surrogate did of the dmd run over time, modes.svg, the modes of its last
fit, and segments.svg, 36 segments of the mesh by its modes. Runs icoFoam once more, with writeModes. Needs env.sh, numpy and matplotlib."""
import os, re, subprocess, sys
import numpy as np
import matplotlib
matplotlib.use("svg")
import matplotlib.pyplot as plt
from matplotlib.tri import Triangulation
from foam_case import copied, field, times

CENTRE, RADIUS = (0.31, 0.212), 0.052


def with_modes(run):
    case = f"{run}/modes"
    copied(f"{run}/dmd", case, "snapshotInterval 0.05; writeModes 1;")
    segment = ["m4gn", "segment", ".", "--segments", "36"]
    for command in (["icoFoam"], ["postProcess", "-func", "writeCellCentres", "-time", "0"], segment):
        with open(f"{case}/log.{command[0]}", "w") as log:
            subprocess.run(command, cwd=case, stdout=log, stderr=subprocess.STDOUT, check=True)
    return case


def strip(run, centres, out):
    """Uy behind the cylinder, and who computed it."""
    cell = ((centres[:, :2] - (0.7, 0.212)) ** 2).sum(1).argmin()
    figure, axes = plt.subplots(figsize=(9, 2.4))
    for case, style in (("full", dict(color="#777777", linewidth=3, label="plain run")), ("dmd", dict(color="#D55E00", linewidth=1, label="hybrid run"))):
        names = times(f"{run}/{case}")
        axes.plot([float(t) for t in names], [field(f"{run}/{case}/{t}/U")[cell, 1] for t in names], **style)
    table = f"{run}/dmd/postProcessing/surrogate/0/surrogate.dat"
    stride = float(re.search(r"stride \(s\)\s*: (\S+)", open(table).read()).group(1))
    rows = np.loadtxt(table, ndmin=2, usecols=(0, 1))
    for end, steps in rows:
        axes.axvspan(end - steps * stride, end, color="#56B4E9", alpha=0.35, linewidth=0, label="surrogate" if end == rows[0, 0] else None)
    axes.set(xlabel="time, s", ylabel="Uy, m/s", xlim=(0, 9))
    axes.legend(fontsize=7, loc="upper left", ncols=3, framealpha=1)
    figure.tight_layout()
    figure.savefig(out)


def plane(axes, mesh, values, title, **style):
    axes.tripcolor(mesh, values, shading="gouraud", rasterized=True, **style)
    axes.add_patch(plt.Circle(CENTRE, RADIUS, color="white"))
    axes.set_title(title, fontsize=8, loc="left")
    axes.set_aspect("equal")
    axes.axis("off")


def main(run, folder):
    os.makedirs(folder, exist_ok=True)
    case = with_modes(run)
    centres = field(f"{case}/0/C")
    mesh = Triangulation(centres[:, 0], centres[:, 1])
    middle = centres[mesh.triangles, :2].mean(1)
    mesh.set_mask(((middle - CENTRE) ** 2).sum(1) < RADIUS**2)
    strip(run, centres, f"{folder}/strip.svg")

    last = [t for t in times(case) if os.path.exists(f"{case}/{t}/modeMean(U)")][-1]
    figure, all_axes = plt.subplots(3, 1, figsize=(7, 5.2), dpi=100)
    for axes, name, title in zip(all_axes, ("modeMean(U)", "mode1Real(U)", "mode1Imaginary(U)"),
                                 ("mean, Ux", "first wave, Ux, real part", "a quarter of a period later")):
        values = field(f"{case}/{last}/{name}")[:, 0]
        size = abs(values).max()
        plane(axes, mesh, values, title, cmap="viridis" if "Mean" in name else "RdBu_r", vmin=None if "Mean" in name else -size, vmax=size)
    figure.tight_layout()
    figure.savefig(f"{folder}/modes.svg")

    labels = field(f"{case}/{times(case)[-1]}/m4gnSegment")[:, 0].astype(int)
    figure, axes = plt.subplots(figsize=(7, 2), dpi=150)
    colours = np.random.default_rng(3).permutation(labels.max() + 1)[labels] % 20
    axes.scatter(centres[:, 0], centres[:, 1], c=colours, cmap="tab20", s=16, marker="s", linewidths=0, rasterized=True)
    axes.set_aspect("equal")
    axes.axis("off")
    figure.tight_layout()
    figure.savefig(f"{folder}/segments.svg")


main(*sys.argv[1:])
