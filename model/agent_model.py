"""Whichever model of agents a scene's rule asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kaju.model.elastic.settling.elastic_model import ElasticModel
    from kaju.model.propagation.load_model import LoadModel
    from kaju.model.scene import Scene


def agent_model(scene: Scene, **options: Any) -> LoadModel | ElasticModel:
    """Return the Mesa model of a scene: `LoadModel` or `ElasticModel`, by the scene's rule.

    Parameters
    ----------
    scene : Scene
        Its ``rule.kind`` decides.
    **options
        Handed to the model, such as ``engine="arrays"``.
    """
    if scene.rule.kind == "elastic":
        from kaju.model.elastic.settling.elastic_model import ElasticModel

        return ElasticModel(scene, **options)
    from kaju.model.propagation.load_model import LoadModel

    return LoadModel(scene, **options)
