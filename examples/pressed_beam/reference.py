"""The same beam under the same cylinder by finite elements (FElupe), beside the states that pressed_beam wrote.

    setup/solids.sh                                                  # once: the Python environment
    PYTHONPATH=tools ~/.cache/m4gn/solids/bin/python examples/pressed_beam/reference.py FOLDER

Steps, sizes and numbers of cells are those of pressed_beam.cpp.
"""

import sys
import time
from pathlib import Path

import numpy as np
from m4gn_solids import elements
from m4gn_solids.equilibrium import March, Solid
from m4gn_solids.meshing import Body
from m4gn_solids.obstacles import Obstacle, RoundedCylinder

LENGTH, HEIGHT, RADIUS = 0.1, 0.018, 0.012
SIZE = LENGTH / 38
FRAMES = 4
"""A step of the model in this many increments, as in the recordings that it was trained on."""


def read(path):
    """Points at rest [N, 3], wedges [C, 6] and displacement [N, 3] of a state."""
    lines = iter(path.read_text().splitlines())

    def block(word, columns):
        count = next(int(line.split()[1]) for line in lines if line.startswith(word))
        return np.array([next(lines).split() for _ in range(count)], dtype=float)[:, -columns:]

    points, cells = block("POINTS", 3), block("CELLS", 6).astype(int)
    next(line for line in lines if line.startswith("VECTORS"))
    displacement = np.array([next(lines).split() for _ in range(len(points))], dtype=float)
    return points - displacement, cells, displacement


def main():
    states = {int(path.stem[-3:]): read(path) for path in sorted(Path(sys.argv[1]).glob("state-*.vtk"))}
    if 0 not in states:
        sys.exit(f"{sys.argv[1]}: no state-000.vtk; type: pressed_beam MODEL {sys.argv[1]}")
    points, cells, _ = states[0]
    body = Body(points, cells, elements.WEDGE, points[:, 0] < 1e-9)
    rim = 0.2 * RADIUS
    cylinder = RoundedCylinder(RADIUS, 0.75 * 0.016 + rim, rim)
    last = max(states) * FRAMES
    path = np.zeros((last + 1, 3))
    path[:, :2] = 0.8 * LENGTH, HEIGHT / 2 + RADIUS + 0.1 * SIZE
    path[:, 1] -= 0.4 * LENGTH * np.arange(last + 1) / (100 * FRAMES)
    axes = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    obstacle = Obstacle(cylinder, path, axes, np.array([0, 0, 1.0]), np.zeros(last + 1))
    solid = Solid(body, 1e6, 0.4)
    tip = np.flatnonzero(np.isclose(points[:, 0], LENGTH))[0]
    print("step  tip, FElupe (mm)  tip, m4gn (mm)  rms of the difference (mm)  of the displacement")
    began = time.process_time()
    for frame, displacement in enumerate(March(body, obstacle, solid, 1e6).frames()):
        step, rest = divmod(frame, FRAMES)
        if rest == 0 and step in states:
            found = states[step][2]
            error, whole = (np.sqrt((x**2).sum(axis=1).mean()) for x in (found - displacement, displacement))
            share = f"{100 * error / whole:.1f} %" if step else "-"
            print(f"{step:4d} {1e3 * displacement[tip, 1]:17.2f} {1e3 * found[tip, 1]:15.2f} {1e3 * error:27.3f} {share:>20}")
    print(f"{1e3 * (time.process_time() - began) * FRAMES / last:.0f} ms of processor time for as much as a step")


if __name__ == "__main__":
    main()
