"""What travels, and what an agent passes on: the vocabulary that all rules share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple, TypeVar

from kaju.errors import AgentError

Kind = TypeVar("Kind", bound=type)
Sense = Literal["push", "pull"]
"""A push travels along its force, a pull against it."""


class Amounts(dict[Any, float]):
    """Loads or shares that are added up by a key; a key without an entry has 0."""

    def __missing__(self, key: object) -> float:
        if isinstance(key, str):  # a name such as "-y" has no loads, ever
            told = "loads stand under the number of a direction; it is"
            raise AgentError(f"{key!r}: {told} model.lattice.direction_names.index({key!r})")
        return 0.0


def no_number(called: str, cure: str) -> Callable[[Kind], Kind]:
    """Let a class of tuples refuse to be changed, and to be reckoned with as a number."""

    def change(row: object, name: str, value: object) -> None:
        told = f"cannot be changed; make another, {called}._replace({name}={value!r})"
        raise AgentError(f"{called}: {told}")

    def reckon(row: object, other: object) -> None:
        raise AgentError(f"{called}: is no number; {cure}")

    def refusing(kind: Kind) -> Kind:
        names = ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "lt", "le", "gt", "ge")
        for name in names:
            setattr(kind, f"__{name}__", reckon)
        kind.__setattr__ = change  # type: ignore[assignment, method-assign]
        return kind

    return refusing


@no_number("load", "take load.total (N), its magnitude times its copies")
class Load(NamedTuple):
    """A load that reaches an agent.

    Examples
    --------
    >>> import kaju
    >>> kaju.Load(direction=2, magnitude=0.5, copies=3.0).total
    1.5
    """

    direction: int
    """Where its force points: the index of a face normal of the lattice."""
    magnitude: float
    """Its size (N), always positive."""
    copies: float = 1.0
    """How many equal loads arrived together."""
    sense: Sense = "push"
    """Whether it travels along its force or against it. Only a rule with `sense` knows pulls."""

    @property
    def total(self) -> float:
        """Sum of the equal loads (N)."""
        return self.magnitude * self.copies

    def turned(self) -> Load:
        """Return the load with the same force and the other sense: it travels back."""
        return self._replace(sense="pull" if self.sense == "push" else "push")


@no_number("row", "make another, row._replace(share=0.5 * row.share)")
class Emission(NamedTuple):
    """One share on its way: over which arm it leaves, where its force points, in which sense.

    Examples
    --------
    >>> import kaju
    >>> model = kaju.LoadModel(kaju.load_scene("plate.toml"))
    >>> model.step()
    >>> next(iter(model.agents)).emissions(kaju.Load(direction=2, magnitude=1.0))[0]
    Emission(arm=2, direction=2, share=0.5, sense='push')
    """

    arm: int
    direction: int
    share: float
    sense: Sense = "push"


Split = tuple[list[tuple[int, tuple[int, float, Sense], float, float]], float]
"""Emissions of a load that go on: arm, (direction, magnitude, sense) as boxes have it, size (N) and
copies; and the sum of those that end here (N)."""


class Emissions(tuple[Emission, ...]):
    """Emissions that follow from an agent's shares: valid, and split once per load's magnitude."""

    def __init__(self, emissions: tuple[Emission, ...]) -> None:
        self.split: dict[float, Split] = {}


class Lateral(NamedTuple):
    """A neighbour beside a load: the arm to it and its weights in the two sideways shares."""

    arm: int
    friction: float
    poisson: float


class Neighbourhood(NamedTuple):
    """The neighbours of a cell, sorted by where a load goes that travels through it."""

    ahead: tuple[tuple[int, float], ...]  # arms of the forward share, and their parts of it
    behind: tuple[tuple[int, float], ...]  # the same for the backward share
    beside: tuple[Lateral, ...]


class Shares(NamedTuple):
    """What becomes of a load of 1 N that an agent takes.

    Examples
    --------
    >>> from kaju import Shares
    >>> shares = Shares(own=0.5, forward=0.5, backward=0.0, friction=0.25, poisson=0.075)
    >>> shares.forward + 2 * shares.friction  # in the plane: what goes on along the load
    1.0
    """

    own: float
    """Share that deforms the agent itself."""
    forward: float
    """Share handed to the neighbour ahead."""
    backward: float
    """Share handed to the neighbour behind."""
    friction: float
    """Share handed to each neighbour beside, along the load's own direction."""
    poisson: float
    """Share pressed into each neighbour beside, outwards, by the blocked expansion. Below 0, which
    only a rule that knows pulls allows, a push pulls these neighbours inwards."""
    widening: float = 0.0
    """How much the agent widens freely when it is shortened by 1: βν."""

    def emissions(
        self, direction: int, sense: Sense, way: Neighbourhood, opposite: Sequence[int]
    ) -> tuple[Emission, ...]:
        """Return what leaves the agent for each newton of a load whose force has a `direction`."""
        other: Sense = "pull" if sense == "push" else "push"
        shares = Amounts()  # over one arm, along one direction and in one sense they are one load
        for arm, weight in way.ahead:
            shares[arm, direction, sense] += self.forward * weight
        for arm, weight in way.behind:  # under a push this neighbour is pulled
            shares[arm, direction, other] += self.backward * weight
        outwards = sense if self.poisson >= 0.0 else other
        for arm, friction, poisson in way.beside:
            shares[arm, direction, sense] += self.friction * friction
            force = arm if outwards == "push" else opposite[arm]
            shares[arm, force, outwards] += abs(self.poisson) * poisson
        return tuple(
            Emission(arm, to, share, how) for (arm, to, how), share in shares.items() if share > 0.0
        )
