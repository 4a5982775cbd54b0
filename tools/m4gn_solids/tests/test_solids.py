"""python -m unittest discover -t . m4gn_solids   (in tools/)"""

import unittest

import numpy as np

from m4gn_solids import draws, elements
from m4gn_solids.contact import Contact
from m4gn_solids.equilibrium import March, Solid
from m4gn_solids.fixture import MATERIAL, bar, sphere
from m4gn_solids.meshing import Body
from m4gn_solids.obstacles import Obstacle, RoundedBox, RoundedCylinder

SHAPES = {
    "sphere": RoundedBox([0.8] * 3, 0.8),
    "block": RoundedBox([0.8, 0.5, 0.6], 0.2),
    "cylinder": RoundedCylinder(0.5, 0.9, 0.15),
}


def tetrahedra():
    """A unit cube in five tetrahedra, held at x = 0."""
    points = np.array([(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
    cells = np.array([(0, 1, 2, 4), (1, 3, 2, 7), (1, 4, 5, 7), (2, 4, 7, 6), (1, 2, 4, 7)])
    p = points[cells]
    volume = np.einsum("ci,ci->c", np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), p[:, 3] - p[:, 0])
    cells[volume < 0] = cells[volume < 0][:, [0, 2, 1, 3]]
    return Body(points, cells, elements.TETRAHEDRON, points[:, 0] == 0)


def of_rubber(body):
    """The body with the material of the fixture."""
    return Solid(body, MATERIAL["young"], MATERIAL["poisson"])


class Obstacles(unittest.TestCase):
    def test_known_distances(self):
        gap = SHAPES["sphere"].distance(np.array([(0, 0, 2.0), (0.1, 0, 0)]))[0]
        np.testing.assert_allclose(gap, [1.2, -0.7], atol=1e-14)
        gap = SHAPES["block"].distance(np.array([(1.0, 0, 0), (0, 0, 0.5), (0, 0.9, 0)]))[0]
        np.testing.assert_allclose(gap, [0.2, -0.1, 0.4], atol=1e-14)
        gap = SHAPES["cylinder"].distance(np.array([(0, 0, 0.7), (0.2, 1.0, 0), (0, 0, 0.4)]))[0]
        np.testing.assert_allclose(gap, [0.2, 0.1, -0.1], atol=1e-14)

    def test_derivatives_by_differences(self):
        random = np.random.default_rng(3)
        step = 1e-6
        for name, shape in SHAPES.items():
            points = random.uniform(-1.3, 1.3, (300, 3))
            # The core is not smooth; contact never gets that deep.
            points = points[shape.distance(points)[0] > -0.1]
            _, gradient, hessian = shape.distance(points)
            for i in range(3):
                shift = step * np.eye(3)[i]
                low, high = shape.distance(points - shift), shape.distance(points + shift)
                slope = (high[0] - low[0]) / (2 * step)
                # A few points lie across the border of two patches, where the second derivative jumps.
                with self.subTest(shape=name, axis=i):
                    np.testing.assert_allclose(slope, gradient[:, i], atol=1e-5)
                    bend = np.abs((high[1] - low[1]) / (2 * step) - hessian[:, i]).max(axis=1)
                    self.assertLess(np.quantile(bend, 0.97), 1e-5)

    def test_surfaces_are_closed_and_lie_on_the_shape(self):
        volumes = {"sphere": 4 / 3 * np.pi * 0.8**3, "cylinder": np.pi * 0.25 * 1.8}
        for name, shape in SHAPES.items():
            with self.subTest(shape=name):
                points, triangles = shape.surface(0.1)
                np.testing.assert_allclose(shape.distance(points)[0], 0, atol=1e-12)
                edges = {}
                for a, b, c in triangles.tolist():
                    for edge in ((a, b), (b, c), (c, a)):
                        self.assertNotIn(edge, edges)
                        edges[edge] = True
                self.assertTrue(all((b, a) in edges for a, b in edges))
                p = points[triangles]
                volume = np.einsum("ti,ti->", p[:, 0], np.cross(p[:, 1], p[:, 2])) / 6
                self.assertGreater(volume, 0)
                if name in volumes:
                    self.assertLess(abs(volume / volumes[name] - 1), 0.05)

    def test_motion_turns_about_the_centre(self):
        angles = np.array([0, np.pi / 2])
        obstacle = Obstacle(SHAPES["block"], np.array([(0, 0, 0), (1.0, 0, 0)]), np.eye(3), np.array([0, 0, 1.0]), angles)
        np.testing.assert_allclose(obstacle.place(np.array([(0.8, 0, 0)]), 1), [(1, 0.8, 0)], atol=1e-14)
        gap = obstacle.distance(np.array([(1, 1.0, 0)]), 1)[0]
        np.testing.assert_allclose(gap, [0.2], atol=1e-14)


class Bodies(unittest.TestCase):
    def test_stiffness(self):
        for body in (bar(), tetrahedra()):
            with self.subTest(kind=body.kind):
                solid = of_rubber(body)
                solid.set(np.zeros_like(body.points))
                stiffness = np.zeros((solid.size, solid.size))
                np.add.at(stiffness, (solid.row, solid.column), solid.tangent())
                x, y, z = body.points.T
                zero = np.zeros_like(x)
                scale = abs(stiffness).max()
                for turn in ([-y, x, zero], [zero, -z, y], [z, zero, -x]):
                    force = stiffness @ np.array(turn).T.ravel()
                    self.assertLess(np.abs(force).max(), 1e-12 * scale * np.abs(body.points).max())
                self.assertLess(abs(stiffness - stiffness.T).max(), 1e-12 * scale)
                values = np.linalg.eigvalsh(stiffness)
                self.assertLess(np.abs(values[:6]).max(), 1e-9 * values[-1])
                self.assertGreater(values[6], 1e-4 * values[-1])

    def test_uniaxial_tension(self):
        """A stretch that only Poisson's ratio and E decide, small: stress E times strain."""
        body = bar()
        solid = of_rubber(body)
        strain = 1e-5
        solid.set(body.points * strain * np.array([1, -0.4, -0.4]))
        pull = solid.force()[body.points[:, 0] > 0.019].sum(axis=0)
        self.assertLess(np.abs(pull - [1e6 * strain * 1e-4, 0, 0]).max(), 1e-3 * 1e6 * strain * 1e-4)

    def test_tangents_by_differences(self):
        body, obstacle = bar(), sphere(3)
        solid = of_rubber(body)
        random = np.random.default_rng(1)
        contact = Contact(body, obstacle, 3e4, 3e-4)
        u = random.uniform(-2e-4, 2e-4, body.points.shape)
        step = 1e-8 * random.uniform(-1, 1, body.points.shape)

        def residual(displacement):
            self.assertTrue(solid.set(displacement))
            push, triplets = contact.evaluate(body.points + displacement, 1.5)
            return (solid.force() + push).ravel(), triplets

        (low, _), (high, _) = residual(u - step), residual(u + step)
        _, (row, column, value) = residual(u)
        self.assertGreater(len(row), 0, "nothing touches")
        tangent = np.zeros((36, 36))
        np.add.at(tangent, (solid.row, solid.column), solid.tangent())
        np.add.at(tangent, (row, column), value)
        predicted = 2 * tangent @ step.ravel()
        self.assertLess(np.abs(high - low - predicted).max(), 1e-5 * np.abs(predicted).max())

    def test_frames_are_equilibria(self):
        body, obstacle = bar(), sphere(3)
        solid = of_rubber(body)
        march = March(body, obstacle, solid, 1e6)
        for frame, u in enumerate(march.frames()):
            solid.set(u)
            push, _ = march.contact.evaluate(body.points + u, frame)
            free = (solid.force() + push)[~body.fixed]
            self.assertLess(np.linalg.norm(free), 1e-5 * max(np.linalg.norm(push.sum(axis=0)), march.least_force))
        self.assertGreater(march.gap, -0.05 * march.size)
        self.assertLess(march.gap, 0.03 * march.size)
        self.assertLess(u[:, 1].min(), -5e-4)

    def test_skin_and_edges(self):
        body = bar()
        self.assertEqual(len(elements.skin(body.cells, body.kind)), 8 + 6)
        self.assertEqual(len(elements.edges(body.cells, body.kind)), 24)


class Draws(unittest.TestCase):
    def test_depend_on_seed_index_and_attempt_only(self):
        for family in draws.FAMILIES:
            one, other = (draws.draw(draws.generator(family, False, 7, i, 0), family, False) for i in (3, 4))
            self.assertEqual(one, draws.draw(draws.generator(family, False, 7, 3, 0), family, False))
            self.assertNotEqual(one, other)
            self.assertNotEqual(one, draws.draw(draws.generator(family, False, 7, 3, 1), family, False))

    def test_large_beams(self):
        small, large = (draws.draw(draws.generator("deforming-beam", False, 7, 3, 0), "deforming-beam", l) for l in (False, True))
        self.assertAlmostEqual(large["body"]["length"] / small["body"]["length"], 2)
        self.assertAlmostEqual(large["body"]["height"] / small["body"]["height"], 1.5)


if __name__ == "__main__":
    unittest.main()
