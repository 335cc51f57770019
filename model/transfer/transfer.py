"""The rule of load transfer as tables, read by both engines and by the certificate."""

from __future__ import annotations

from functools import cached_property
from math import inf, isfinite
from numbers import Real

import numpy as np

from kaju.agents.materials import Material
from kaju.agents.rules import PrescribedRule, ShareRule
from kaju.agents.shares import Emission, Sense, Shares
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import ParameterError, SceneError
from kaju.model.scene import Scene, scene_needed
from kaju.model.scene.cell_types import AIR, RIGID, ROLLER
from kaju.model.scene.lattice import Cells, Lattice
from kaju.model.scene.selection import BY_SIDE, BY_SURFACE, PULL, AppliedLoads

BOUNDARY_NAMES = {AIR: "free", RIGID: "rigid", ROLLER: "roller"}


class Transfer:
    """Who passes how much to whom: the prescribed rule, or another, on a scene's lattice.

    Loads are numbered by *state*: the direction of the force for pushes, and the same plus the
    number of directions for pulls, which only a rule with a sense has.
    """

    def __init__(self, scene: Scene, rule: ShareRule | None = None) -> None:
        scene_needed(scene)
        if rule is not None:
            _check_rule(rule)
        elif isinstance(scene.rule, PrescribedRule):
            rule = scene.rule
        else:
            raise SceneError(
                "rule.kind: LoadModel passes loads on by a prescribed rule, "
                f'got {scene.rule.kind!r}; set kind = "prescribed", or take ElasticModel'
            )
        self.lattice: Lattice = scene.lattice
        self.rule: ShareRule = rule
        self.materials = scene.cell_materials
        _refuse_elastic_sides(scene)
        self.shares: tuple[Shares, ...] = tuple(
            _answer(self.rule, material, self.lattice.dimension) for material in self.materials
        )
        self.cross_section = self.lattice.cell_volume(scene.thickness) / self.lattice.cell_size
        self._opposite: list[int] = self.lattice.opposite.tolist()

    @property
    def states(self) -> int:
        """Number of states of a load."""
        return self.lattice.directions * (2 if self.rule.sense else 1)

    def heading(self, direction: int, sense: Sense) -> int:
        """Return where a load travels: a push along its force, a pull against it."""
        return direction if sense == "push" else self._opposite[direction]

    def emissions(
        self, shares: Shares, direction: int, sense: Sense = "push", form: int = 0
    ) -> tuple[Emission, ...]:
        """Return what a load sends out of an agent with these shares."""
        way = self.lattice.way(self.heading(direction, sense), form)
        sent = shares.emissions(direction, sense, way, self._opposite)
        return sent if self.rule.sense else tuple(e._replace(sense="push") for e in sent)

    @cached_property
    def tables(self) -> tuple[Ints, Ints, Floats]:
        """Arm, state and share of every emission, each (materials, forms, states, most); else 0."""
        forms = self.lattice.forms
        cells = [(shares, form) for shares in self.shares for form in range(forms)]
        rows = [
            [self._sent(*cell, *divmod(state, self.lattice.directions)) for cell in cells]
            for state in range(self.states)
        ]
        most = max(1, *(len(row) for state in rows for row in state))
        full = np.array(
            [[[*row, *[(0, 0, 0.0)] * (most - len(row))] for row in state] for state in rows]
        )
        full = full.reshape(self.states, len(self.shares), forms, most, 3).transpose(1, 2, 0, 3, 4)
        arms, states = full[..., 0].astype(np.int64), full[..., 1].astype(np.int64)
        return arms, states, np.ascontiguousarray(full[..., 2])

    def _sent(
        self, shares: Shares, form: int, pull: int, direction: int
    ) -> list[tuple[int, int, float]]:
        """Return arm, state and share of what a load of a state sends out."""
        sent = self.emissions(shares, direction, "pull" if pull else "push", form)
        pulls = self.lattice.directions
        return [(arm, d + pulls * (s == "pull"), share) for arm, d, share, s in sent]

    @cached_property
    def emitted(self) -> Floats:
        """Sum of what a load sends out, by which loads grow: (materials, forms, states)."""
        return np.asarray(self.tables[2].sum(axis=3))

    @cached_property
    def own(self) -> Floats:
        """Share kept, per material."""
        return np.array([shares.own for shares in self.shares])

    @cached_property
    def turned(self) -> dict[int, Ints]:
        """For each kind of boundary: the state in which one that came over an arm returns."""
        lattice = self.lattice
        every = np.arange(lattice.directions)
        free = np.tile(np.arange(self.states), (len(every), 1))
        rigid = np.tile(lattice.opposite, (len(every), 1))
        roller = lattice.mirrored
        if self.rule.sense:
            # What arrives along the normal, a push or a pull, goes back as the other.
            free[every, every] += len(every)
            free[every, lattice.opposite + len(every)] -= len(every)
            rigid, roller = (np.hstack([back, back + len(every)]) for back in (rigid, roller))
        return {AIR: free, RIGID: rigid, ROLLER: roller}

    def kept(self, material: Ints, taken: Floats) -> Floats:
        """Return the own shares along each axis (N), pushes less pulls, from loads by state."""
        lattice = self.lattice
        count = lattice.directions
        pushes = taken[:, :count] - taken[:, count:] if self.rule.sense else taken
        along = pushes[:, lattice.axes] + pushes[:, lattice.opposite[lattice.axes]]
        return along * self.own[material, None]


def _check_rule(rule: ShareRule) -> None:
    for name in ("shares", "threshold", "accumulate", "sense"):
        if not hasattr(rule, name):
            raise ParameterError(
                f"rule: {type(rule).__name__} has no {name!r}; a rule has shares(material, "
                "dimension), threshold, accumulate and sense"
            )
    if not (isfinite(rule.threshold) and rule.threshold > 0.0):
        raise ParameterError(f"rule.threshold: must be a load above 0 N, got {rule.threshold}")


def _answer(rule: ShareRule, material: Material, dimension: int) -> Shares:
    """Ask a rule for the shares of a material; refuse what is no answer."""
    shares = rule.shares(material, dimension)
    if not isinstance(shares, Shares):
        raise ParameterError(
            f"rule: shares of {material.name!r} must be kaju.Shares, got {shares!r}"
        )
    problem = check_shares(shares, rule.sense)
    if problem:
        raise ParameterError(f"rule: {material.name!r} {problem}")
    return shares


def check_shares(shares: Shares, sense: bool) -> str:
    """Say what is wrong with shares; nothing if all is well."""
    for name in ("own", "forward", "backward", "friction", "poisson", "widening"):
        share = getattr(shares, name)
        least = -inf if name == "widening" or (name == "poisson" and sense) else 0.0
        if not (isinstance(share, Real) and isfinite(share) and float(share) >= least):
            return f"has the share {name!r} = {share!r}, which must be a number from 0 upwards"
    return ""


def states_of(scene: Scene, stage: int, sense: bool) -> tuple[Cells, Ints, Floats]:
    """Return the loads applied at a stage: cells, states and magnitudes (N)."""
    applied = scene.applied(stage)
    row, direction, magnitude = split_force(scene.lattice, applied.force)
    state = direction
    if sense:
        state = direction + scene.lattice.directions * pulls(scene, applied, row, direction)
    return applied.cells[row], state, magnitude


def pulls(scene: Scene, applied: AppliedLoads, row: Ints, direction: Ints) -> Flags:
    """Tell which parts of the applied forces pull: rows of `applied`, split along directions.

    A part pulls where the scene says so, or where it points out of the body over its own
    side; where the scene names no side, over the free face of a cell that has body behind it.
    """
    assert applied.sense is not None
    lattice, cells = scene.lattice, applied.cells[row]
    said, side = applied.sense[row], applied.direction[row]
    outwards = (lattice.normals[direction] * lattice.normals[side]).sum(axis=1) > 1e-9
    pull: Flags = np.where(said == BY_SIDE, outwards & (side >= 0), said == PULL)
    for each in np.unique(direction[said == BY_SURFACE]).tolist():
        asked = np.flatnonzero((said == BY_SURFACE) & (direction == each))
        beyond = scene.kinds(lattice.neighbours(cells[asked], each))
        behind = scene.kinds(lattice.neighbours(cells[asked], int(lattice.opposite[each])))
        pull[asked] = (beyond == AIR) & (behind >= 0)
    return pull


def split_force(lattice: Lattice, force: Floats) -> tuple[Ints, Ints, Floats]:
    """Return row, direction and size (N, above 0) of the loads of forces; see `Lattice.split`."""
    magnitude = lattice.split(force)
    row, direction = np.nonzero(magnitude)
    return row, direction, magnitude[row, direction]


def _refuse_elastic_sides(scene: Scene) -> None:
    for side in scene.lattice.sides:
        kind = scene.side_condition(side).kind
        if kind not in ("free", "rigid", "roller"):
            raise SceneError(
                f"sides.{side}: a {kind} side needs the elastic rule; the prescribed rule knows "
                "free, rigid and roller"
            )
