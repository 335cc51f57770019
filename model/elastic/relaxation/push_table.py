"""The elastic rule on a scene as tables: which share of its load each agent passes to which other.

Faces that can move are numbered first, then the *places* where supports hold the body: faces of
prescribed displacement, and elastic foundations beneath faces. Both engines and the stability
certificate read these tables, which come from the assembled stiffness matrix K: the share of
agent i's load that goes to j is −K_ij/K_ii.

A face at a free surface has no neighbour ahead. Its forward share comes straight back, it yields
to it again, and again: P/k·(1 + c/k + c²/k² + ...) = P/(k − c), with c the stiffness that
is missing. So at a free surface an agent has the smaller stiffness k − c.

By which share ω may all agents yield at once? A wave, a damped Jacobi step, changes the loads left
by the factor I − ω D⁻¹K, with D the diagonal of K. It calms down if ω < 2/λmax(D⁻¹K). Cell by cell
and corner by corner K and D are sums of small matrices, and the largest eigenvalue of the sum is at
most the largest of the parts: 4 for a corner, 2(1 + (dimension − 1)·C₁₂/C₁₁) for a cell, so never
above 4 in the plane and 6 in space. Below this bound the scene's own eigenvalue is found by Lanczos
iteration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from kaju.agents.elastic_rule import ElasticRule
from kaju.arrays import Floats, Ints, spread
from kaju.errors import SceneError
from kaju.model.elastic.equal.grid import grid_of
from kaju.model.elastic.equal.problem import ABSENT, ACTIVE, FIXED
from kaju.model.elastic.equal.staggered import Numbering, compact, stiffness_matrix
from kaju.model.elastic.moduli import moduli_at
from kaju.model.scene import Scene, scene_needed

States = NDArray[np.int8]


@dataclass(frozen=True, eq=False)
class PushLevel:
    """The agents of one level and their links, as arrays."""

    numbering: Numbering  # Which faces there are, and their numbers
    stiffness: Floats  # Load (N) that moves a face by 1 m while all others hold still
    shares: sp.csr_array  # Row i: shares of agent i's load, by face, on the finest level by support
    prolong: sp.csr_array | None = None  # Displacement of the faces by that of their parents

    @property
    def size(self) -> int:
        """Number of faces."""
        return len(self.stiffness)

    @cached_property
    def arrivals(self) -> sp.csr_array:
        """The transpose of `shares`: row j has the shares that arrive at j."""
        return sp.csr_array(self.shares.T)

    @cached_property
    def restrict(self) -> sp.csr_array:
        """The transpose of `prolong`: loads of parents by those of their children."""
        assert self.prolong is not None
        matrix = sp.csr_array(self.prolong.T)
        matrix.sort_indices()
        return matrix

    @cached_property
    def place(self) -> tuple[Ints, Ints]:
        """Axis, and index with the ghost layer, shape (faces, dimension), of each face."""
        return face_indices(self.numbering.states, ACTIVE)


class PushTable:
    """The elastic rule on a scene's faces: levels of agents, their loads and the threshold.

    `problem` are the scaled arrays, cut to the box round the body, and `origin` is the cell of
    `grid` at their first; `unit` is a scaled stiffness of 1 in N/m.
    """

    grid: Scene  # The scene on the cells whose faces are agents; halved where a member is one wide
    levels: tuple[PushLevel, ...]  # The faces of the cells, then those of their parents, if any
    load: Floats  # Loads (N) that are left at the start, on faces and then supports
    given: Floats  # Displacement (m) of the faces that supports hold
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
        self.posed = grid_of(scene, stage)
        self.grid, self.problem, self.origin = self.posed[:3]
        scales = self.problem.scales
        self.unit = scales.force / scales.displacement
        states = self.problem.face_states
        self._numbering = Numbering(states)
        # The stiffness matrix (N/m) of all faces, those that move before those that are held.
        present = Numbering(tuple(np.where(s == ABSENT, ABSENT, ACTIVE) for s in states))
        zero = tuple(np.zeros_like(spring) for spring in self.problem.spring)
        matrix = stiffness_matrix(replace(self.problem, spring=zero), present)
        moves = present.gather(tuple((s == ACTIVE).astype(float) for s in states)) > 0.0
        order_of = np.concatenate([np.flatnonzero(moves), np.flatnonzero(~moves)])
        matrix = sp.csr_array(self.unit * matrix[order_of][:, order_of])
        self.levels = self._build_levels(matrix)
        n = self._numbering.size
        # The axis along which each support holds: held faces first, then bedded ones.
        bedded_axes = self.levels[0].place[0][self.bedded]
        self.support_axes = np.concatenate([face_indices(states, FIXED)[0], bedded_axes])
        force = scales.force * present.gather(self.problem.force)[order_of]
        self.given = scales.displacement * present.gather(self.problem.fixed)[order_of][n:]
        load = force - matrix[:, n:] @ self.given
        self.load = np.concatenate([load, np.zeros(len(self.bedded))])
        moduli = moduli_at(self.problem.moduli, self.problem.kinds[self.problem.kinds >= 0])
        inside = moduli.stretch + (self.problem.dimension - 1) * moduli.shear
        self.reference = self.unit * 2.0 * float(inside.max())
        self.threshold = self.rule.threshold or self._threshold_for(self.rule.tolerance)

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
        while self.order == "multilevel" and levels[-1].size > 12:  # a block of 2×2
            parents, prolong = coarsen(levels[-1].numbering)
            if not 0 < prolong.shape[1] < 0.8 * prolong.shape[0]:
                break
            prolong.sort_indices()
            levels[-1] = replace(levels[-1], prolong=prolong)
            own = sp.csr_array(levels[-1].restrict @ (own @ prolong))
            levels.append(make_level(parents, own))
        return tuple(levels)

    def _threshold_for(self, tolerance: float) -> float:
        """Return the γ at which the error estimate is at most `tolerance` at rest."""
        # Its denominator, load · displacement, is at least (f·v)²/(v·Kv) for any v.
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

    def positions(self, level: int) -> Floats:
        """Return where the faces of a level are (m), shape (faces, dimension)."""
        axis, index = self.levels[level].place
        centre: Floats = index.astype(np.float64) - 0.5
        centre[np.arange(len(axis)), axis] -= 0.5
        centre = centre * 2.0**level + np.asarray(self.origin)
        return centre * self.problem.scales.length


def inverse(stiffness: Floats) -> Floats:
    """Return 1/k, and 0 for a parent without children, whose k is 0."""
    return np.divide(1.0, stiffness, out=np.zeros_like(stiffness), where=stiffness > 0.0)


def make_level(
    numbering: Numbering, own: sp.csr_array, held: sp.csr_array | None = None
) -> PushLevel:
    """Turn a stiffness matrix, and its columns of supports, into shares."""
    stiffness = own.diagonal()
    others = own - sp.diags_array(stiffness)
    columns = others if held is None else sp.hstack([others, held], format="csr")
    shares = sp.csr_array(sp.diags_array(-inverse(stiffness)) @ columns)
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


def coarsen(fine: Numbering) -> tuple[Numbering, sp.csr_array]:
    """Return the parents' numbering and the interpolation from parents to children."""
    # Along its normal a face's displacement is interpolated linearly between the parents' faces
    # (1; ½, ½), across it between the parents' middles (¾, ¼). At a free surface, where the parent
    # beyond is missing, the line is prolonged (5/4, -1/4); at a rigid one it runs to zero (½). So a
    # rigid rotation of the parents is one of the children, without which a stiff body on a soft one
    # would not turn. Every axis looks only at the faces that are there: so holes, odd counts of
    # cells and ragged outlines need no special case.
    states, blocks = [], []
    for axis, state in enumerate(fine.states):
        matrix = sp.eye_array(int(np.count_nonzero(state == ACTIVE)), format="csr")
        for along in range(state.ndim):
            parents = _parents(state, along, normal=along == axis)
            step = _interpolation(state, parents, along, normal=along == axis)
            matrix = sp.csr_array(matrix @ step)
            state = parents
        states.append(state)
        blocks.append(matrix)
    return Numbering(tuple(states)), sp.csr_array(sp.block_diag(blocks, format="csr"))


def _parents(state: States, axis: int, *, normal: bool) -> States:
    """Coarsen the states of one component along one axis."""
    lines = np.moveaxis(state, axis, 0)
    if normal:
        # Every second face stays; one that is missing exists if a child beside it moves.
        cells = (len(lines) - 3 + 1) // 2
        ghosts = np.full((1, *lines.shape[1:]), ABSENT, dtype=np.int8)
        padded = np.concatenate([lines, ghosts])
        kept = padded[1 : 2 * cells + 2 : 2]
        before, after = padded[0 : 2 * cells + 1 : 2], padded[2 : 2 * cells + 3 : 2]
        revived = (kept == ABSENT) & ((before == ACTIVE) | (after == ACTIVE))
        parents = np.concatenate([ghosts, np.where(revived, np.int8(ACTIVE), kept), ghosts])
    else:
        # Two children have one parent, which moves if either of them does.
        padded = np.concatenate([lines[:1], lines, *[lines[-1:]] * (1 + len(lines) % 2)])
        parents = np.maximum(padded[0::2], padded[1::2])
    return np.ascontiguousarray(np.moveaxis(parents, 0, axis))


def _interpolation(fine: States, coarse: States, axis: int, *, normal: bool) -> sp.csr_array:
    """Return the weights of one axis, active children by active parents."""
    moves = coarse == ACTIVE
    number = spread(np.arange(np.count_nonzero(moves)), moves, -1)
    place = np.nonzero(fine == ACTIVE)
    child = place[axis].astype(np.int64) - 1
    parent = child // 2

    def look(offset: Ints | int) -> tuple[Ints, States]:
        at = [*place]
        at[axis] = np.clip(parent + offset + 1, 0, coarse.shape[axis] - 1)
        return number[tuple(at)], coarse[tuple(at)]

    odd, own = child % 2, look(0)[0]
    if normal:
        terms = [(own, np.where(odd, 0.5, 1.0)), (look(odd)[0], 0.5 * odd)]
    else:
        (near, near_state), (far, far_state) = look(2 * odd - 1), look(1 - 2 * odd)
        free = (near_state == ABSENT) & (far_state == ACTIVE)
        beside = near_state == ACTIVE
        chosen = [beside, near_state == FIXED, free]
        terms = [(own, np.select(chosen, [0.75, 0.5, 1.25], 1.0))]
        terms += [(near, 0.25 * beside), (far, -0.25 * free)]
    column, weight = (np.concatenate(part) for part in zip(*terms, strict=True))
    row = np.tile(np.arange(len(child)), len(terms))
    some = np.flatnonzero((column >= 0) & (weight != 0.0))
    size = (len(child), int(np.count_nonzero(moves)))
    return compact(row[some], column[some], weight[some], size)


@dataclass(frozen=True)
class WaveCertificate:
    """By which share waves on a scene calm down."""

    largest_eigenvalue: float  # λmax(D⁻¹K) of the scene's agents; its bound if they are too many
    bound: float  # What no body of these materials exceeds
    limit: float  # Waves calm down for every share below: 2/λmax
    share: float  # ω, the share that is used
    stable: bool  # Whether it lies below the limit
    verdict: str  # The same in words, with a remedy if waves would grow


def certify_waves(table: PushTable, share: float | None = None) -> WaveCertificate:
    """State by which share agents may yield at once; without a share ω, nine tenths of that."""
    problem = table.problem
    used = np.unique(problem.kinds[problem.kinds >= 0])
    ratio = problem.moduli.lateral[used] / problem.moduli.stretch[used]
    # What no body of these materials exceeds.
    bound = max(4.0, 2.0 * float((1.0 + (problem.dimension - 1) * ratio).max()))
    largest = min(bound, largest_eigenvalue(table))
    limit = 2.0 / largest
    chosen = 0.9 * limit if share is None else share
    stable = chosen < limit
    growth = abs(1.0 - chosen * largest)
    reason = f"the largest eigenvalue of D⁻¹K is {largest:.4f} (no such body exceeds {bound:.4g})"
    if stable:
        verdict = (
            f"waves calm down: {reason}, so any share below {limit:.4f} does; ω = {chosen:.4f}"
        )
    else:
        verdict = (
            f"waves would grow by a factor of up to {growth:.3f} each: {reason}; "
            f"set share (ω) below {limit:.4f}, or leave it out"
        )
    return WaveCertificate(largest, bound, limit, chosen, stable, verdict)


def largest_eigenvalue(table: PushTable) -> float:
    """Return λmax(D⁻¹K) of a scene's agents, by Lanczos iteration."""
    finest = table.levels[0]
    n = finest.size
    if n > 200_000:  # The bound does, as the iteration would take longer than a wave or two.
        return float("inf")
    root = np.sqrt(finest.stiffness)
    # D^(1/2) (D⁻¹K) D^(-1/2) is symmetric and has the same eigenvalues.
    own = sp.eye_array(n) - finest.shares[:, :n]
    matrix = sp.csr_array(sp.diags_array(root) @ own @ sp.diags_array(1.0 / root))
    if n <= 200:
        return float(np.linalg.eigvalsh(matrix.toarray())[-1])
    from scipy.sparse.linalg import eigsh

    # The sharpest pattern is the one sought: it makes a good start, and the same every time.
    start = np.where(finest.place[1].sum(axis=1) % 2, 1.0, -1.0) + 0.01 * np.cos(np.arange(n))
    return float(eigsh(matrix, k=1, which="LA", v0=start, tol=1e-8)[0][0])
