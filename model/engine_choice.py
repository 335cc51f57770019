"""Objects or arrays: how the models of agents choose their engine."""

from __future__ import annotations

from kaju.errors import ParameterError


def takes_objects(engine: str, agent: type, usual: type, small: bool) -> bool:
    """Tell whether agents are to be objects.

    Parameters
    ----------
    engine : {"auto", "agents", "arrays"}
        What was asked for.
    agent, usual : type
        Class of the agents, and the one that arrays know.
    small : bool
        Whether "auto" can afford objects.

    Raises
    ------
    ParameterError
        If there is no such engine, or arrays are to run agents of one's own.
    """
    own_class = agent is not usual
    if engine not in ("auto", "agents", "arrays"):
        raise ParameterError(f"engine: 'auto', 'agents' or 'arrays', got {engine!r}")
    if engine == "arrays" and own_class:
        raise ParameterError(
            f"engine: 'arrays' knows no {agent.__name__}; "
            "agents of your own are objects, so take 'auto' or 'agents'"
        )
    return engine == "agents" or (engine == "auto" and (small or own_class))
