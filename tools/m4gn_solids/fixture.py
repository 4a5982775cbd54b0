"""python -m m4gn_solids.fixture FILE: the small trajectory that m4gn's own tests read (tests/data/solid.h5).

A bar of two bricks, each cut into two wedges, held at x = 0; a sphere comes down beside its middle. No gmsh.
"""

import sys

import numpy as np

from . import elements
from .meshing import Body
from .obstacles import Obstacle, RoundedBox
from .recording import record

MATERIAL = {"young": 1e6, "poisson": 0.4, "density": 1000.0}


def bar():
    """12 points, 4 wedges, 0.02 x 0.01 x 0.01 m."""
    points = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1, 2)]
    cells = []
    for x in (0, 1):
        a, b, c, d = x, x + 1, x + 4, x + 3
        cells += [(a, b, c, a + 6, b + 6, c + 6), (a, c, d, a + 6, c + 6, d + 6)]
    points = np.array(points, dtype=float) * 0.01
    return Body(points, np.array(cells), elements.WEDGE, points[:, 0] == 0)


def sphere(frames):
    """Radius 8 mm, from 0.2 mm above the bar 3 mm down."""
    centres = np.array([0.017, 0.0182, 0.004]) - np.linspace(0, 0.003, frames + 1)[:, None] * np.array([0, 1.0, 0])
    return Obstacle(RoundedBox([0.008] * 3, 0.008), centres, np.eye(3), np.array([0, 0, 1.0]), np.zeros(frames + 1))


def main(path):
    recording, march, _ = record(path, "test", bar(), sphere(3), MATERIAL, 0.01)
    recording.finish({"family": "bar", "worst_gap": march.gap / march.size})


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
