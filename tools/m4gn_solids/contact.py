"""Frictionless contact of a body's skin with a rigid obstacle, and of the parts of a body with each other.

Sampled at the skin's points, edge midpoints and face centroids (points alone let sharp edges sink in). The force is a
penalty with a C1 start: 0 for gaps g > e, k (e - g)^2 / (4 e) for |g| < e, -k g below.
"""

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from . import elements

REACH = 0.5
"""How far from each other a sample and a triangle of another part may be to be a pair, in cell sizes."""
OVERHANG = (0.05, 0.25)
"""A sample pushes fully up to the first distance beside its triangle, not at all beyond the second; in cell sizes."""
NEIGHBOURS = 16
"""Triangles whose centroids are nearest to a sample and that are tried."""
FACING = -0.25
"""Cosine of the angle between the normals of a sample and of a triangle: more is not face to face."""


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


class BetweenParts:
    """Forces of the parts of a body on each other and their derivatives.

    Every sample of a part is paired with the nearest triangle of another part's skin that faces it. `pair` does that,
    before an equilibrium is sought; then the sample feels the plane of this triangle, however the two move, so that
    Newton meets no jumps (pairs found afterwards would move the points by less than a hundredth of a cell). A sample
    that hangs over the rim of the other part pushes less, and soon not at all. All parts have samples, so
    every contact is felt from both sides, each with half of the stiffness.
    """

    def __init__(self, body, part, stiffness, blend, size):
        """`part` of each point; `stiffness` k, N/m, and `blend` e, m, as for Contact; `size` of the cells, m."""
        self.part, self.stiffness, self.blend, self.size = part, stiffness / 2, blend, size
        rows = _sampled(body)
        self.samples = samples(body)
        # At most four points; missing ones are the first again, with weight 0
        self.points = np.array([r + (r[0],) * (4 - len(r)) for r in rows])
        self.weights = np.array([(1 / len(r),) * len(r) + (0.0,) * (4 - len(r)) for r in rows])
        faces = elements.skin(body.cells, body.kind)
        self.around = _faces_around(rows, faces)
        # Quadrilaterals are cut into two triangles; a triangle's fourth corner is its third again.
        self.quads = np.array([f if len(f) == 4 else f + f[-1:] for f in faces])
        self.triangles = np.array([t for f in faces for t in ((f[:3], (f[0], *f[2:])) if len(f) == 4 else (f,))])
        # Of each pair: the sample's four points and the triangle's three, the weights of the four, the part of k
        self.paired, self.of_sample, self.share = np.empty((0, 7), dtype=int), np.empty((0, 4)), np.empty(0)

    def pair(self, positions):
        """Finds the pairs at these positions. Returns the smallest gap, m; inf when there is no pair."""
        a, b, c = np.moveaxis(positions[self.triangles], 1, 0)
        normal = _unit(np.cross(b - a, c - a))
        place = self.samples @ positions
        corner = positions[self.quads]
        outward = _unit(self.around @ _unit(np.cross(corner[:, 2] - corner[:, 0], corner[:, 3] - corner[:, 1])))
        found = [
            self._nearest(i, j, place, outward, (a, b, c), normal)
            for i in range(self.part.max() + 1)
            for j in range(self.part.max() + 1)
            if i != j
        ]
        sample, triangle, gap, beside = (np.concatenate(x) for x in zip(*found))
        full, none = (limit * self.size for limit in OVERHANG)
        kept = beside < none
        sample, triangle, gap, beside = sample[kept], triangle[kept], gap[kept], beside[kept]
        self.paired = np.hstack([self.points[sample], self.triangles[triangle]])
        self.of_sample = self.weights[sample]
        fade = np.clip((none - beside) / (none - full), 0, 1)
        self.share = fade**2 * (3 - 2 * fade)
        return float(gap[beside <= full].min(initial=np.inf))

    def _nearest(self, mine, other, place, outward, corners, normal):
        """Pairs of the samples of part `mine` with triangles of part `other`: sample, triangle, gap, how far beside."""
        reach = REACH * self.size
        triangles = np.flatnonzero(self.part[self.triangles[:, 0]] == other)
        a, b, c = (x[triangles] for x in corners)
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        own = np.flatnonzero(self.part[self.points[:, 0]] == mine)
        near = ((place[own] > low.min(axis=0) - reach) & (place[own] < high.max(axis=0) + reach)).all(axis=1)
        own = own[near]
        # A triangle's points are at most as far from its centroid as the longest side.
        farthest = np.linalg.norm(high - low, axis=1).max() + reach
        _, near = cKDTree((a + b + c) / 3).query(place[own], NEIGHBOURS, distance_upper_bound=farthest)
        row, rank = np.nonzero(near < len(triangles))
        sample, triangle = own[row], near[row, rank]
        facing = (outward[sample] * normal[triangles[triangle]]).sum(axis=1) < FACING
        sample, triangle = sample[facing], triangle[facing]
        n, p = normal[triangles[triangle]], place[sample]
        nearest = _closest(p, n, a[triangle], b[triangle], c[triangle])
        distance = np.linalg.norm(p - nearest, axis=1)
        gap = (n * (p - nearest)).sum(axis=1)
        beside = np.linalg.norm(p - nearest - gap[:, None] * n, axis=1)
        # The nearest triangle of each sample; of two that share the nearest point the one whose plane is farther
        order = np.lexsort((distance - 1e-6 * gap, sample))
        best = order[np.diff(sample[order], prepend=-1) > 0]
        best = best[distance[best] < reach]
        return sample[best], triangles[triangle[best]], gap[best], beside[best]

    def _planes(self, positions):
        """Of each pair: gap, sample, the triangle's points and its normal, as long as twice the area."""
        corner = positions[self.paired]
        place = np.einsum("ni,nic->nc", self.of_sample, corner[:, :4])
        a, b, c = corner[:, 4], corner[:, 5], corner[:, 6]
        cross = np.cross(b - a, c - a)
        return (_unit(cross) * (place - a)).sum(axis=1), place, a, b, c, cross

    def allowed(self, positions, change):
        """The part of a step that brings no pair deep into contact at once, where Newton would lose its way."""
        before, after = (self._planes(p)[0] for p in (positions, positions + change))
        lowest = np.minimum(-0.5 * self.blend, before - self.blend)
        deep = (after < lowest) & (self.share > 0.5)
        return float(((before - lowest)[deep] / (before - after)[deep]).min(initial=1.0))

    def evaluate(self, positions):
        """As Contact.evaluate, of the pairs that were found last."""
        gap, place, a, b, c, cross = self._planes(positions)
        on = gap < self.blend
        gap, place, a, b, c, cross = gap[on], place[on], a[on], b[on], c[on], cross[on]
        push, slope = _law(gap, self.stiffness, self.blend)
        push, slope = push * self.share[on], slope * self.share[on]
        double = np.linalg.norm(cross, axis=1)[:, None]
        n = cross / double
        # Barycentric coordinates of the sample in the triangle; gradient of the coordinate of each point of the pair
        gradient = np.zeros((len(gap), 7, 3))
        gradient[:, 4:] = np.stack([np.cross(n, side) / double for side in (c - b, a - c, b - a)], axis=1)
        share = np.einsum("nic,nc->ni", gradient[:, 4:], place - a) + np.array([1.0, 0, 0])
        weight = np.hstack([self.of_sample[on], -share])
        slide = weight[:, :, None] * n[:, None, :]
        residual = np.zeros_like(positions)
        np.add.at(residual, self.paired[on], push[:, None, None] * slide)
        # First and second derivative of the gap: sum of weight n dx; the normal turns by -(sum of gradient n dx).
        turned = np.einsum("nc,nid,nj->nicjd", n, gradient, weight)
        curved = turned + turned.transpose(0, 3, 4, 1, 2)
        curved += np.einsum("n,nc,nd,nie,nje->nicjd", gap, n, n, gradient, gradient, optimize=True)
        block = np.einsum("n,nic,njd->nicjd", slope, slide, slide) - push[:, None, None, None, None] * curved
        row, column = _block_places(self.paired[on])
        return residual, (row, column, block.ravel())

    def links(self):
        """Rows and columns of all that `evaluate` may give for the pairs that were found last."""
        return _block_places(self.paired)


def _block_places(points):
    """Rows and columns of dense blocks between the degrees of freedom of the points of each row."""
    dof = (3 * points[:, :, None] + np.arange(3)).reshape(len(points), 3 * points.shape[1])
    n = dof.shape[1]
    return np.repeat(dof, n, axis=1).ravel(), np.tile(dof, n).ravel()


def _faces_around(rows, faces):
    """Sparse matrix [S, F]: 1 for the faces of the skin that meet at a sample."""
    at = {}
    for number, face in enumerate(faces):
        ends = [tuple(sorted((face[i], face[i - 1]))) for i in range(len(face))]
        for key in [(p,) for p in face] + ends + [face]:
            at.setdefault(key, []).append(number)
    place = [(i, number) for i, key in enumerate(rows) for number in at[key]]
    row, column = np.array(place).T
    return sp.csr_matrix((np.ones(len(place)), (row, column)), (len(rows), len(faces)))


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def _closest(points, normal, a, b, c):
    """The point of the triangle a, b, c (unit normal given) that is closest to each point."""
    height = ((points - a) * normal).sum(axis=1)
    best = points - height[:, None] * normal
    outside = np.zeros(len(points), dtype=bool)
    least = np.full(len(points), np.inf)
    on_side = np.empty_like(points)
    for start, end in ((a, b), (b, c), (c, a)):
        side = end - start
        outside |= (np.cross(side, points - start) * normal).sum(axis=1) < 0
        along = ((points - start) * side).sum(axis=1) / (side * side).sum(axis=1)
        place = start + np.clip(along, 0, 1)[:, None] * side
        distance = ((points - place) ** 2).sum(axis=1)
        nearer = distance < least
        on_side[nearer], least[nearer] = place[nearer], distance[nearer]
    best[outside] = on_side[outside]
    return best
