"""The agents of the elastic rule: they take a load, yield, and pass all of it on.

Other than at a `MaterialAgent`, loads that meet are added up with their sign, and a load too small
to act on waits instead of ending, so that the agent can act again and again until none is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from kaju._mesa import Cell, FixedAgent
from kaju.arrays import Floats
from kaju.errors import brief

from .materials import Material
from .parameter import is_number


@dataclass(frozen=True, eq=False)
class Place:
    """Where a face agent stands."""

    level: int  # 0 for the cells' own faces, 1 for those of 2×2(×2) blocks, and so on
    number: int  # of the face on its level
    axis: int  # of the normal, along which the face moves
    index: tuple[int, ...]  # upper cell; of parents, upper block, counted from the body's box
    position: Floats  # middle of the face (m)
    materials: tuple[Material, ...]  # of the cells beside the face; empty for parents
    stiffness: float  # K (N/m): load that moves the face by 1 m while all others hold still
    links: tuple[tuple[int, float], ...]  # numbers of faces and supports, and the share of each


class FaceAgent(FixedAgent):
    """A face between two cells, or two blocks of cells, that a load has woken.

    Subclass it to make a rule of your own: `due` returns how much of its load the agent takes now,
    `take` moves the face, `pass_on` hands the load on. What is no number, or no neighbour, raises
    an `AgentError`.

    Examples
    --------
    >>> import kaju
    >>> class Lazy(kaju.FaceAgent):
    ...     def due(self, asked):
    ...         return 0.5 * super().due(asked)
    >>> rule = {"kind": "elastic", "order": "wave", "threshold": 0.1}
    >>> scene = kaju.load_scene("plate.toml").replace(rule=rule)
    >>> result = kaju.ElasticModel(scene, face_agent=Lazy).run().result
    >>> round(1e12 * result.max_displacement)  # pm
    6240
    """

    goes_into = "ElasticModel, face_agent={}"

    def __init__(self, model: Any, cell: Cell, place: Place, faces: Any) -> None:
        super().__init__(model)
        self.cell = cell
        self.place = place
        """Where the agent stands, and to whom it passes what."""
        self.faces = faces
        """The state of all faces of its level as arrays by number: left, displacement, taken."""
        self.spawn_step = model.generation + 1
        """Step in which the agent spawned, counted from 1."""

    level = property(lambda agent: agent.place.level)
    """0 for faces of cells, above for parents."""
    left = property(lambda agent: float(agent.faces.left[agent.place.number]))
    """Load that is left on the agent (N); positive along the axis."""
    displacement = property(lambda agent: float(agent.faces.displacement[agent.place.number]))
    """How far the face has moved (m), of a parent in its current visit; along the axis."""
    taken = property(lambda agent: float(agent.faces.taken[agent.place.number]))
    """Sum of the sizes of the loads that the agent has taken (N)."""

    def act(self, asked: float) -> None:
        """Take a load (N) and pass it on, when the order of work asks for it."""
        wrong, load = self.model.engine.guard.wrong, self.due(asked)
        if not is_number(load):
            raise wrong(self, "due", f"must return a load (N), got {brief(load)}")
        self.take(load)
        if self.pass_on(load) is not None:  # type: ignore[func-returns-value]
            raise wrong(self, "pass_on", "must return nothing: self.model.hand_over hands over")

    def due(self, asked: float) -> float:
        """Return the load to take (N) when the order asks for `asked`: ωP in a wave, or all."""
        return asked

    def take(self, load: float) -> None:
        """Yield to a load."""
        number = self.place.number
        self.faces.displacement[number] += load / self.place.stiffness
        self.faces.left[number] -= load
        self.faces.taken[number] += abs(load)

    def pass_on(self, load: float) -> None:
        """Hand the shares of a load to the neighbours, and to supports."""
        for target, share in self.place.links:
            self.model.hand_over(self, target, share * load)
