"""Eigenvalues of small solid bodies by an independent program.

  ~/.cache/m4gn/solids/bin/python bench/solids_reference.py [--write]

Compares with src/modes/fem/reference.json, exit 1 if they differ by 1e-9, or writes that file.

The same bodies are solved by `cargo test --release fem::reference`. K and M are made here, from the definition, with matrices of
gradients and averages, in a way that shares nothing with m4gn.
setup/solids.sh makes the Python environment.
"""
import json
import sys
from pathlib import Path

import numpy as np
import scipy.linalg
import scipy.sparse as sp

REFERENCE = Path(__file__).resolve().parent.parent / "src/modes/fem/reference.json"

FACES = {
    "tetrahedron": [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)],
    "wedge": [(0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
    "hexahedron": [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
}
CUTS = {
    "hexahedron": [tuple(range(8))],
    "wedge": [(0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)],
    "tetrahedron": [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)],
    "quadrilateral": [(0, 1, 2, 3)],
    "triangle": [(0, 1, 2), (0, 2, 3)],
}
MODES = 8


def body(shape, n, lengths, seed):
    """Points, cells and held points (x = 0) of a distorted block or, with two numbers, rectangle."""
    axes = [np.linspace(0, l, k + 1) for l, k in zip(lengths, n)]
    grid = np.meshgrid(*axes[::-1], indexing="ij")[::-1]
    points = np.stack([g.ravel() for g in grid], axis=1)
    step = [l / k for l, k in zip(lengths, n)]
    moved = points + np.random.default_rng(seed).uniform(-0.15, 0.15, points.shape) * step
    points = np.round(np.where(points[:, :1] > 0, moved, points), 6)
    count = [k + 1 for k in n]
    cells = []
    for c in np.ndindex(*n[::-1]):
        i, j, k = (*c[::-1], 0)[:3]
        at = lambda a, b, d: i + a + count[0] * (j + b + (count[1] * (k + d)))
        corners = [at(0, 0, 0), at(1, 0, 0), at(1, 1, 0), at(0, 1, 0)]
        if len(n) == 3:
            corners += [at(0, 0, 1), at(1, 0, 1), at(1, 1, 1), at(0, 1, 1)]
        cells += [[corners[p] for p in cut] for cut in CUTS[shape]]
    return points, np.array(cells), np.flatnonzero(points[:, 0] == 0)


def smoothed(shape, points, cells, young, poisson, density, edges=0.9, limit=2.0):
    """K and M of src/modes/fem/smoothing.rs, unknowns point by point."""
    n, dim = points.shape
    extended, middles, corner_lists, cell_of = list(points), {}, [], []

    def middle(of):
        key = tuple(sorted(of))
        if key not in middles:
            middles[key] = len(extended)
            extended.append(points[list(of)].mean(axis=0))
        return middles[key]

    for c, cell in enumerate(cells):
        faces = FACES.get(shape, [tuple(range(len(cell)))])
        for face in faces:
            face = [cell[i] for i in face]
            for a, b in zip(face, face[1:] + face[:1]):
                corner_lists.append([middle(cell)] + ([middle(face)] if dim == 3 else []) + [a, b])
                cell_of.append(c)
    extended, corners, cell_of = np.array(extended), np.array(corner_lists), np.array(cell_of)
    interpolate = sp.lil_matrix((len(extended), n))
    interpolate[:n] = sp.identity(n)
    for key, row in middles.items():
        for p in key:
            interpolate[row, p] = 1 / len(key)
    interpolate = interpolate.tocsr()

    x = extended[corners]
    jacobian = x[:, 1:] - x[:, :1]
    volume = np.linalg.det(jacobian) / (6 if dim == 3 else 2)
    assert (volume > 0).all()
    inverse = np.linalg.inv(jacobian)
    slopes = np.concatenate([-inverse.sum(axis=2, keepdims=True), inverse], axis=2)
    rows = np.repeat(np.arange(len(corners)), dim + 1)
    gradient = [
        sp.csr_matrix((slopes[:, d].ravel(), (rows, corners.ravel())), (len(corners), len(extended))) @ interpolate
        for d in range(dim)
    ]

    def stiffness(weights, lam, mu):
        """Energy of the strains averaged with these weights (a row an average)."""
        size = np.asarray(weights.sum(axis=1)).ravel()
        mean = [sp.diags(1 / size) @ weights @ g for g in gradient]
        unit = sp.diags(size)
        block = lambda a, b: lam * mean[a].T @ unit @ mean[b] + mu * mean[b].T @ unit @ mean[a]
        dot = sum(m.T @ unit @ m for m in mean)
        return sp.bmat([[block(a, b) + (mu * dot if a == b else 0) for b in range(dim)] for a in range(dim)]).tocsr()

    lam, mu = young * poisson / (1 + poisson) / (1 - 2 * poisson), young / 2 / (1 + poisson)
    low = min(lam, limit * mu)
    count = np.arange(len(corners))
    by_cell = sp.csr_matrix((volume, (cell_of, count)))
    ends = np.sort(corners[:, -2:], axis=1)
    _, edge = np.unique(ends, axis=0, return_inverse=True)
    by_edge = sp.csr_matrix((volume, (edge.ravel(), count)))
    k = edges * stiffness(by_edge, low, mu) + (1 - edges) * stiffness(by_cell, low, mu)
    if lam > low:
        around = [{c for c, cell in enumerate(cells) if p in cell} for p in range(n)]

        def takers(p):
            """Points that have the volume average of p: itself, or those that share most cells with it."""
            best = []
            for q in range(n):
                common, more = len(around[p] & around[q]), len(around[q]) - len(around[p])
                same = around[p] == around[q] and q < p
                if same or (more > 0 and 2 * common >= len(around[p])):
                    best.append((common, len(around[q]), q))
            return [q for *rank, q in best if rank == list(max(best)[:2])] or [p]

        to = sp.lil_matrix((n, n))
        for p in range(n):
            for q in takers(p):
                to[p, q] = 1 / len(takers(p))
        to = to.tocsr() ** n
        ends = corners[:, -2:].ravel()
        by_point = to.T @ sp.csr_matrix((np.repeat(volume / 2, 2), (ends, np.repeat(count, 2))), (n, len(corners)))
        own = by_point.getnnz(axis=1) > 0
        k = k + stiffness(by_point.tocsr()[own], lam - low, 0)

    m = sp.csr_matrix((len(extended), len(extended)))
    unit = density * volume / ((dim + 1) * (dim + 2))
    for a in range(dim + 1):
        for b in range(dim + 1):
            value = unit * (2 if a == b else 1)
            m = m + sp.csr_matrix((value, (corners[:, a], corners[:, b])), m.shape)
    m = sp.kron(sp.identity(dim), interpolate.T @ m @ interpolate)
    order = np.arange(dim * n).reshape(dim, n).T.ravel()
    return k[order][:, order], m.tocsr()[order][:, order]


def eigenvalues(k, m, held, dim):
    free = np.setdiff1d(np.arange(k.shape[0]), (dim * held[:, None] + np.arange(dim)).ravel())
    dense = lambda a: np.asarray(a.todense())[np.ix_(free, free)]
    return scipy.linalg.eigh(dense(k), dense(m), eigvals_only=True)[:MODES].tolist()


def cases():
    for shape, n in [("hexahedron", (4, 2, 2)), ("wedge", (4, 2, 2)), ("tetrahedron", (4, 2, 2)),
                     ("quadrilateral", (6, 3)), ("triangle", (6, 3))]:
        lengths = (2.0, 0.9, 0.8)[: len(n)]
        points, cells, held = body(shape, n, lengths, seed=len(n) + len(shape))
        for poisson in (0.3, 0.49):
            material = dict(young=2.5e6, poisson=poisson, density=1100.0)
            k, m = smoothed(shape, points, cells, **material)
            yield {
                "shape": shape, **material,
                "points": points.tolist(), "cells": cells.tolist(), "held": held.tolist(),
                "eigenvalues": eigenvalues(sp.csr_matrix(k), sp.csr_matrix(m), held, points.shape[1]),
            }


def main():
    found = list(cases())
    if sys.argv[1:] == ["--write"]:
        lines = ",\n".join(json.dumps(case) for case in found)
        REFERENCE.write_text(f"[\n{lines}\n]\n")
        print(f"wrote {REFERENCE}: {len(found)} bodies")
        return 0
    if sys.argv[1:]:
        print(__doc__, file=sys.stderr)
        return 2
    worst = 0.0
    for case, old in zip(found, json.loads(REFERENCE.read_text()), strict=True):
        off = np.max(np.abs(np.array(case["eigenvalues"]) / np.array(old["eigenvalues"]) - 1))
        print(f"{case['shape']:14} nu {case['poisson']}: {off:.1e}")
        worst = max(worst, off)
    return 0 if worst < 1e-9 else 1


if __name__ == "__main__":
    sys.exit(main())
