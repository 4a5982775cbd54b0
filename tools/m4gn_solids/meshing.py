"""Bodies and their meshes, by the program gmsh."""

import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import elements


class MeshFailed(Exception):
    """gmsh gave no usable mesh of this body."""


@dataclass
class Body:
    """A meshed body."""

    points: np.ndarray
    """[N, 3] m, at rest"""
    cells: np.ndarray
    """[C, 4 or 6] point numbers, positive volumes"""
    kind: int
    """VTK's code of the cells"""
    fixed: np.ndarray
    """[N] True for the points of the handle"""


def _gmsh(folder, name, script, dimension):
    """Coordinates and cells (triangles or tetrahedra) of a mesh."""
    source, target = Path(folder, f"{name}.geo"), Path(folder, f"{name}.msh")
    source.write_text(script)
    command = ["gmsh", "-nt", "1", f"-{dimension}", "-format", "msh2", "-o", target.name, source.name]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if run.returncode != 0 or not target.is_file():
        said = [line for line in (run.stdout + run.stderr).splitlines() if "rror" in line]
        raise MeshFailed(f"gmsh: {said[0] if said else 'no mesh'}")
    points, cells = _read_msh2(target, {2: 2, 3: 4}[dimension])
    if len(cells) == 0:
        raise MeshFailed("gmsh made no cells")
    used, flat = np.unique(cells, return_inverse=True)
    return points[used], flat.reshape(cells.shape)


def _read_msh2(path, wanted):
    lines = path.read_text().split("\n")
    start = lines.index("$Nodes") + 1
    count = int(lines[start])
    nodes = np.array([line.split() for line in lines[start + 1 : start + 1 + count]], dtype=float)
    number = np.full(int(nodes[:, 0].max()) + 1, -1)
    number[nodes[:, 0].astype(int)] = np.arange(count)
    start = lines.index("$Elements") + 1
    rows = (line.split() for line in lines[start + 1 : start + 1 + int(lines[start])])
    # number, type, number of tags, tags, points
    cells = [row[3 + int(row[2]) :] for row in rows if int(row[1]) == wanted]
    return nodes[:, 1:], number[np.array(cells, dtype=int)] if cells else np.empty((0, 3), dtype=int)


def _positive(points, cells, mirrored):
    """Cells with positive volume; `mirrored` is the order of points that changes its sign."""
    p = points[cells]
    if cells.shape[1] == 3:
        a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        size = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    else:
        size = np.einsum("ci,ci->c", np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), p[:, 3] - p[:, 0])
    return np.where((size < 0)[:, None], cells[:, mirrored], cells)


def _refined(mesh, size, power, target, tolerance):
    """Calls mesh(size) with sizes that lead to `target` points; size ~ points^-power."""
    best = None
    for _ in range(8):
        points, cells = mesh(size)
        count = len(points)
        miss = abs(count / target - 1)
        if best is None or miss < best[0]:
            best = (miss, points, cells)
        if miss < tolerance:
            break
        size *= (count / target) ** power
    if best[0] > 3 * tolerance:
        raise MeshFailed(f"{len(best[1])} points where {target} are wanted")
    return best[1], best[2]


def beam(shape, folder):
    """Side view triangulated in x-y, extruded along z: six-node wedges."""
    length, width, layers = shape["length"], shape["width"], shape["layers"]
    x = np.linspace(0, length, 25)
    middle = shape["bow"] * np.sin(np.pi * x / (2 * length)) * x / length
    half = (shape["height"] + (shape["tip_height"] - shape["height"]) * x / length) / 2
    area = length * (shape["height"] + shape["tip_height"]) / 2

    def triangles(size):
        outline = [*zip(x, middle - half), *zip(x[::-1], (middle + half)[::-1])]
        n = len(x)
        lines = [f"Point({i + 1}) = {{{a:.12g}, {b:.12g}, 0, {size:.12g}}};" for i, (a, b) in enumerate(outline)]
        lines += [
            f"Spline(1) = {{1:{n}}};",
            f"Line(2) = {{{n}, {n + 1}}};",
            f"Spline(3) = {{{n + 1}:{2 * n}}};",
            f"Line(4) = {{{2 * n}, 1}};",
            "Curve Loop(1) = {1, 2, 3, 4};",
            "Plane Surface(1) = {1};",
            "Mesh.Algorithm = 6;",
        ]
        return _gmsh(folder, "beam", "\n".join(lines) + "\n", 2)

    side = shape["points"] / (layers + 1)
    size = 1.06 * np.sqrt(area / (0.866 * side))
    flat, triangle = _refined(triangles, size, 0.5, side, 0.04)
    triangle = _positive(flat, triangle, [0, 2, 1])
    n = len(flat)
    points = np.vstack(
        [np.column_stack([flat[:, :2], np.full(n, z)]) for z in np.linspace(-width / 2, width / 2, layers + 1)]
    )
    cells = np.vstack([np.hstack([triangle + k * n, triangle + (k + 1) * n]) for k in range(layers)])
    near = 1e-6 * length
    fixed = points[:, 0] < near
    if shape["support"] == "both ends":
        fixed |= points[:, 0] > length - near
    elif shape["support"] == "propped":
        # The lower edge of the far end
        tip = points[:, 0] > length - near
        fixed |= tip & (points[:, 1] < points[tip, 1].min() + near)
    return Body(points, cells, elements.WEDGE, fixed)


def plate(shape, folder):
    """A plate in x-y with round holes, thickness along z: tetrahedra."""
    lx, ly, t = shape["length"], shape["width"], shape["thickness"]

    def tetrahedra(size):
        lines = [
            'SetFactory("OpenCASCADE");',
            f"Box(1) = {{0, 0, {-t / 2:.12g}, {lx:.12g}, {ly:.12g}, {t:.12g}}};",
        ]
        for i, (x, y, r) in enumerate(shape["holes"]):
            lines.append(f"Cylinder({i + 2}) = {{{x:.12g}, {y:.12g}, {-t:.12g}, 0, 0, {2 * t:.12g}, {r:.12g}}};")
        tools = f"2:{len(shape['holes']) + 1}"
        lines += [
            f"BooleanDifference(100) = {{ Volume{{1}}; Delete; }}{{ Volume{{{tools}}}; Delete; }};",
            f"Mesh.MeshSizeMin = {size:.12g};",
            f"Mesh.MeshSizeMax = {size:.12g};",
        ]
        return _gmsh(folder, "plate", "\n".join(lines) + "\n", 3)

    points, cells = _refined(tetrahedra, 0.0045, 0.42, shape["points"], 0.06)
    cells = _positive(points, cells, [0, 2, 1, 3])
    near = 1e-6 * lx
    left, right = points[:, 0] < near, points[:, 0] > lx - near
    front, back = points[:, 1] < near, points[:, 1] > ly - near
    fixed = {
        "both ends": left | right,
        "one end": left,
        "all sides": left | right | front | back,
    }[shape["support"]]
    return Body(points, cells, elements.TETRAHEDRON, fixed)
