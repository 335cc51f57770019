"""A body whose cells have a share of their material's stiffness each, solved again and again.

References
----------
T. E. Bruns, D. A. Tortorelli, "Topology optimization of non-linear elastic structures and
compliant mechanisms", Computer Methods in Applied Mechanics and Engineering 190 (2001) 3443-3459:
the density filter.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from math import ceil

import numpy as np
from scipy.ndimage import correlate

from kaju.arrays import Flags, Floats
from kaju.errors import SceneError
from kaju.model.elastic.equal import fields
from kaju.model.elastic.equal.grid import grid_of
from kaju.model.elastic.equal.problem import ElasticProblem, FaceFields
from kaju.model.elastic.equal.solver import followed
from kaju.model.elastic.equal.staggered import energy_of_cells
from kaju.model.elastic.moduli import Moduli, von_mises
from kaju.model.scene import Scene

_ROUNDING = 1e-9
"""Share of the largest by which numbers may differ and still be mirror images of each other."""


class Neighbours:
    """Weighted means over cells of a body, in which cells outside of it do not count."""

    def __init__(self, body: Flags, weights: Floats) -> None:
        self.body, self._weights = body, weights
        self._alone = np.count_nonzero(weights) == 1
        self._whole = self.sums(np.ones(np.count_nonzero(body)))

    @classmethod
    def within(cls, body: Flags, radius: float) -> Neighbours:
        """Return means whose weights fall linearly to 0 at a radius (cells)."""
        reach = max(ceil(radius) - 1, 0)
        place = np.indices((2 * reach + 1,) * body.ndim) - reach
        distance = np.sqrt((place**2).sum(axis=0))
        return cls(body, np.maximum(max(radius, 1.0) - distance, 0.0))

    @classmethod
    def across_faces(cls, body: Flags) -> Neighbours:
        """Return means over a cell and those it shares a face with, itself as much as all others.

        Were it less, a checkerboard would be felt as its own opposite, and grow.
        """
        weights = np.zeros((3,) * body.ndim)
        for axis in range(body.ndim):
            weights[tuple([slice(None, None, 2) if a == axis else 1 for a in range(body.ndim)])] = 1
        weights[(1,) * body.ndim] = 2 * body.ndim
        return cls(body, weights)

    def sums(self, values: Floats) -> Floats:
        """Return the weighted sums of the cells' values."""
        if self._alone:
            return np.asarray(values * self._weights.max())
        whole = np.zeros(self.body.shape)
        whole[self.body] = values
        return np.asarray(correlate(whole, self._weights, mode="constant")[self.body])

    def means(self, values: Floats) -> Floats:
        """Return the weighted means of the cells' values."""
        return np.asarray(self.sums(values) / self._whole)

    def handed_back(self, values: Floats) -> Floats:
        """Return the derivative by the cells' values of a sum of means with these factors."""
        return self.sums(values / self._whole)

    @cached_property
    def of_all(self) -> Floats:
        """The derivative by the cells' values of the sum of all means."""
        return self.handed_back(np.ones_like(self._whole))


class GrowingBody:
    """The cells of a scene, how stiff they are, and what they feel under its loads.

    The cells are squares or cubes, the loads forces that do not depend on what has grown.
    `compliance`: F·u, the work (J) of the final forces on the displacements; `energy`, shape (n,):
    stored in every cell (J), with its share of the edges round it.
    """

    def __init__(self, scene: Scene, stage: int | None) -> None:
        if scene.body.gravity is not None:
            raise SceneError(
                "body.gravity: the weight of a body that grows would change with it; leave it out"
            )
        if any(side.displacement is not None for side in scene.sides.values()):
            raise SceneError(
                "sides: a body grows under forces; of a side that is moved the work grows with "
                "the stiffness. Load it by [[loads]]"
            )
        applied = scene.applied(stage)
        if not np.any(applied.force):
            raise SceneError("loads: nothing grows without forces; add [[loads]]")
        grid = grid_of(scene, stage, stiffness=np.ones(scene.lattice.shape))
        if grid.division > 1:
            raise SceneError(f"body: {grid.notes[0]}; give smaller cells (scene.refine(2))")
        self._whole = grid.problem
        self.body: Flags = np.asarray(self._whole.kinds[self._whole.inner] >= 0)
        ends = zip(grid.origin, self.body.shape, strict=True)
        self.box = tuple(slice(start, start + size) for start, size in ends)
        self._mirrors = [axis for axis in range(self.body.ndim) if _mirrored(self._whole, axis)]
        self._moved: FaceFields | None = None

    def solve(self, stiffness: Floats, tolerance: float) -> None:
        """Find what cells of a relative stiffness feel, starting from what they felt before."""
        moduli = Moduli(*(modulus * stiffness for modulus in self._whole.moduli))
        problem = replace(self._whole, moduli=moduli)
        solution = followed(problem, self._moved, tolerance)
        self._moved = solution.displacement
        unit = problem.scales.energy
        self.compliance = 2.0 * unit * solution.energy
        # Loose equations are not solved alike on both sides of a mirror, and growth amplifies that.
        self._kept = [axis for axis in self._mirrors if self._same(stiffness, axis)]
        self.energy = self._symmetric(unit * energy_of_cells(problem, self._moved)[self.body])
        self.iterations = solution.iterations

    def von_mises(self) -> Floats:
        """Return the equivalent stress (Pa) of the whole material at the cells' strain."""
        assert self._moved is not None
        problem = self._whole
        parts = fields.stress_parts(replace(problem, surface_shear={}), self._moved)
        stress = fields.cell_tensor(problem, parts)[self.body]
        across: Floats | float = 0.0
        if problem.plane == "strain":
            lateral, shear = problem.moduli.lateral, problem.moduli.shear
            across = lateral / (2 * (lateral + shear)) * np.trace(stress, axis1=-2, axis2=-1)
        return self._symmetric(problem.scales.stress * von_mises(stress, across))

    def _flipped(self, values: Floats, axis: int) -> Floats:
        """Return the values of the cells' mirror images along an axis."""
        field = np.zeros(self.body.shape)
        field[self.body] = values
        return np.asarray(np.flip(field, axis)[self.body])

    def _same(self, values: Floats, axis: int) -> bool:
        return bool(np.abs(values - self._flipped(values, axis)).max(initial=0.0) <= _ROUNDING)

    def _symmetric(self, values: Floats) -> Floats:
        """Return the means of values and their mirror images."""
        for axis in self._kept:
            values = 0.5 * (values + self._flipped(values, axis))
        return values


def _mirrored(problem: ElasticProblem, axis: int) -> bool:
    """Tell whether body, supports and loads are their own mirror image, loads but for the sign."""
    solid, kind = problem.kinds >= 0, np.maximum(problem.kinds, 0)
    stiff = [np.where(solid, modulus[kind], 0.0) for modulus in problem.moduli]
    whole = (*stiff, *problem.face_states, *problem.spring)
    if not all(np.array_equal(field, np.flip(field, axis)) for field in whole):
        return False
    # A mirror turns round what points along its axis; and shear, which has it as one of two axes.
    loads = [(f, f_axis == axis) for f_axis, f in enumerate(problem.force)]
    loads += [(np.asarray(s), axis in pair) for pair, s in problem.surface_shear.items()]
    images = [(f, -np.flip(f, axis) if turned else np.flip(f, axis)) for f, turned in loads]
    most = max(float(np.abs(f).max(initial=0.0)) for f, _ in images)
    return any(
        all(np.abs(f - sign * image).max(initial=0.0) <= _ROUNDING * most for f, image in images)
        for sign in (1.0, -1.0)
    )
