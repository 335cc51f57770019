"""The rule of load transfer as tables, read by both engines and by the certificate."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from math import inf
from typing import NamedTuple

import numpy as np

from kaju.agents.materials import Material
from kaju.agents.parameter import is_number
from kaju.agents.rules import PrescribedRule, ShareRule
from kaju.agents.shares import Emission, Sense, Shares
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SceneError, brief, require, takes
from kaju.model.scene import Scene, scene_needed
from kaju.model.scene.cell_types import AIR, RIGID, ROLLER
from kaju.model.scene.lattice import Cells, Lattice
from kaju.model.scene.selection import BY_SIDE, BY_SURFACE, PULL, AppliedLoads

BOUNDARY_NAMES = {AIR: "free", RIGID: "rigid", ROLLER: "roller"}


class RuleTables(NamedTuple):
    """What loads send out, each (materials x forms, states, most emissions of any load)."""

    arm: Ints  # over which it leaves
    state: Ints  # in which it travels on
    share: Floats  # of the load; 0 where a load has fewer emissions than others


class Transfer:
    """The prescribed rule, or a rule of your own, on a scene's lattice.

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
        for side in scene.lattice.sides:
            kind = scene.side_condition(side).kind
            if kind not in BOUNDARY_NAMES.values():
                raise SceneError(
                    f"sides.{side}: a {kind} side needs the elastic rule; the prescribed rule "
                    "knows free, rigid and roller"
                )
        self.scene = scene
        self.lattice: Lattice = scene.lattice
        self.rule: ShareRule = rule
        self.materials = scene.cell_materials
        self.shares: tuple[Shares, ...] = tuple(map(self._shares_of, self.materials))
        self.cross_section = self.lattice.cell_volume(scene.thickness) / self.lattice.cell_size
        self._opposite: list[int] = self.lattice.opposite.tolist()
        self._applied: dict[int, AppliedLoads] = {}

    def _shares_of(self, material: Material) -> Shares:
        """Ask the rule for the shares of a material."""
        shares = self.rule.shares(material, self.lattice.dimension)
        told = f"rule: shares of {material.name!r} must be kaju.Shares, got {shares!r}"
        require(isinstance(shares, Shares), told)
        problem = check_shares(shares, self.rule.sense)
        require(not problem, f"rule: {material.name!r} {problem}")
        return shares

    def applied(self, stage: int) -> AppliedLoads:
        """Return the scene's forces at a stage, which many parts ask for, and which take long."""
        if stage not in self._applied:
            self._applied[stage] = self.scene.applied(stage)
        return self._applied[stage]

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
        return sent if self.rule.sense else tuple(Emission(*e[:3]) for e in sent)

    @cached_property
    def tables(self) -> RuleTables:
        """The emissions of every material, form and state."""
        directions, forms = self.lattice.directions, range(self.lattice.forms)
        senses: tuple[Sense, ...] = ("push", "pull") if self.rule.sense else ("push",)
        every = [
            self.emissions(shares, direction, sense, form)
            for shares in self.shares
            for form in forms
            for sense in senses
            for direction in range(directions)
        ]
        shape = (len(every), max(1, *map(len, every)))
        arm, state, share = np.zeros(shape, int), np.zeros(shape, int), np.zeros(shape)
        for row, sent in enumerate(every):
            for column, emission in enumerate(sent):
                arm[row, column], share[row, column] = emission.arm, emission.share
                state[row, column] = emission.direction + directions * (emission.sense == "pull")
        whole = (-1, self.states, shape[1])
        return RuleTables(arm.reshape(whole), state.reshape(whole), share.reshape(whole))

    @cached_property
    def emitted(self) -> Floats:
        """Sum of what a load sends out, by which loads grow: (materials x forms, states)."""
        return np.asarray(self.tables.share.sum(axis=2))

    @cached_property
    def own(self) -> Floats:
        """Share kept, per material."""
        return np.array([shares.own for shares in self.shares])

    @cached_property
    def turned(self) -> Ints:
        """The state in which a boundary gives a load back, by its type, arm and state.

        Kinds of boundaries are negative, so they index the first axis from its end.
        """
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
        turned = np.zeros((-min(BOUNDARY_NAMES), *free.shape), dtype=np.int64)
        turned[AIR], turned[RIGID], turned[ROLLER] = free, rigid, roller
        return turned

    def kept(self, material: Ints, taken: Floats) -> Floats:
        """Return the own shares along each axis (N), pushes less pulls, from loads by state."""
        lattice = self.lattice
        count = lattice.directions
        pushes = taken[:, :count] - taken[:, count:] if self.rule.sense else taken
        along = pushes[:, lattice.axes] + pushes[:, lattice.opposite[lattice.axes]]
        return along * self.own[material, None]

    def loads(self, stage: int) -> tuple[Cells, Ints, Floats]:
        """Return cells, states and magnitudes (N) of the loads that a stage puts on, or adds."""
        scene, applied = self.scene, self.applied(stage)
        if stage > 1 and scene.loading == "continue":
            applied = replace(applied, force=applied.force - self.applied(stage - 1).force)
        row, direction, magnitude = split_force(scene.lattice, applied.force)
        state = direction
        if self.rule.sense:
            state = direction + scene.lattice.directions * pulls(scene, applied, row, direction)
        return applied.cells[row], state, magnitude


def _check_rule(rule: ShareRule) -> None:
    told = f"rule: an object is needed, not its class, got {brief(rule)}"
    require(not isinstance(rule, type), told)
    for name in ("shares", "threshold", "accumulate", "sense"):
        told = "a rule has shares(material, dimension), threshold, accumulate and sense"
        require(hasattr(rule, name), f"rule: {type(rule).__name__} has no {name!r}; {told}")
    told = f"rule.shares: {type(rule).__name__}.shares must take (material, dimension)"
    require(takes(rule.shares, "material", 2), told)
    told = f"rule.threshold: must be a load above 0 N, got {rule.threshold}"
    require(0.0 < rule.threshold < inf, told)


def check_shares(shares: Shares, sense: bool) -> str:
    """Return what is wrong with shares; empty if nothing is."""
    for name in ("own", "forward", "backward", "friction", "poisson", "widening"):
        share = getattr(shares, name)
        least = -inf if name == "widening" or (name == "poisson" and sense) else 0.0
        if not (is_number(share) and share >= least):
            return f"has the share {name!r} = {share!r}, which must be a number from 0 upwards"
    return ""


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
