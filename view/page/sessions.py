"""Who can be watched, and what begins when a page asks for it."""

from __future__ import annotations

from collections.abc import Callable

from kaju.agents.rules import PrescribedRule
from kaju.errors import ParameterError
from kaju.model.elastic.settling.elastic_model import ElasticModel
from kaju.model.propagation.load_model import LoadModel
from kaju.model.scene import Scene

from .live import LiveRun, Session
from .live_faces import LiveFaces

Watched = Scene | LoadModel | ElasticModel


def sessions_of(of: Watched) -> Callable[[], Session]:
    """Return what begins a session with a model of its own, that of `of` begun anew.

    Raises
    ------
    ParameterError
        If it cannot be watched.
    """
    if isinstance(of, LoadModel):
        return lambda: LiveRun(of.scene, of.again)
    if isinstance(of, ElasticModel):
        return lambda: LiveFaces(lambda: of.again(of.scene))
    if not isinstance(of, Scene):
        raise ParameterError(
            f"of: scenes, LoadModel and ElasticModel can be watched, got {type(of).__name__}; "
            "kaju.export_page shows what others have done"
        )
    if isinstance(of.rule, PrescribedRule):
        return lambda: LiveRun(of)
    return lambda: LiveFaces(lambda: ElasticModel(of, allow_unstable=True))
