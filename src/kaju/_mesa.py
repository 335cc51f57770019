"""Mesa's names, without two things that come with them.

Mesa's batch runner sets multiprocessing's start method to "spawn" for the whole process when
it is imported. An import of kaju must not do that, so it is put back as it was.

Mesa's agents are numbered from a table that keeps every model for ever: many runs in one process
grow slower and larger with each. The agents here are numbered from one that does not.
"""

from __future__ import annotations

import multiprocessing
from inspect import Signature, signature
from itertools import count
from typing import Any
from weakref import WeakKeyDictionary

_before = multiprocessing.get_start_method(allow_none=True)

import mesa  # noqa: E402
from mesa import DataCollector as DataCollector  # noqa: E402
from mesa import Model as Model  # noqa: E402
from mesa.agent import AgentSet as AgentSet  # noqa: E402
from mesa.discrete_space import Cell as Cell  # noqa: E402
from mesa.discrete_space import DiscreteSpace as DiscreteSpace  # noqa: E402
from mesa.discrete_space import HexGrid as HexGrid  # noqa: E402
from mesa.discrete_space import Network as Network  # noqa: E402
from mesa.discrete_space import OrthogonalVonNeumannGrid as OrthogonalVonNeumannGrid  # noqa: E402

try:  # Mesa has recorders from 3.5 on
    from mesa.experimental import data_collection
except ImportError:
    data_collection: Any = None  # type: ignore[no-redef]

from kaju.errors import AgentError  # noqa: E402

multiprocessing.set_start_method(_before, force=True)


def track_figures(model: Any) -> None:
    """Enter a model's `figures` as a data set, which Mesa's recorders take, where it has any."""
    if data_collection is not None:
        model.data_registry.add_dataset(ModelDataSet("figures", model, ["steps"]))


class ModelDataSet(getattr(data_collection, "ModelDataSet", object)):  # type: ignore[misc]
    """A model's figures; recorders know what it is by the name of its class."""

    @property
    def data(self) -> Any:
        """The figures by now."""
        return self.model.figures()


_numbers: WeakKeyDictionary[Model, count[int]] = WeakKeyDictionary()


def number_agents_of(model: Model, first: int = 1) -> None:
    """Begin the numbers of a model's agents."""
    _numbers[model] = count(first)


class Agent(mesa.Agent):
    """Mesa's agent."""

    __init__: Any
    _ids: Any = _numbers


class MadeByModels(type(mesa.Agent)):  # type: ignore[misc]
    """The kind of classes whose agents only a model makes."""

    def __call__(cls, model: Any = None, *start: Any, **named: Any) -> Any:
        """Make an agent of a model; refuse to be called by anybody else."""
        if not (isinstance(model, Model) and (start or named)):
            raise AgentError(
                f"{cls.__name__}(): a model makes its agents, where loads arrive; give it the "
                f"class itself, without brackets: {cls.__name__}, as in "
                f"functools.partial(kaju.{cls.goes_into.format(cls.__name__)})"
            )
        return super().__call__(model, *start, **named)

    @property
    def __signature__(cls) -> Signature:
        """What `inspect` and help tell of the class: the arguments of its `__init__`."""
        begin = signature(cls.__init__)  # type: ignore[misc]
        return begin.replace(parameters=[*begin.parameters.values()][1:])


class FixedAgent(mesa.discrete_space.FixedAgent, metaclass=MadeByModels):
    """Mesa's agent of one cell."""

    goes_into = "LoadModel, material_agent={}"  # the class, which errors tell
    _ids: Any = _numbers
