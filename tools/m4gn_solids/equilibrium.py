"""Quasi-static equilibria of a hyperelastic body under a moving rigid obstacle: Newton, one frame after another."""

import felupe as fem
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from felupe.assembly import IntegralForm
from scipy.sparse.csgraph import reverse_cuthill_mckee

from . import elements
from .contact import Contact

PENALTY = 30.0
"""Contact stiffness at a sample, in E times the cell size."""
BLEND = 0.03
"""Where contact starts to be felt, in cell sizes."""
TOLERANCE = 1e-5
"""Residual of the free degrees of freedom, relative to the reactions."""
ITERATIONS = 25
SMALLEST_STEP = 1 / 300
"""Of a frame; a body that needs less has no quasi-static path (it snaps, or slips off)."""


class NoEquilibrium(Exception):
    """There is no quasi-static path through this frame."""

    def __init__(self, frame):
        super().__init__(f"no equilibrium at frame {frame}")
        self.frame = frame


class Banded:
    """A symmetric matrix of fixed pattern in LAPACK's lower banded form, in the order of least bandwidth."""

    def __init__(self, row, column, free, size):
        """`row`, `column`: the pattern's degrees of freedom; `free`: those that are unknown."""
        pattern = sp.csr_matrix((np.ones(len(row)), (row, column)), (size, size))[free][:, free]
        order = reverse_cuthill_mckee(pattern.tocsr(), symmetric_mode=True)
        self.free = np.asarray(free)[order]
        self.place = np.full(size, -1)
        self.place[self.free] = np.arange(len(self.free))
        self.keep, below, along = self._index(row, column)
        self.width = int(below.max()) + 1
        self.flat = along * self.width + below

    def _index(self, row, column):
        """Which entries are on or below the diagonal, and where: distance below it, and column."""
        i, j = self.place[row], self.place[column]
        keep = np.flatnonzero((j >= 0) & (i >= j))
        return keep, i[keep] - j[keep], j[keep]

    def fill(self, value, more):
        """Band [width, n] (Fortran order) of the pattern's values plus triplets inside the band."""
        band = np.bincount(self.flat, value[self.keep], minlength=self.width * len(self.free))
        row, column, extra = more
        keep, below, along = self._index(row, column)
        np.add.at(band, along * self.width + below, extra[keep])
        return band.reshape(len(self.free), self.width).T

    def solve(self, band, right):
        """Solution in the order of all degrees of freedom; zero where they are fixed."""
        solution = np.zeros(len(self.place))
        try:
            factor = la.cholesky_banded(band, lower=True, check_finite=False)
            found = la.cho_solve_banded((factor, True), right[self.free], check_finite=False)
        except la.LinAlgError:
            # Not positive definite: compressed or close to an instability
            n = self.width - 1
            full = np.zeros((2 * n + 1, len(self.free)))
            full[n:] = band
            for k in range(1, n + 1):
                full[n - k, k:] = band[k, : len(self.free) - k]
            found = la.solve_banded((n, n), full, right[self.free], check_finite=False)
        solution[self.free] = found
        return solution


class Solid:
    """Internal forces of a neo-Hookean body, and their derivative."""

    def __init__(self, body, young, poisson):
        self.body = body
        shear, bulk = young / (2 * (1 + poisson)), young / (3 * (1 - 2 * poisson))
        region = elements.region(body.points, body.cells, body.kind)
        self.field = fem.FieldContainer([fem.Field(region, dim=3)])
        self.solid = fem.SolidBody(fem.NeoHooke(mu=shear, bulk=bulk), self.field)
        dof = (3 * body.cells[:, :, None] + np.arange(3)).reshape(len(body.cells), -1)
        n = dof.shape[1]
        self.row, self.column = np.repeat(dof, n, axis=1).ravel(), np.tile(dof, n).ravel()
        self.size = 3 * len(body.points)
        self.cell_dof = dof.ravel()

    def set(self, displacement):
        """Sets the displacement [N, 3]; False when a cell is turned inside out by it."""
        self.field[0].values[...] = displacement
        gradient = self.field.extract()[0]
        return bool((np.linalg.det(np.moveaxis(gradient, (0, 1), (-2, -1))) > 0).all())

    def force(self):
        """Internal forces [N, 3], N, at the displacement that was set."""
        stress = self.solid.evaluate.gradient(self.field)
        form = IntegralForm(stress[:1], v=self.field, dV=self.field.region.dV)
        value = form.integrate()[0]
        # [point of the cell, component, cell]
        flat = np.moveaxis(value, -1, 0).reshape(-1)
        return np.bincount(self.cell_dof, flat, minlength=self.size).reshape(-1, 3)

    def tangent(self):
        """Values of the derivative for `row`, `column` (entries of cells, to be summed), N/m."""
        elasticity = self.solid.evaluate.hessian(self.field)
        form = IntegralForm(elasticity[:1], v=self.field, u=self.field, dV=self.field.region.dV)
        value = form.integrate()[0]
        n = self.body.cells.shape[1] * 3
        return np.moveaxis(value, -1, 0).reshape(-1, n, n).ravel()


class March:
    """The frames one after another.

    `gap` is the smallest gap between obstacle and body at any frame in m, `gap_frame` where.
    """

    def __init__(self, body, obstacle, solid, young):
        self.body, self.obstacle, self.solid = body, obstacle, solid
        self.size = elements.cell_size(body.points, elements.edges(body.cells, body.kind))
        self.contact = Contact(body, obstacle, PENALTY * young * self.size, BLEND * self.size)
        free = np.flatnonzero(np.repeat(~body.fixed, 3))
        self.banded = Banded(solid.row, solid.column, free, solid.size)
        self.fixed_dof = np.flatnonzero(np.repeat(body.fixed, 3))
        self.least_force = 1e-3 * young * self.size**2
        self.iterations = 0
        self.gap, self.gap_frame = np.inf, 0

    def frames(self):
        """Yields the displacement [N, 3] of every frame, the first at rest. The solid is left at the frame's state."""
        now = np.zeros_like(self.body.points)
        rate = None
        self.solid.set(now)
        self._note(now, 0)
        yield now
        for frame in range(1, len(self.obstacle.angles)):
            done, step = 0.0, 1.0
            while done < 1 - 1e-12:
                reached = min(1.0, done + step)
                found = None
                if rate is not None:
                    found = self._newton(now + rate * (reached - done), frame - 1 + reached)
                if found is None:
                    found = self._newton(now, frame - 1 + reached)
                if found is None:
                    rate, step = None, step / 4
                    if step < SMALLEST_STEP:
                        raise NoEquilibrium(frame)
                else:
                    rate, step = (found - now) / (reached - done), min(1.0, 2 * step)
                    now, done = found, reached
            self._note(now, frame)
            yield now

    def _note(self, displacement, frame):
        gap = self.contact.gaps(self.body.points + displacement, frame).min()
        if gap < self.gap:
            self.gap, self.gap_frame = float(gap), frame

    def _residual(self, displacement, frame):
        if not self.solid.set(displacement):
            return None
        push, contact_tangent = self.contact.evaluate(self.body.points + displacement, frame)
        force = self.solid.force() + push
        return force.ravel(), float(np.linalg.norm(push.sum(axis=0))), contact_tangent

    def _newton(self, guess, frame):
        """Displacement at equilibrium, or None."""
        displacement = np.where(self.body.fixed[:, None], 0.0, guess)
        before, change, halvings = np.inf, None, 0
        for iteration in range(ITERATIONS):
            while True:
                state = self._residual(displacement, frame)
                norm = np.inf if state is None else float(np.linalg.norm(state[0][self.banded.free]))
                # The first Newton step may raise the residual (contact switches on), later ones little.
                good = norm < 1.5 * before or (iteration < 2 and state is not None)
                if good and np.isfinite(norm):
                    break
                if change is None or halvings == 5:
                    return None
                change, halvings = change / 2, halvings + 1
                displacement = displacement - change
            residual, push, contact_tangent = state
            reaction = float(np.linalg.norm(residual[self.fixed_dof]))
            if iteration and norm < TOLERANCE * max(reaction, push, self.least_force):
                return displacement
            before, halvings = norm, 0
            band = self.banded.fill(self.solid.tangent(), contact_tangent)
            try:
                change = -self.banded.solve(band, residual).reshape(-1, 3)
            except la.LinAlgError:
                return None
            self.iterations += 1
            largest = np.abs(change).max()
            if not np.isfinite(largest):
                return None
            change *= min(1.0, 2 * self.size / max(largest, 1e-300))
            displacement = displacement + change
        return None
