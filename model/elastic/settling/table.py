"""The elastic rule on a scene as tables: who passes which share of a load to whom.

Faces that can move are numbered first, then the *places* where supports hold the body: the
faces that are given their displacement, and the elastic beds beneath faces. Both engines
and the stability certificate read the same tables, which come from the assembled stiffness:
the share of agent i's load that goes to j is −K_ij/K_ii.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.agents.elastic_rule import ElasticRule
from kaju.arrays import Floats, Ints
from kaju.errors import SceneError
from kaju.model.elastic.grid import grid_of
from kaju.model.elastic.problem import ABSENT, ACTIVE, FIXED
from kaju.model.elastic.staggered import Numbering, stiffness_matrix
from kaju.model.scene import scene_needed

from .boundary import Boundary, free_surfaces, supports
from .push_transfer import coarsen

if TYPE_CHECKING:
    from kaju.model.scene import Scene


FEWEST_FACES = 12
"""A level with at most this many faces has no parents."""


@dataclass(frozen=True, eq=False)
class PushLevel:
    """The agents of one level and their links, as arrays."""

    numbering: Numbering  # Which faces there are, and their numbers
    stiffness: Floats
    """Load (N) that moves a face by 1 m while all others hold still. Shape (faces,)."""
    shares: sp.csr_array
    """Row i: what becomes of each newton that agent i takes. On the finest level the columns go on
    with the supports. Shape (faces, places)."""
    prolong: sp.csr_array | None = None
    """The way from the parents; the way to them is its transpose."""

    @property
    def size(self) -> int:
        """Number of faces."""
        return len(self.stiffness)

    @cached_property
    def arrivals(self) -> sp.csr_array:
        """Row j: which share of everybody's load arrives at j."""
        return sp.csr_array(self.shares.T)

    @cached_property
    def restrict(self) -> sp.csr_array:
        """Row p: how much of the children's loads parent p is handed."""
        assert self.prolong is not None
        matrix = sp.csr_array(self.prolong.T)
        matrix.sort_indices()
        return matrix

    @cached_property
    def place(self) -> tuple[Ints, Ints]:
        """Axis, shape (faces,), and index with the rim, shape (faces, dimension), of each face."""
        return face_indices(self.numbering.states, ACTIVE)


class PushTable:
    """Who passes how much to whom: the elastic rule on a scene's faces.

    `problem` are the scaled arrays, cut to the box round the body, and `origin` the cell of `grid`
    that is their first; `unit` is what one scaled stiffness is in N/m.
    """

    # The scene on the cells whose faces the agents stand on: its own, or, if a member is only one
    # cell wide and could not pass on any shear, cells half as large
    grid: Scene
    # The faces of the cells, then those of their parents, if the order has any
    levels: tuple[PushLevel, ...]
    # What loads and given displacements leave on every face and support (N). Shape (places,)
    load: Floats
    given: Floats  # Displacement (m) of the faces that supports hold. Shape (fixed faces,)
    reference: float  # k₀ (N/m): stiffness of a face inside the stiffest material
    threshold: float  # γ (N)

    def __init__(self, scene: Scene, stage: int | None = None, order: str | None = None) -> None:
        scene_needed(scene)
        if not isinstance(scene.rule, ElasticRule):
            raise SceneError(
                f"rule.kind: ElasticModel passes loads on by the elastic rule, got "
                f'{scene.rule.kind!r}; set kind = "elastic", or take LoadModel'
            )
        self.rule = scene.rule
        self.order = order or self.rule.order
        self.grid, self.problem, self.origin, self.subdivision, _ = grid_of(scene, stage)
        scales = self.problem.scales
        self.unit = scales.force / scales.displacement
        states = self.problem.face_states()
        self._numbering = Numbering(states)
        self.fixed_place = face_indices(states, FIXED)
        matrix = self._assemble(states)
        self.levels = self._build_levels(matrix)
        self.load, self.given = self._initial(matrix)
        self.reference = self._reference()
        self.threshold = self.rule.threshold or self._threshold_for(self.rule.tolerance)

    def _assemble(self, states: tuple[NDArray[np.int8], ...]) -> sp.csr_array:
        """Return the stiffness (N/m) of all faces, those that move before those that are held."""
        present = Numbering(tuple(np.where(s == ABSENT, ABSENT, ACTIVE) for s in states))
        zero = tuple(np.zeros_like(spring) for spring in self.problem.spring)
        matrix = stiffness_matrix(replace(self.problem, spring=zero), present)
        moves = present.gather(tuple((s == ACTIVE).astype(float) for s in states)) > 0.0
        order = np.concatenate([np.flatnonzero(moves), np.flatnonzero(~moves)])
        self._present, self._order = present, order
        return sp.csr_array(self.unit * matrix[order][:, order])

    def _build_levels(self, matrix: sp.csr_array) -> tuple[PushLevel, ...]:
        n = self._numbering.size
        spring = self.unit * self._numbering.gather(self.problem.spring)
        self.bedded = np.flatnonzero(spring)
        beds = sp.csr_array(
            (spring[self.bedded], (self.bedded, np.arange(len(self.bedded)))),
            shape=(n, len(self.bedded)),
        )
        own = sp.csr_array(matrix[:n, :n] + sp.diags_array(spring))
        held = sp.csr_array(sp.hstack([matrix[:n, n:], -beds], format="csr"))
        levels = [make_level(self._numbering, own, held)]
        while self.order == "multilevel" and levels[-1].size > FEWEST_FACES:
            parents, prolong = coarsen(levels[-1].numbering)
            if not 0 < prolong.shape[1] < 0.8 * prolong.shape[0]:
                break
            prolong.sort_indices()
            levels[-1] = replace(levels[-1], prolong=prolong)
            own = sp.csr_array(levels[-1].restrict @ (own @ prolong))
            levels.append(make_level(parents, own))
        return tuple(levels)

    def _initial(self, matrix: sp.csr_array) -> tuple[Floats, Floats]:
        scales = self.problem.scales
        n = self._numbering.size
        force = scales.force * self._present.gather(self.problem.force)[self._order]
        given = scales.displacement * self._present.gather(self.problem.fixed)[self._order][n:]
        load = force - matrix[:, n:] @ given
        return np.concatenate([load, np.zeros(len(self.bedded))]), given

    def _reference(self) -> float:
        moduli, dimension = self.problem.moduli, self.problem.dimension
        used = np.unique(self.problem.kinds[self.problem.kinds >= 0])
        inside = 2.0 * moduli.stretch + 2.0 * (dimension - 1) * moduli.shear
        return self.unit * float(inside[used].max())

    def _threshold_for(self, tolerance: float) -> float:
        """Return the γ at which the error meter is sure to be at most `tolerance` at rest.

        The meter's denominator, load · displacement, is at least (f·v)²/(v·Kv) for any v.
        """
        finest = self.levels[0]
        load = self.load[: finest.size]
        trial = load / finest.stiffness
        passed = finest.arrivals @ load
        work = float(load @ trial)
        held = work - float(trial @ passed[: finest.size])
        if work <= 0.0 or held <= 0.0:
            return float(np.abs(load).max(initial=0.0)) * tolerance or tolerance
        faces = sum(level.size for level in self.levels)
        return tolerance * sqrt(self.reference / held / faces) * work

    @property
    def applied(self) -> Floats:
        """Sum of the applied forces per axis (N)."""
        total = np.array([float(f.sum()) for f in self.problem.force])
        return np.asarray(total * self.problem.scales.force, dtype=np.float64)

    @cached_property
    def place_axes(self) -> Ints:
        """Axis along which each support holds: held faces first, then bedded ones."""
        return np.concatenate([self.fixed_place[0], self.levels[0].place[0][self.bedded]])

    @cached_property
    def holding(self) -> Boundary:
        """The cells that hold the body; columns are the supports."""
        axis, index = self.levels[0].place
        bedded = axis[self.bedded], index[self.bedded]
        return supports(self.problem, self.fixed_place, bedded)

    @cached_property
    def open_air(self) -> Boundary:
        """The air beside the body; columns are the faces, entries the shares given back."""
        finest = self.levels[0]
        return free_surfaces(self.problem, finest.place, finest.stiffness / self.unit)

    def weight(self, level: int) -> Floats:
        """Return √(k₀/k) per face: by how much its load counts; 0 for a parent of nobody."""
        stiffness = self.levels[level].stiffness
        ratio = np.divide(
            self.reference, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0.0
        )
        root: Floats = np.sqrt(ratio)
        return root

    def positions(self, level: int) -> Floats:
        """Return where the faces of a level are (m), shape (faces, dimension)."""
        axis, index = self.levels[level].place
        centre: Floats = index.astype(np.float64) - 0.5
        centre[np.arange(len(axis)), axis] -= 0.5
        centre = centre * 2.0**level + np.asarray(self.origin)
        return centre * self.problem.scales.length


def make_level(
    numbering: Numbering, own: sp.csr_array, held: sp.csr_array | None = None
) -> PushLevel:
    """Turn a stiffness matrix, and its columns of supports, into shares."""
    stiffness = own.diagonal()
    inverse = np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0.0)
    others = own - sp.diags_array(stiffness)
    everybody = others if held is None else sp.hstack([others, held], format="csr")
    shares = sp.csr_array(sp.diags_array(-inverse) @ everybody)
    shares.eliminate_zeros()
    shares.sort_indices()
    return PushLevel(numbering, stiffness, shares)


def face_indices(states: tuple[NDArray[np.int8], ...], wanted: int) -> tuple[Ints, Ints]:
    """Return axis and index of the faces in a state, in the order of their numbers."""
    axes, indices = [], []
    for axis, state in enumerate(states):
        index = np.argwhere(state == wanted).astype(np.int64)
        axes.append(np.full(len(index), axis, dtype=np.int64))
        indices.append(index)
    return np.concatenate(axes), np.concatenate(indices)
