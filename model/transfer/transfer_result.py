"""The result of load transfer by a prescribed rule."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kaju import __version__
from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats, Ints
from kaju.errors import ResultError
from kaju.model.results.cuts import Carrying
from kaju.model.results.result import BOOKS, BodyResult, Check, Named, idle_rheology, in_columns
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, INSIDE, RIGID, ROLLER
from kaju.model.stepper import counted, not_balanced

from .deformation import AxialStrain, DisplacementField, axial_strain
from .stability import Certificate
from .stage import Stage, StateCourse
from .transfer import BOUNDARY_NAMES, pulls, split_force

if TYPE_CHECKING:
    import pandas


NO_EQUILIBRIUM = (
    "the prescribed rule keeps no equilibrium: it shows how a pattern emerges; the body's "
    "own displacements and stresses come from `kaju solve`, or with rule.kind = elastic"
)


@dataclass(frozen=True, eq=False, repr=False)
class TransferResult(BodyResult):
    """What the agents of a load-transfer run have taken, kept and passed on.

    Strain, stress, displacement and agents are those of the last stage of loading; `at_stage` gives
    those of an earlier one.

    Examples
    --------
    >>> import kaju
    >>> result = kaju.LoadModel(kaju.load_scene("plate.toml")).run()
    >>> len(result.to_dataframe()), round(result.last.ledger.taken, 3)
    (34, 12.879)
    """

    kind: ClassVar[str] = "load transfer"
    name: ClassVar[str] = "prescribed rule"
    scene: Scene
    """The scene that was computed."""
    stages: tuple[Stage, ...]
    """The agents of every stage of loading."""
    certificate: Certificate
    """What was known about the stability before the run."""
    seconds: float
    """Time that the run took (s)."""
    parameters: Mapping[str, bool | int | float] = field(default_factory=dict)
    """Values of the parameters that agents of your own declare, by name."""
    own_agents: tuple[str, ...] = ()
    """Names of the classes of agents of your own."""
    own_boundaries: Mapping[str, str] = field(default_factory=dict)
    """Names of those of boundaries, by "free", "rigid" or "roller"."""
    seed: int | None = None
    """The model's seed, if the run drew random numbers: with ``rng=seed`` it goes alike again."""

    def __post_init__(self) -> None:
        if not 1 <= len(self.stages) <= self.scene.stages:
            raise ResultError(f"it has {len(self.stages)} stages, the scene {self.scene.stages}")
        for stage in self.stages:
            rows = stage.history.generation
            if len(rows) and rows.max() > stage.generations:
                raise ResultError("loads were taken after its last generation")
            # Nobody waits for more in which hardly a load is taken; pictures go through all.
            if stage.generations > max(10_000, len(rows)):
                told = f"its {stage.generations} generations are more than 10000, and only"
                raise ResultError(f"{told} {len(rows)} loads were taken in them")
            if len(np.unique(self.scene.lattice.key(stage.cells))) < len(stage.cells):
                raise ResultError("two agents are in one cell")
            if any(course.agents != len(stage.cells) for course in stage.states):
                raise ResultError("its states are of more or fewer agents")
            if not np.array_equal(self.scene.kinds(stage.cells), stage.material):
                raise ResultError("its agents are of other materials than the scene's cells")

    @property
    def pictures(self) -> tuple[str, ...]:
        """Names of the pictures of it, the usual one first."""
        lattice = self.scene.lattice
        left_out = {"stages"} if len(self.stages) == 1 else set()
        if not (lattice.boxes or lattice.kind == "hexagon"):
            left_out.add("cuts")  # its cells lie in layers across no axis
        return (*(name for name in super().pictures if name not in left_out), *self.states)

    @property
    def films(self) -> tuple[str, ...]:
        """Names of the animations of it, the usual one first."""
        return (*super().films, *self.states)

    @cached_property
    def states(self) -> dict[str, StateCourse]:
        """The states (`kaju.State`) of the agents of the last stage, by name."""
        states = {course.name: course for course in self.last.states}
        return Named("states", states, "none: declare it as a kaju.State")

    @property
    def focus(self) -> Ints:
        """The cells that pictures are about: those of agents, or where forces are."""
        stage = self.last
        if len(stage.cells):
            return np.concatenate([stage.cells, stage.boundary_cells])
        return self.scene.applied().cells

    @property
    def stage(self) -> int:
        """The stage of loading at which it stands, counted from 1."""
        return len(self.stages)

    @property
    def last(self) -> Stage:
        """The last stage of loading."""
        return self.stages[-1]

    @property
    def reactions(self) -> dict[str, Floats]:
        """Forces (N) by which supports answered the loads that reached them, each (dimension,).

        By the name of the side, or "rigid" for rigid cells inside. Their sum is not the applied
        load, because some loads end on their way, and some come more than once.
        """
        stage, lattice = self.last, self.scene.lattice
        beyond = lattice.side_beyond(stage.boundary_cells)
        force = -stage.arrived @ lattice.normals
        across = np.eye(lattice.dimension)[beyond // 2]
        force = np.where((stage.boundary_kind == ROLLER)[:, None], force * across, force)
        named = (*lattice.sides, INSIDE)
        held = stage.boundary_kind != AIR
        sides = np.unique(beyond[held]).tolist()
        found = {named[side]: force[held & (beyond == side)].sum(axis=0) for side in sides}
        return Named("reactions", found, "none: no load reached a support")

    @property
    def outcome(self) -> str:
        """How the last stage ended, in words."""
        return self.last.outcome

    def at_stage(self, stage: int) -> TransferResult:
        """Return the result as it was after a stage, counted from 1."""
        if not 1 <= stage <= len(self.stages):
            told = f"stage: this result has the stages 1 to {len(self.stages)}"
            raise ResultError(f"{told}, got {stage}")
        return replace(self, stages=self.stages[:stage])

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the figures should know, in words."""
        largest = float(np.linalg.norm(self.displacement, axis=1).max(initial=0.0))
        return (*(full for _, full in self._caveats), *self.scene.notes_on(largest))

    @property
    def caveats_in_brief(self) -> tuple[str, ...]:
        """The `notes` in a few words each, as pictures tell them."""
        return tuple(brief for brief, _ in self._caveats)

    @cached_property
    def _caveats(self) -> list[tuple[str, str]]:
        """What is approximate, in a few words and in full."""
        found = [("forces do not balance", NO_EQUILIBRIUM)]
        if off := [stage for stage in self.stages if not stage.ledger.imbalance <= BOOKS]:
            worst = max(off, key=lambda stage: stage.ledger.imbalance)
            said = not_balanced(counted(worst.generations, "generation"), worst.ledger.imbalance)
            if len(self.stages) > 1:
                said = f"in {len(off)} of {len(self.stages)} steps, of which the worst {said}"
            found.append(("loads are not accounted for", said))
        walls = {BOUNDARY_NAMES[kind] for kind in np.unique(self.last.boundary_kind).tolist()}
        for name in self.own_boundaries.keys() - walls:
            told, own = f"no load reached a {name} boundary", self.own_boundaries[name]
            cure = "a lower threshold lets loads go on"
            found.append((told, f"{told}: no {own} acted; {cure}"))
        found += [("materials do not creep here", note) for note in idle_rheology(self.scene)]
        rule = self.scene.rule
        if isinstance(rule, PrescribedRule) and not rule.sense:
            applied = self.scene.applied(len(self.stages))
            row, direction, _ = split_force(self.scene.lattice, applied.force)
            if pulls(self.scene, applied, row, direction).any():
                full = "a load pulls, but without a sense every load squeezes: set rule.sense ="
                found.append(("pulls squeeze, too", f"{full} true to let pulls stretch"))
        return found

    @cached_property
    def _axial(self) -> AxialStrain:
        return axial_strain(self.scene, self.last)

    @cached_property
    def strain(self) -> Floats:
        """Strain of every agent, shape (agents, dim, dim)."""
        return self._axial.strains()

    @cached_property
    def stress(self) -> Floats:
        """Stress of every agent (Pa), shape (agents, dim, dim)."""
        return self._axial.stresses()

    @cached_property
    def von_mises(self) -> Floats:
        """Von Mises stress of every agent (Pa); in the plane, of plane stress."""
        missing = 3 - self.scene.lattice.dimension
        stress = np.pad(self.stress, ((0, 0), (0, missing), (0, missing)))
        mean = np.trace(stress, axis1=1, axis2=2) / 3.0
        deviator = stress - mean[:, None, None] * np.eye(3)
        return np.asarray(np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator)))

    @cached_property
    def displacement_field(self) -> DisplacementField:
        """Displacement as a function of the place."""
        return DisplacementField(self.scene, self.last, self._axial)

    @cached_property
    def displacement(self) -> Floats:
        """Displacement of the middle of every agent's cell (m), shape (agents, dim)."""
        cells = self.last.cells
        return self.displacement_field.at(self.scene.lattice.centres(cells), cells)

    @property
    def max_displacement(self) -> float:
        """Largest displacement (m) of an agent's cell, at its corners as within."""
        return self.displacement_field.largest()

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m) of the body, both of shape (n, dimension)."""
        return self.displacement_field.at(*self.located(points))

    def stress_at(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) at points (m) of the body, shape (n, dimension, dimension).

        Stress is the same all over a cell, and 0 in cells that no load reached.
        """
        return self.at_cells(self.located(points)[1], self.stress)

    def at_cells(self, cells: Ints, values: Floats) -> Floats:
        """Return values of the agents, shape (agents, ...), at cells; 0 where none is awake."""
        key, agents = self.scene.lattice.key(cells), self.scene.lattice.key(self.last.cells)
        found = np.zeros((len(key), *values.shape[1:]))
        awake = np.isin(key, agents)
        order = np.argsort(agents)
        found[awake] = values[order[np.searchsorted(agents, key[awake], sorter=order)]]
        return found

    def _carrying(self, axis: int) -> Carrying:
        lattice, count = self.scene.lattice, len(self.last.cells)
        middle = lattice.centres(self.last.cells)
        height = np.full(count, float(lattice.pitch[axis, axis]))
        volume = np.full(count, lattice.cell_volume(self.scene.thickness))
        return Carrying(middle, height, volume, self.stress)

    def checks(self) -> list[Check]:
        """Return whether every newton is accounted for at every stage."""
        off = max(stage.ledger.imbalance for stage in self.stages)
        return [Check("every newton is accounted for", off, BOOKS)]

    def summary(self) -> dict[str, Any]:
        """Return the key figures of the last stage."""
        stage = self.last
        return {
            "rule": "prescribed",
            **({"own_agents": ", ".join(self.own_agents)} if self.own_agents else {}),
            **({"parameters": dict(self.parameters)} if self.parameters else {}),
            **({} if self.seed is None else {"seed": self.seed}),
            "outcome": self.outcome,
            "generations": stage.generations,
            "material_agents": len(stage.cells),
            "boundary_agents": len(stage.boundary_cells),
            "free_boundary_agents": int((stage.boundary_kind == AIR).sum()),
            "rigid_boundary_agents": int((stage.boundary_kind == RIGID).sum()),
            "load_taken": stage.ledger.taken,
            "load_returned": stage.ledger.returned,
            "load_absorbed": stage.ledger.absorbed,
            "load_dropped": stage.ledger.dropped,
            "load_waiting": stage.ledger.pending,
            "reaction": {name: force.tolist() for name, force in self.reactions.items()},
            "max_displacement": self.max_displacement,
            "spectral_radius": self.certificate.spectral_radius,
            "seconds": self.seconds,
            "kaju_version": __version__,
            "notes": list(self.notes),
        }

    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row per material agent, as it is at the end of the run.

        `dropped (N)` is what the agent sent out too small; the ledger counts also what ended as
        boundaries gave it back, where loads were added up, or as it was applied.
        """
        import pandas

        stage, lattice = self.last, self.scene.lattice
        materials = np.array([material.name for material in self.scene.cell_materials])
        columns: dict[str, Any] = in_columns("cell_{}", stage.cells)
        columns |= {"material": materials[stage.material], "spawn_step": stage.spawn_step}
        for direction, name in enumerate(lattice.direction_names):
            columns[f"taken_{name} (N)"] = stage.taken[:, direction]
        columns["dropped (N)"] = stage.dropped
        columns |= {name: state.values() for name, state in self.states.items()}
        columns |= in_columns("displacement_{} (m)", self.displacement)
        columns |= in_columns("strain_{}", self.strain) | in_columns("stress_{} (Pa)", self.stress)
        return pandas.DataFrame(columns)
