"""The answer of agents of many sizes: who spawned where, when and why, and what they carry."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from kaju.model.elasticity import fields
from kaju.model.elasticity.problem import Scales
from kaju.model.elasticity.solid_result import SolidResult
from kaju.model.result import cells_of_points
from kaju.model.scene import Scene

from . import sampling
from .agent_fields import AgentFields
from .composite import Floats
from .displacement_error import displacement_error
from .family import Family, levels
from .first import direct_limit
from .functionals import functional_of, plain, unit_of
from .generations import Generation, Spawning
from .goals import Asked, Goal, asked_again, told
from .ground import Ground
from .leaves import Index, Leaves
from .nested import NestedMultigrid
from .places import located
from .quantities import DISPLACEMENT, Place, Quantity, quantities_of

if TYPE_CHECKING:
    from kaju.model.elasticity.export import Mesh


@dataclass(frozen=True, eq=False, repr=False)
class SpawnedResult(SolidResult):
    """Linear elasticity of a scene by agents that are small only where they have to be.

    Arrays over agents are in the order of `agents`: a space-filling curve through the body.

    Attributes
    ----------
    scene : Scene
        What was asked.
    stage : int or None
        Stage of loading; None is the last.
    tolerance : float
        Relative error that was asked for: in the energy norm, unless `tolerance_at` says else.
    resolution : int or None
        Smallest agents allowed, per cell of the scene; None is no limit.
    spawning : Spawning
        Agents and displacements in scaled units, and the history.
    seconds : float
    tolerance_at : str or tuple of Deflection, Stress and Reaction, or None
        What the tolerance is about, if not the energy norm.
    """

    kind: ClassVar[str] = "spawned"

    scene: Scene
    stage: int | None
    tolerance: float
    resolution: int | None
    spawning: Spawning
    seconds: float
    tolerance_at: Asked = None

    @property
    def grid(self) -> Scene:
        """The scene on the cells that describe the body to the agents."""
        return self._ground.scene

    @property
    def _ground(self) -> Ground:
        return self.spawning.balance.grid.ground

    @property
    def _leaves(self) -> Leaves:
        return self.spawning.balance.grid.leaves

    @property
    def _scales(self) -> Scales:
        return self._ground.scales

    @property
    def _energy(self) -> float:
        return self.spawning.energy

    @cached_property
    def _fields(self) -> AgentFields:
        return AgentFields(self.spawning.balance, self.spawning.displacement)

    @property
    def agents(self) -> int:
        """Number of agents."""
        return len(self._leaves)

    @property
    def lower(self) -> Floats:
        """Lower corners (m) of the agents, shape (agents, dimension)."""
        return np.asarray(self._leaves.lower * self._metre)

    @property
    def size(self) -> Floats:
        """Edges (m) of the agents, shape (agents,)."""
        return np.asarray(self._leaves.size * self._metre)

    @property
    def middle(self) -> Floats:
        """Middles (m) of the agents, shape (agents, dimension)."""
        return self.lower + 0.5 * self.size[:, None]

    @property
    def _metre(self) -> float:
        return self.grid.lattice.cell_size / self._ground.cell

    @property
    def level(self) -> Index:
        """How often the largest of the first agents would be halved to give each agent."""
        return levels(self._leaves.size, self.spawning.generations[0].size.max())

    @property
    def spawn_step(self) -> Index:
        """Step in which each agent spawned; 0 for the first, and those of a previous answer."""
        return self._leaves.step

    @property
    def cause(self) -> Floats:
        """Load (N) its parent left unbalanced, for which each agent spawned.

        0 for the first agents, NaN for those that keep neighbours alike in size.
        """
        return self._leaves.cause

    @property
    def unbalanced_load(self) -> Floats:
        """Load (N) each agent leaves unbalanced, as its children would feel it."""
        return np.asarray(self.spawning.indicator.load * self._scales.force)

    @property
    def error_share(self) -> Floats:
        """Share of each agent in the (squared) error that the tolerance is about; the sum is 1."""
        part = self.spawning.aimed.part
        return np.asarray(part / (part.sum() or 1.0))

    @property
    def material(self) -> Index:
        """Index into `scene.cell_materials` of each agent."""
        return self._leaves.kind

    @cached_property
    def agent_displacement(self) -> Floats:
        """Displacement (m) of the agents' middles, shape (agents, dimension)."""
        return self._scales.displacement * self._fields.displacement

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors (Pa) of the agents, shape (agents, dimension, dimension)."""
        return self._stress_unit * self._fields.stress

    @cached_property
    def strain(self) -> Floats:
        """Strain tensors of the agents, shape (agents, dimension, dimension)."""
        scaled = self.stress / self._scales.modulus
        return fields.strain_of(scaled, self._ground.moduli, self._leaves.kind)

    @cached_property
    def principal_stress(self) -> Floats:
        """Principal stresses (Pa) of the agents in the plane (space), smallest first."""
        return np.asarray(np.linalg.eigvalsh(self.stress))

    @cached_property
    def von_mises(self) -> Floats:
        """Equivalent stress (Pa) of the agents."""
        across: Floats | float = 0.0
        if self.scene.plane == "strain":
            moduli, kind = self._ground.moduli, self._leaves.kind
            lateral, shear = moduli.lateral[kind], moduli.shear[kind]
            trace = np.trace(self.stress, axis1=1, axis2=2)
            across = lateral / (2 * (lateral + shear)) * trace
        return fields.von_mises(self.stress, across)

    @property
    def error_estimate(self) -> float:
        """Estimated error in the energy norm, relative to the solution.

        Its square estimates the relative error of the strain energy.
        """
        return self.spawning.error

    @cached_property
    def displacement_error_estimate(self) -> float:
        """Estimated largest displacement error anywhere, relative to the largest displacement.

        Worked out when it is asked for, by one more solution with the same agents.
        """
        if self.tolerance_at == DISPLACEMENT:
            return self.goal_error_estimate
        spawning = self.spawning
        hierarchy = spawning.hierarchy
        if hierarchy is None:
            hierarchy = NestedMultigrid(spawning.balance, direct_limit(self._ground))
        state = (spawning.balance, spawning.displacement, spawning.indicator)
        return displacement_error(*state, hierarchy).largest

    @property
    def goal_error_estimate(self) -> float:
        """Estimated error that the tolerance is about, relative: see `tolerance_at`."""
        return self.spawning.aimed.error

    @property
    def goals(self) -> tuple[Goal, ...]:
        """What has been found of every quantity that the tolerance is about."""
        if not isinstance(self.tolerance_at, tuple):
            return ()
        found = []
        for quantity, answer in zip(self.tolerance_at, self.spawning.aimed.answers, strict=True):
            unit = unit_of(quantity, self._scales)
            value = plain(unit * answer.value)
            found.append(Goal(quantity, value, unit * answer.error, answer.relative_error))
        return tuple(found)

    @property
    def goal_values(self) -> tuple[float | Floats, ...]:
        """The quantities that the tolerance is about, in m, Pa or N."""
        return tuple(goal.value for goal in self.goals)

    @property
    def generations(self) -> tuple[Generation, ...]:
        """Every step of spawning: its agents, estimated error, strain energy (J), load left (N)."""
        force = self._scales.force
        unit = force * self._scales.displacement
        return tuple(
            g._replace(energy=g.energy * unit, load=g.load * force)
            for g in self.spawning.generations
        )

    @cached_property
    def family(self) -> Family:
        """Every agent that ever stood: who spawned whom, when and why."""
        return Family.of(self.generations, self._leaves.dimension, self._metre)

    @property
    def residuals(self) -> tuple[float, ...]:
        """Relative residual before every iteration of the last generation."""
        return tuple(self.spawning.residuals)

    @cached_property
    def reactions(self) -> dict[str, Floats]:
        """Force (N) of each support on the body; "rigid" are rigid cells inside the array."""
        found = self.spawning.balance.reactions(self.spawning.displacement)
        return {name: force * self._scales.force for name, force in found.items()}

    @property
    def max_displacement(self) -> float:
        """Largest displacement of an agent's middle (m)."""
        return float(np.linalg.norm(self.agent_displacement, axis=1).max())

    def _figures(self) -> dict[str, Any]:
        size = self._leaves.size
        return {
            "tolerance": self.tolerance,
            "tolerance_at": told(self.tolerance_at),
            "goal_error_estimate": self.goal_error_estimate,
            "goals": [
                {
                    "value": np.asarray(goal.value).tolist(),
                    "error_estimate": goal.error_estimate,
                    "relative_error": goal.relative_error,
                }
                for goal in self.goals
            ],
            "agents": self.agents,
            "levels": len(np.unique(size)),
            "method": "spawning",
            "generations": len(self.spawning.generations),
            "retired": self.spawning.retired,
            "smallest_agent": float(size.min() * self._metre),
            "largest_agent": float(size.max() * self._metre),
            "notes": list(self.spawning.notes),
        }

    def displacement_at(self, points: NDArray[np.float64]) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""
        place, leaf = self._locate(points)
        return self._scales.displacement * sampling.displacement_at(self._fields, place, leaf)

    def stress_at(self, points: NDArray[np.float64]) -> Floats:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension)."""
        place, leaf = self._locate(points)
        return self._stress_unit * sampling.stress_at(self._fields, place, leaf)

    def value_of(self, quantity: Quantity | Place) -> float | Floats:
        """Return a quantity in m, Pa or N: of a place the displacement.

        Raises
        ------
        ParameterError
            If it is of another dimension, outside of the body, or unknown.
        """
        (asked,) = quantities_of(quantity)
        value = functional_of(asked, self._ground).of(self._fields).value
        return plain(unit_of(asked, self._scales) * value)

    def _locate(self, points: NDArray[np.float64]) -> tuple[Floats, Index]:
        """Return points in units, and the agent that each lies in or on."""
        place, unit = located(self._ground, *cells_of_points(self.grid, points))
        return place, self._leaves.find(unit)

    def _columns(self) -> dict[str, NDArray[Any]]:
        from .export import columns

        return columns(self)

    def _mesh(self) -> Mesh:
        from .export import mesh

        return mesh(self)

    def _archive(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        from .storage import taken_apart

        return taken_apart(self)

    @classmethod
    def _from_archive(
        cls, scene: Scene, arrays: dict[str, NDArray[Any]], about: dict[str, Any]
    ) -> SpawnedResult:
        from .storage import spawning_of

        return cls(
            scene,
            about["stage"],
            about["tolerance"],
            about["resolution"],
            spawning_of(scene, arrays, about),
            about["seconds"],
            asked_again(about["tolerance_at"]),
        )
