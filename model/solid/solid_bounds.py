"""The energy of a true solid between two that can be computed.

Under forces C is the compliance of the true body, twice its energy. A displacement v without gaps
on all cells that the body may touch, at rest where they are held, is admissible in the body, and

    F(v)² / a(v, v) ≤ C,  a(v, v) ≥ ∫ ε(v) : C ε(v) over the body,

if a(v, v) counts whole cells, and small cubes of cut ones that the body may touch. A stress that
balances in the cells that are surely whole, and is 0 elsewhere, balances in the body: these cells
alone are softer. Where sides are moved, and no force acts, both turn round: v as it is moved has
more energy than the body, and the whole cells have less.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product
from math import inf
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import distance_transform_edt, label
from scipy.sparse import diags_array
from scipy.sparse.linalg import LinearOperator, cg

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ConvergenceError, SceneError
from kaju.model.elastic.bounds.bound_cells import corner_ends
from kaju.model.elastic.bounds.shape_functions import element_stiffness
from kaju.model.elastic.fields import node_displacement
from kaju.model.elastic.solve import solve

from .cut_cells import CUT, EMPTY, WHOLE, thick

if TYPE_CHECKING:
    from .solid_agents import Certain, SolidAgents

STEPS = 30
"""Of conjugate gradients, by which the displacement is improved: any number leaves a proof."""
ROUNDING = 1e-7  # of themselves: by so much are the bounds set wider
PARTS = 8  # small cubes of a cut cell along every axis: a power of two
AT_ONCE = 4_000
_ENDS = corner_ends(3)


def certain_of(agents: SolidAgents) -> Certain:
    """Return what is proved of the energy of the true body that agents stand for."""
    from .solid_agents import Certain

    moved = any(side.displacement is not None for side in agents.asked.sides.values())
    field = TrilinearField(agents)
    ours = field.energy(moved)
    lower, upper, missing = _of_whole_cells(agents)
    lower, upper = (lower, ours) if moved else (ours, upper)
    missing = missing and f"no {'lower' if moved else 'upper'} bound: {missing}"
    if field.torn:
        missing = "no upper bound: sides that meet are moved apart"
    return Certain(lower * (1.0 - ROUNDING), upper * (1.0 + ROUNDING), missing)


def _of_whole_cells(agents: SolidAgents) -> tuple[float, float, str]:
    """Return the energy (J) of the whole cells at least and at most, and why there is none."""
    from .solid_agents import scene_of_cells

    whole = thick(agents.sorts == WHOLE)
    none = np.zeros((0, 3), dtype=np.int64)
    loaded = np.concatenate([none, *(chosen.cells for chosen in agents.grid.selections)])
    parts, _ = label(whole)
    kept = np.unique(parts[tuple(loaded.T)])
    if (parts[tuple(loaded.T)] == 0).any():
        return 0.0, inf, "cells that are loaded are not among the whole ones"
    if len(loaded):  # what bears no load may be left out
        whole = np.isin(parts, kept)
    try:
        answer = solve(scene_of_cells(agents.asked, whole, agents.solid.edge))
    except (SceneError, ConvergenceError) as error:
        return 0.0, inf, f"the whole cells alone are not solved ({error})"
    if answer.energy_bounds is None:
        return 0.0, inf, answer.no_bound
    return *answer.energy_bounds, ""


class TrilinearField:
    """A displacement without gaps on the cells that the true body may touch."""

    def __init__(self, agents: SolidAgents) -> None:
        solid, sorts = agents.solid, agents.sorts
        self.nodes = tuple(n + 1 for n in solid.shape)
        self.whole, self.cut = (self._corners(np.argwhere(sorts == sort)) for sort in (WHOLE, CUT))
        material = agents.asked.cell_materials[0]
        law = material.youngs_modulus, material.poissons_ratio
        self.unit = law[0] * solid.edge  # energies by that of displacements
        table = part_matrices(law[1])
        self.of_whole = table.sum(axis=0)
        touched = np.concatenate(
            [
                self._touched(agents, part)
                for part in np.array_split(
                    np.argwhere(sorts == CUT), max(1, len(self.cut) // AT_ONCE)
                )
            ]
        )
        self.of_cut = np.tensordot(touched.astype(np.float64), table, 1)
        self.torn = False  # whether sides that meet are moved apart
        self.value, self.free = self._held(agents)
        start = self._start(agents)
        self.value = np.where(self.free, start, self.value)
        self.load = self._load(agents)

    def _corners(self, cells: Ints) -> Ints:
        """Return the nodes at the corners of cells, shape (n, 8)."""
        places = cells[:, None] + _ENDS
        return np.asarray(np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), self.nodes))

    def _touched(self, agents: SolidAgents, cells: Ints) -> Flags:
        """Return which of the small cubes of cut cells the body may touch, shape (n, parts)."""
        found = np.zeros((len(cells), PARTS, PARTS, PARTS), dtype=np.bool_)
        owner, place, size = np.arange(len(cells)), np.zeros((len(cells), 3), dtype=np.int64), PARTS
        while size > 1:  # those that are cut are halved
            size //= 2
            owner = np.repeat(owner, 8)
            place = (place[:, None] + size * _ENDS).reshape(-1, 3)
            low = (cells[owner] + place / PARTS) * agents.solid.edge
            sorts = agents.solid.sorts(low, low + size * agents.solid.edge / PARTS)
            kept = sorts != EMPTY if size == 1 else sorts == WHOLE
            for offset in product(range(size), repeat=3):
                found[(owner[kept], *(place[kept] + offset).T)] = True
            owner, place = owner[sorts == CUT], place[sorts == CUT]
        return found.reshape(len(cells), -1)

    def _held(self, agents: SolidAgents) -> tuple[Floats, Flags]:
        """Return what nodes are moved by where sides hold them, and which are free to move."""
        value, free = np.zeros((*self.nodes, 3)), np.ones((*self.nodes, 3), dtype=np.bool_)
        for index, name in enumerate(agents.asked.lattice.sides):
            side = agents.asked.side_condition(name)
            axis, upper = divmod(index, 2)
            held = [axis] if side.kind == "roller" else [0, 1, 2] if side.kind != "free" else []
            for component in held:
                if component in side.free_axes:
                    continue
                there = np.moveaxis(value[..., component], axis, 0)[-upper]
                moved = side.displacement[component] if side.displacement is not None else 0.0
                loose = np.moveaxis(free[..., component], axis, 0)[-upper]
                self.torn |= bool(((there != moved) & ~loose).any())
                there[...], loose[...] = moved, False
        return value.reshape(-1, 3), free.reshape(-1, 3)

    def _start(self, agents: SolidAgents) -> Floats:
        """Return the displacement of the agents' corners, continued to all that may be touched."""
        known = np.full((*self.nodes, 3), np.nan)
        sizes = zip(agents.origin, agents.problem.shape, strict=True)
        box = tuple(slice(first, first + count + 1) for first, count in sizes)
        known[box] = agents.scales.displacement * node_displacement(
            agents.problem, agents.solution.displacement
        )
        unknown = np.isnan(known).any(axis=-1)
        near = distance_transform_edt(unknown, return_distances=False, return_indices=True)
        return np.asarray(np.nan_to_num(known[tuple(near)]).reshape(-1, 3))

    def _load(self, agents: SolidAgents) -> Floats:
        """Return the forces (N) on the nodes; those on faces are even."""
        found = np.zeros((len(self.value), 3))
        applied = agents.grid.applied()
        corners = self._corners(applied.cells)
        for way in np.unique(applied.direction):
            on = _ENDS[:, way // 2] == way % 2
            some = applied.direction == way
            np.add.at(found, corners[some][:, on], 0.25 * applied.force[some][:, None])
        return found

    def resisted(self, moved: Floats) -> Floats:
        """Return the forces (N) on the nodes that a displacement (m) takes."""
        found = np.zeros(moved.size)
        for corners, matrix in ((self.whole, self.of_whole), (self.cut, self.of_cut)):
            own = moved[corners].reshape(len(corners), 24)
            force = own @ matrix if matrix.ndim == 2 else np.einsum("ni,nij->nj", own, matrix)
            places = (3 * corners[:, :, None] + np.arange(3)).reshape(-1)
            found += np.bincount(places, force.ravel(), moved.size)
        return self.unit * found.reshape(-1, 3)

    def energy(self, moved: bool) -> float:
        """Return the energy (J) that bounds the true one: from above where sides are `moved`."""
        if self.torn:
            return inf
        self._improve()
        energy = 0.5 * float(np.vdot(self.value, self.resisted(self.value)))
        if moved:
            return energy
        work = float(np.vdot(self.load, self.value))
        return 0.25 * work**2 / energy if energy > 0.0 else 0.0

    def _improve(self) -> None:
        """Take steps of conjugate gradients towards the displacement of least potential energy."""
        own = np.zeros(self.value.size)
        for corners, matrix in ((self.whole, self.of_whole), (self.cut, self.of_cut)):
            places = (3 * corners[:, :, None] + np.arange(3)).reshape(-1)
            diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
            shape = (len(corners), 24)
            own += np.bincount(places, np.broadcast_to(diagonal, shape).ravel(), own.size)
        free = np.flatnonzero(self.free.ravel() & (own > 0.0))

        def taken(step: Floats) -> Floats:
            moved = np.zeros(self.value.size)
            moved[free] = step
            return np.asarray(self.resisted(moved.reshape(-1, 3)).ravel()[free])

        left = (self.load - self.resisted(self.value)).ravel()[free]
        matrix = LinearOperator((len(free), len(free)), taken, dtype=np.float64)
        nearly = diags_array(1.0 / (self.unit * own[free]))
        self.value.ravel()[free] += cg(matrix, left, rtol=1e-14, maxiter=STEPS, M=nearly)[0]


@lru_cache(maxsize=8)
def part_matrices(poisson: float) -> Floats:
    """Return twice the energy of the small cubes of a cell by its corners: (parts³, 24, 24).

    Of the edge 1 and Young's modulus 1; what is trilinear in a cell is so in its parts.
    """
    lateral = poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    shear = 0.5 / (1.0 + poisson)
    law = lateral + 2.0 * shear, lateral, shear
    whole = sum(part * of for part, of in zip(law, element_stiffness(3), strict=True))
    found = []
    for part in product(range(PARTS), repeat=3):
        at = (np.array(part) + _ENDS[:, None]) / PARTS
        moved = np.kron(np.where(_ENDS == 1, at, 1.0 - at).prod(axis=-1), np.eye(3))
        found.append(moved.T @ whole @ moved)
    return np.array(found) / PARTS
