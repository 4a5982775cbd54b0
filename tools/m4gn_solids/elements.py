"""Linear tetrahedra and wedges: FElupe regions, faces and edges. Local numbering and cell codes are VTK's."""

import felupe as fem
import numpy as np

TETRAHEDRON, WEDGE = 10, 13
"""VTK's cell codes."""

# Faces, seen from outside anticlockwise (VTK's wedge has its first triangle's normal pointing out, which for a
# positive volume with our node order is the first triangle reversed).
_FACES = {
    TETRAHEDRON: [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)],
    WEDGE: [(0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
}


class Wedge(fem.Element):
    """Six-node wedge: linear triangle (r, s) times a line t in [-1, 1]."""

    def __init__(self):
        triangle = [(0, 0), (1, 0), (0, 1)]
        self.points = np.array([(r, s, t) for t in (-1, 1) for r, s in triangle], dtype=float)
        self.cells = np.arange(6).reshape(1, -1)
        self.cell_type = "wedge"

    def function(self, position):
        r, s, t = position
        triangle = np.array([1 - r - s, r, s])
        return np.concatenate([triangle * (1 - t) / 2, triangle * (1 + t) / 2])

    def gradient(self, position):
        r, s, t = position
        triangle = np.array([1 - r - s, r, s])
        slopes = np.array([(-1, -1), (1, 0), (0, 1)], dtype=float)
        below = np.column_stack([slopes * (1 - t) / 2, -triangle / 2])
        above = np.column_stack([slopes * (1 + t) / 2, triangle / 2])
        return np.vstack([below, above])


def region(mesh_points, cells, kind):
    """FElupe region: one quadrature point a tetrahedron, two a wedge (full rank)."""
    if kind == TETRAHEDRON:
        return fem.RegionTetra(fem.Mesh(mesh_points, cells, "tetra"), quadrature=fem.TetrahedronQuadrature(order=1))
    gauss = 1 / np.sqrt(3)
    points = np.array([(1 / 3, 1 / 3, -gauss), (1 / 3, 1 / 3, gauss)])
    scheme = fem.quadrature.Scheme(points, np.full(2, 1 / 2))
    return fem.Region(fem.Mesh(mesh_points, cells, "wedge"), Wedge(), scheme)


def skin(cells, kind):
    """Faces that belong to one cell only, as tuples of points, outward."""
    once = {}
    for local in _FACES[kind]:
        for face in map(tuple, cells[:, local].tolist()):
            key = tuple(sorted(face))
            if once.pop(key, None) is None:
                once[key] = face
    return list(once.values())


def edges(cells, kind):
    """Every edge of every cell once, [E, 2], smaller point first, sorted."""
    pairs = {
        tuple(sorted((face[i], face[i - 1]))) for face in _FACES[kind] for i in range(len(face))
    }
    ends = np.sort(np.concatenate([cells[:, pair] for pair in sorted(pairs)]), axis=1)
    return np.unique(ends, axis=0)


def cell_size(points, edge_ends):
    """Mean edge length, the unit of gaps."""
    return float(np.linalg.norm(points[edge_ends[:, 1]] - points[edge_ends[:, 0]], axis=1).mean())
