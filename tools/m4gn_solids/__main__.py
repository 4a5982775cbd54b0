"""python -m m4gn_solids: makes the trajectory that case.json in the working folder asks for.

case.json: family, large, seed, index, points (about how many; null: as many as in the paper), poisson (the ratio), frames,
interval (s), split, command. What comes out: trajectory.h5 and, for
the figures, result.json. A draw that has no quasi-static path, cannot be meshed or lets the obstacle sink in is drawn
again; every such failure is kept in both files.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path

from . import draws, meshing
from .equilibrium import NoEquilibrium
from .recording import SunkIn, record

ATTEMPTS = 20
"""Draws before a case is given up."""


def attempt(case, parameters):
    """Simulates one draw into trajectory.h5; the figures, without closing the file."""
    body, obstacle = draws.build(parameters, case["family"], case["frames"], ".")
    material = {"young": draws.YOUNG, "poisson": case["poisson"], "density": draws.DENSITY}
    recording, march, obstacle_points = record("trajectory.h5", case["split"], body, obstacle, material, case["interval"])
    figures = {
        "points": len(body.points),
        "elements": len(body.cells),
        "obstacle_points": obstacle_points,
        "cell_size": march.size,
        "worst_gap": march.gap / march.size,
        "worst_gap_frame": march.gap_frame,
        "newton_iterations": march.iterations,
    }
    return recording, figures


def main():
    case = json.loads(Path("case.json").read_text())
    family, large, seed, index = (case[key] for key in ("family", "large", "seed", "index"))
    redraws = []
    for number in range(ATTEMPTS):
        parameters = draws.draw(draws.generator(family, large, seed, index, number), family, large, case["points"])
        began = time.process_time()
        try:
            recording, figures = attempt(case, parameters)
            break
        except (NoEquilibrium, SunkIn, meshing.MeshFailed) as reason:
            spent = round(time.process_time() - began, 3)
            redraws.append({"reason": str(reason), "cpu_seconds": spent, "parameters": parameters})
            print(f"draw {number}: {reason}", flush=True)
    else:
        sys.exit(f"none of {ATTEMPTS} draws of case {index} could be simulated; the last: {redraws[-1]['reason']}")
    figures["cpu_seconds"] = round(time.process_time() - began, 3)
    figures["redraws"] = [{key: r[key] for key in ("reason", "cpu_seconds")} for r in redraws]
    provenance = {key: case[key] for key in ("command", "family", "large", "seed", "index", "poisson", "frames", "interval")}
    provenance |= {"draw": len(redraws), "parameters": parameters, **figures}
    provenance["software"] = {name: version(name) for name in ("felupe", "numpy", "scipy", "h5py")}
    recording.finish(provenance)
    Path("result.json").write_text(json.dumps(figures))


if __name__ == "__main__":
    main()
