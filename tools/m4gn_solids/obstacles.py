"""Rigid obstacles: exact signed distances with their derivatives, surfaces, and prescribed motion.

Two shapes make all of them. Both are convex and smooth (C1) outside a thin core, so that contact is smooth too:
a box whose edges are rounded with radius r (a sphere is the box of half sizes r), and a cylinder with rounded rims.
"""

from dataclasses import dataclass

import numpy as np

_TINY = 1e-30


def _direction(vectors, length):
    return vectors / np.maximum(length, _TINY)[:, None]


class RoundedBox:
    """Half sizes `half` (with the rounding), radius of edges and corners `radius`; local frame, centre at 0."""

    def __init__(self, half, radius):
        self.core = np.asarray(half, dtype=float) - radius
        self.radius = float(radius)
        if self.radius <= 0 or (self.core < -1e-12).any():
            raise ValueError(f"a rounding of {radius} does not fit half sizes {half}")
        self.core = np.maximum(self.core, 0)

    def distance(self, points):
        """Signed distance [n] (negative inside), its gradient [n, 3] and Hessian [n, 3, 3]."""
        beyond = np.abs(points) - self.core
        outside = np.maximum(beyond, 0)
        length = np.linalg.norm(outside, axis=1)
        sign = np.where(points < 0, -1.0, 1.0)
        normal = _direction(outside, length)
        active = (beyond > 0).astype(float)
        curved = active[:, :, None] * np.eye(3) - normal[:, :, None] * normal[:, None, :]
        hessian = curved / np.maximum(length, _TINY)[:, None, None]
        hessian *= sign[:, :, None] * sign[:, None, :]
        inner = length <= 0
        if inner.any():
            nearest = beyond[inner].argmax(axis=1)
            normal[inner] = np.eye(3)[nearest]
            hessian[inner] = 0
        gap = np.where(inner, beyond.max(axis=1), length) - self.radius
        return gap, normal * sign, hessian

    def reach(self):
        """Radius of the ball about the centre that holds the shape."""
        return float(np.linalg.norm(self.core) + self.radius)

    def surface(self, size):
        """Points [n, 3] and outward triangles [m, 3], edges about `size` long."""
        quarter = max(1, round(self.radius * np.pi / 4 / size))
        angles = np.linspace(-np.pi / 4, np.pi / 4, 2 * quarter + 1)

        def line(half):
            # (tangent, place in the core): a rounded edge, the flat part, a rounded edge
            low = [(np.tan(a), -half) for a in angles[: quarter + 1]]
            high = [(np.tan(a), half) for a in angles[quarter:]]
            if half <= 0:
                return low + high[1:]
            flat = np.linspace(-half, half, max(1, round(2 * half / size)) + 1)[1:-1]
            return low + [(0.0, p) for p in flat] + high

        number, points, triangles = {}, [], []

        def point(place, normal):
            position = place + self.radius * normal / np.linalg.norm(normal)
            key = tuple(np.round(position / size, 6) + 0.0)
            if key not in number:
                number[key] = len(points)
                points.append(position)
            return number[key]

        for axis in range(3):
            first, second = (axis + 1) % 3, (axis + 2) % 3
            for side in (-1.0, 1.0):
                grid = []
                for tangent_a, place_a in line(self.core[first]):
                    row = []
                    for tangent_b, place_b in line(self.core[second]):
                        place, normal = np.empty(3), np.empty(3)
                        place[[axis, first, second]] = side * self.core[axis], place_a, place_b
                        normal[[axis, first, second]] = side, tangent_a, tangent_b
                        row.append(point(place, normal))
                    grid.append(row)
                triangles += _quads(np.array(grid), side > 0)
        return np.array(points), _without_degenerate(triangles)


class RoundedCylinder:
    """Axis y of the local frame, half length `half` (with the rounding), rims rounded with `rim`."""

    def __init__(self, radius, half, rim):
        self.core = np.array([radius - rim, half - rim], dtype=float)
        self.rim = float(rim)
        if self.rim <= 0 or (self.core <= 0).any():
            raise ValueError(f"a rim of {rim} does not fit radius {radius} and half length {half}")

    def distance(self, points):
        """As RoundedBox.distance."""
        axis = points[:, 1]
        rho = np.hypot(points[:, 0], points[:, 2])
        radial = np.zeros_like(points)
        radial[:, 0::2] = _direction(points[:, 0::2], rho)
        radial[rho <= 0, 0] = 1
        along = np.zeros_like(points)
        along[:, 1] = np.where(axis < 0, -1.0, 1.0)
        around = np.cross(along, radial)
        beyond = np.column_stack([rho, np.abs(axis)]) - self.core
        outside = np.maximum(beyond, 0)
        length = np.linalg.norm(outside, axis=1)
        normal = _direction(outside, length)
        inner = length <= 0
        normal[inner] = np.eye(2)[beyond[inner].argmax(axis=1)]
        gap = np.where(inner, beyond.max(axis=1), length) - self.rim
        gradient = normal[:, :1] * radial + normal[:, 1:] * along
        tangent = normal[:, 1:] * radial - normal[:, :1] * along
        on_rim = ((beyond > 0).all(axis=1) / np.maximum(length, _TINY))[:, None, None]
        hoop = (np.where(inner, 0, normal[:, 0]) / np.maximum(rho, _TINY))[:, None, None]
        hessian = on_rim * tangent[:, :, None] * tangent[:, None, :]
        hessian = hessian + hoop * around[:, :, None] * around[:, None, :]
        return gap, gradient, hessian

    def reach(self):
        """As RoundedBox.reach."""
        return float(np.linalg.norm(self.core) + self.rim)

    def surface(self, size):
        """As RoundedBox.surface."""
        radius = self.core[0] + self.rim
        around = max(12, round(2 * np.pi * radius / size))
        cap = np.linspace(0, self.core[0], max(1, round(self.core[0] / size)) + 1)[1:]
        rim = np.linspace(0, np.pi / 2, max(1, round(self.rim * np.pi / 2 / size)) + 1)[1:]
        side = np.linspace(0, self.core[1], max(1, round(self.core[1] / size)) + 1)[1:]
        half = [(r, self.core[1] + self.rim) for r in cap]
        half += [(self.core[0] + self.rim * np.sin(a), self.core[1] + self.rim * np.cos(a)) for a in rim]
        half += [(radius, self.core[1] - z) for z in side]
        profile = half + [(r, -z) for r, z in half[-2::-1]]
        turn = 2 * np.pi * np.arange(around) / around
        rings = [np.column_stack([r * np.sin(turn), np.full(around, z), r * np.cos(turn)]) for r, z in profile]
        top, bottom = self.core[1] + self.rim, -self.core[1] - self.rim
        points = np.vstack([[(0, top, 0)], *rings, [(0, bottom, 0)]])
        grid = 1 + np.arange(len(profile) * around).reshape(len(profile), around)
        grid = np.column_stack([grid, grid[:, 0]])
        last = len(points) - 1
        triangles = [(0, int(a), int(b)) for a, b in zip(grid[0], grid[0, 1:])]
        triangles += _quads(grid, True)
        triangles += [(int(b), int(a), last) for a, b in zip(grid[-1], grid[-1, 1:])]
        return points, np.array(triangles)


def _quads(grid, forward):
    """Two triangles for every square of a grid of point numbers."""
    a, b, c, d = (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])
    corners = np.stack([a, b, c, d] if forward else [a, d, c, b], axis=-1).reshape(-1, 4)
    return [t for q in corners.tolist() for t in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]


def _without_degenerate(triangles):
    return np.array([t for t in triangles if len(set(t)) == 3])


@dataclass
class Obstacle:
    """A shape and its prescribed motion; `pose(k)` is its place at frame k."""

    shape: object
    centres: np.ndarray
    """[T, 3] m"""
    frame: np.ndarray
    """Rows are the local axes in the world at frame 0."""
    axis: np.ndarray
    """World axis of its turning."""
    angles: np.ndarray
    """[T] rad"""

    def pose(self, k):
        """Centre and local axes at frame k, which may lie between two frames."""
        low = min(int(k), len(self.angles) - 1)
        high = min(low + 1, len(self.angles) - 1)
        part = k - low
        centre = (1 - part) * self.centres[low] + part * self.centres[high]
        angle = (1 - part) * self.angles[low] + part * self.angles[high]
        return centre, self.frame @ _turn(self.axis, angle).T

    def distance(self, points, k):
        """Signed distance, gradient and Hessian of points in the world at frame k."""
        centre, axes = self.pose(k)
        gap, gradient, hessian = self.shape.distance((points - centre) @ axes.T)
        return gap, gradient @ axes, axes.T @ hessian @ axes

    def place(self, local_points, k):
        """Points of the shape's surface in the world at frame k."""
        centre, axes = self.pose(k)
        return local_points @ axes + centre


def _turn(axis, angle):
    x, y, z = axis
    cross = np.array([(0, -z, y), (z, 0, -x), (-y, x, 0)], dtype=float)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
