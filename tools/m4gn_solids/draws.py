"""What is drawn for one trajectory: body, supports, obstacle and its motion. Lengths in metres, angles in radians."""

import numpy as np

from . import contact, elements, meshing
from .obstacles import Obstacle, RoundedBox, RoundedCylinder

FAMILIES = ("deforming-plate", "deforming-beam")
"""The place of a family decides its random numbers: a new one comes last."""

YOUNG, DENSITY = 1e6, 1000.0
"""Pa, -, kg/m^3, as in the paper."""

PLATE_POINTS, BEAM_POINTS, LARGE_BEAM_POINTS = 1271, 1542, 4540
"""Points of a body, met within a few per cent."""


def generator(family, large, seed, index, attempt):
    """Random numbers that depend on these five only."""
    return np.random.default_rng([FAMILIES.index(family), int(large), seed, index, attempt])


def draw(random, family, large, points=None):
    """All parameters of a trajectory; numbers, text and lists only. `points`: another size of mesh than the usual."""
    parameters = _plate(random) if family == "deforming-plate" else _beam(random, large)
    if points:
        parameters["body"]["points"] = points
    return parameters


def _choice(random, shares):
    names = list(shares)
    return names[random.choice(len(names), p=list(shares.values()))]


def _beam(random, large):
    # The large domain: twice as long (the graph's diameter doubles) and 1.5 times as high, cells of the same size.
    scale, rise = (2.0, 1.5) if large else (1.0, 1.0)
    length = random.uniform(0.08, 0.12) * scale
    height = random.uniform(0.014, 0.024) * rise
    body = {
        "length": length,
        "height": height,
        "tip_height": height * random.uniform(0.6, 1.1),
        "width": random.uniform(0.012, 0.022),
        "bow": random.uniform(-0.1, 0.1) * length,
        "layers": int(random.integers(4, 6)),
        "points": LARGE_BEAM_POINTS if large else BEAM_POINTS,
        "support": _choice(random, {"one end": 0.6, "both ends": 0.25, "propped": 0.15}),
    }
    free = body["support"] == "one end"
    kind = _choice(random, {"cylinder": 0.4, "sphere": 0.35, "block": 0.25})
    along = random.uniform(0.55, 0.9) if free else random.uniform(0.35, 0.65)
    depth = random.uniform(0.3, 0.55) if free else random.uniform(0.08, 0.18)
    slide = random.uniform(-0.15, 0.15) if free else random.uniform(-0.05, 0.05)
    obstacle = {
        "shape": kind,
        "start": [along * length, 0.0, 0.0],
        "side": float(random.choice([1.0, -1.0])),
        "depth": depth * length,
        "slide": slide * length,
        "bend": random.uniform(1, 1.8),
        "turn": 0.0,
    }
    if kind == "cylinder":
        radius = random.uniform(0.08, 0.16) * length
        obstacle |= {"radius": radius, "half": 0.75 * body["width"] + 0.2 * radius, "rim": 0.2 * radius}
    elif kind == "sphere":
        radius = max(random.uniform(0.08, 0.16) * length, 0.6 * body["width"])
        obstacle |= {"radius": radius}
        obstacle["start"][2] = random.uniform(-0.2, 0.2) * body["width"]
    else:
        half = [random.uniform(0.06, 0.12) * length, random.uniform(0.06, 0.1) * length, 0.8 * body["width"]]
        obstacle |= {"half": half, "radius": random.uniform(0.3, 0.6) * min(half)}
        obstacle["turn"] = random.uniform(-0.35, 0.35)
    return {"body": body, "obstacle": obstacle}


def _plate(random):
    length, width = random.uniform(0.08, 0.12), random.uniform(0.04, 0.06)
    count = int(random.integers(1, 4))
    body = {
        "length": length,
        "width": width,
        "thickness": random.uniform(0.004, 0.008),
        "holes": _holes(random, length, width, count),
        "points": PLATE_POINTS,
        "support": _choice(random, {"both ends": 0.6, "one end": 0.2, "all sides": 0.2}),
    }
    support = body["support"]
    kind = _choice(random, {"sphere": 0.5, "cylinder": 0.25, "block": 0.25})
    along, depth = {
        "both ends": ((0.3, 0.7), (0.12, 0.25)),
        "one end": ((0.45, 0.8), (0.2, 0.4)),
        "all sides": ((0.35, 0.65), (0.06, 0.12)),
    }[support]
    obstacle = {
        "shape": kind,
        "start": [random.uniform(*along) * length, random.uniform(0.35, 0.65) * width, 0.0],
        "side": float(random.choice([1.0, -1.0])),
        "depth": random.uniform(*depth) * length,
        "slide": random.uniform(-0.08, 0.08) * length,
        "bend": random.uniform(1, 1.8),
        "turn": 0.0,
        "heading": random.uniform(-0.4, 0.4),
    }
    if kind == "sphere":
        obstacle |= {"radius": random.uniform(0.012, 0.02)}
    elif kind == "cylinder":
        radius = random.uniform(0.008, 0.015)
        half = 0.75 * width if support != "all sides" else random.uniform(0.25, 0.35) * width
        obstacle |= {"radius": radius, "half": half, "rim": 0.4 * radius}
    else:
        half = [random.uniform(0.008, 0.016), random.uniform(0.008, 0.014), random.uniform(0.008, 0.012)]
        obstacle |= {"half": half, "radius": random.uniform(0.4, 0.7) * min(half)}
        obstacle["turn"] = random.uniform(-0.3, 0.3)
    return {"body": body, "obstacle": obstacle}


def _holes(random, length, width, count):
    holes = []
    while len(holes) < count:
        radius = random.uniform(0.08, 0.16) * width
        x, y = random.uniform(0.15, 0.85) * length, random.uniform(0.2, 0.8) * width
        inside = min(x, length - x, y, width - y) >= radius + 0.09 * width
        apart = all(np.hypot(x - a, y - b) >= radius + r + 0.004 for a, b, r in holes)
        if inside and apart:
            holes.append([x, y, radius])
    return holes


def build(parameters, family, frames, folder):
    """The meshed body, and the obstacle just clear of it at frame 0 with its motion over `frames` frames after it."""
    drawn = parameters["obstacle"]
    mesh = meshing.plate if family == "deforming-plate" else meshing.beam
    body = mesh(parameters["body"], folder)
    # The obstacle's axes: x along the body, y towards the obstacle. Cylinders lie across a beam and across a plate.
    side = drawn["side"]
    if family != "deforming-plate":
        towards, ahead = np.array([0, side, 0.0]), np.array([1.0, 0, 0])
    else:
        towards, heading = np.array([0, 0, side]), drawn["heading"]
        ahead = np.array([np.cos(heading), np.sin(heading), 0])
    across = np.cross(ahead, towards)
    solid = _shape(drawn)
    # RoundedCylinder has its axis along the local y
    frame = np.array([ahead, across, -towards]) if drawn["shape"] == "cylinder" else np.array([ahead, towards, across])
    # The path bends: the slide comes later than the push where bend > 1.
    part = np.linspace(0, 1, frames + 1)[:, None]
    path = -drawn["depth"] * part * towards + drawn["slide"] * part ** drawn["bend"] * ahead
    obstacle = Obstacle(solid, path, frame, across, drawn["turn"] * part[:, 0])
    obstacle.centres = path + _clear(body, obstacle, np.array(drawn["start"]), towards)
    return body, obstacle


def _shape(drawn):
    if drawn["shape"] == "sphere":
        return RoundedBox([drawn["radius"]] * 3, drawn["radius"])
    if drawn["shape"] == "block":
        return RoundedBox(drawn["half"], drawn["radius"])
    return RoundedCylinder(drawn["radius"], drawn["half"], drawn["rim"])


def _clear(body, obstacle, start, towards):
    """The place along start + s towards where the obstacle is a tenth of a cell from the body."""
    size = elements.cell_size(body.points, elements.edges(body.cells, body.kind))
    samples = contact.samples(body)
    points = samples @ body.points
    extent = (points @ towards).max() - start @ towards
    far = extent + obstacle.shape.reach() + size
    place = start + far * towards
    for _ in range(200):
        obstacle.centres = obstacle.centres * 0 + place
        gap = obstacle.distance(points, 0)[0].min() - 0.1 * size
        if abs(gap) < 1e-4 * size:
            return place
        # Never too far: the distance changes by at most the shift.
        place = place - gap * towards
    raise meshing.MeshFailed("the obstacle does not come close to the body")
