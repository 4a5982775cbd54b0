"""Frictionless contact of a body's skin with a rigid obstacle.

Sampled at the skin's points, edge midpoints and face centroids (points alone let sharp edges sink in). The force is a
penalty with a C1 start: 0 for gaps g > e, k (e - g)^2 / (4 e) for |g| < e, -k g below.
"""

import numpy as np
import scipy.sparse as sp

from . import elements

def samples(body):
    """Sparse matrix [S, N]: sample points are its product with the points. Faces that are fixed whole are left out."""
    rows = _sampled(body)
    row = np.concatenate([np.full(len(r), i) for i, r in enumerate(rows)])
    column = np.concatenate([np.array(r) for r in rows])
    weight = np.concatenate([np.full(len(r), 1 / len(r)) for r in rows])
    return sp.csr_matrix((weight, (row, column)), (len(rows), len(body.points)))


def _sampled(body):
    """The points that each sample is the middle of: one, two of an edge or all of a face."""
    faces = [f for f in elements.skin(body.cells, body.kind) if not body.fixed[list(f)].all()]
    corners = sorted({p for f in faces for p in f if not body.fixed[p]})
    ends = sorted({tuple(sorted((f[i], f[i - 1]))) for f in faces for i in range(len(f))})
    ends = [e for e in ends if not body.fixed[list(e)].all()]
    return [(p,) for p in corners] + ends + faces


def _law(gap, stiffness, blend):
    """Derivative of the penalty's energy with respect to the gap (minus the force), and its derivative."""
    push = stiffness * np.where(gap < -blend, gap, -((blend - gap) ** 2) / (4 * blend))
    return push, stiffness * np.where(gap < -blend, 1.0, (blend - gap) / (2 * blend))


class Contact:
    """Forces of the obstacle on the body's points and their derivatives."""

    def __init__(self, body, obstacle, stiffness, blend):
        """`stiffness` k, N/m at each sample; `blend` e, m."""
        self.obstacle, self.stiffness, self.blend = obstacle, stiffness, blend
        self.samples = samples(body)
        starts = self.samples.indptr
        # Where the blocks of a sample's points go: at most four points
        self.stencil = [
            (self.samples.indices[a:b], self.samples.data[a:b]) for a, b in zip(starts, starts[1:])
        ]

    def gaps(self, positions, frame):
        """Signed distance of each sample, m."""
        return self.obstacle.distance(self.samples @ positions, frame)[0]

    def evaluate(self, positions, frame):
        """Residual force [N, 3] (minus the force on the body) and triplets (row, column, value) of its derivative."""
        points = self.samples @ positions
        centre, _ = self.obstacle.pose(frame)
        reach = self.obstacle.shape.reach() + self.blend
        near = np.flatnonzero(((points - centre) ** 2).sum(axis=1) < reach**2)
        gap, normal, curved = self.obstacle.distance(points[near], frame)
        touching = gap < self.blend
        near, gap, normal, curved = near[touching], gap[touching], normal[touching], curved[touching]
        push, slope = _law(gap, self.stiffness, self.blend)
        residual = np.zeros_like(positions)
        block = slope[:, None, None] * normal[:, :, None] * normal[:, None, :] + push[:, None, None] * curved
        rows, columns, values = [], [], []
        component = np.arange(3)
        for sample, force, matrix in zip(near, push[:, None] * normal, block):
            points_of, weight = self.stencil[sample]
            residual[points_of] += weight[:, None] * force
            dof = (3 * points_of[:, None] + component).ravel()
            rows.append(np.repeat(dof, len(dof)))
            columns.append(np.tile(dof, len(dof)))
            values.append(np.kron(np.outer(weight, weight), matrix).ravel())
        if not rows:
            none = np.empty(0, dtype=int)
            return residual, (none, none, np.empty(0))
        return residual, tuple(map(np.concatenate, (rows, columns, values)))
