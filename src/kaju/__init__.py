"""kaju (荷重, load): agents that carry load through a body.

Describe a body and press on it (`Scene`, `load_scene`), let agents pass the load on
(`LoadModel`), and look at what they did (`plot`, `animate`).
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from kaju.agents.material_agent import MaterialAgent as MaterialAgent
    from kaju.agents.materials import Material as Material
    from kaju.agents.materials import material as material
    from kaju.agents.rules import Coefficients as Coefficients
    from kaju.agents.rules import PrescribedRule as PrescribedRule
    from kaju.errors import KajuError as KajuError
    from kaju.model.propagation.load_model import LoadModel as LoadModel
    from kaju.model.propagation.stability import stability as stability
    from kaju.model.propagation.transfer_result import TransferResult as TransferResult
    from kaju.model.result import Result as Result
    from kaju.model.scene import Scene as Scene
    from kaju.model.scene import load_scene as load_scene
    from kaju.view import animate as animate
    from kaju.view import plot as plot

# Names are fetched when first asked for, so that `import kaju` stays quick: Mesa brings
# pandas with it, the views bring matplotlib.
_HOME = {
    "Coefficients": "kaju.agents.rules",
    "KajuError": "kaju.errors",
    "LoadModel": "kaju.model.propagation.load_model",
    "Material": "kaju.agents.materials",
    "MaterialAgent": "kaju.agents.material_agent",
    "PrescribedRule": "kaju.agents.rules",
    "Result": "kaju.model.result",
    "Scene": "kaju.model.scene",
    "TransferResult": "kaju.model.propagation.transfer_result",
    "animate": "kaju.view",
    "load_scene": "kaju.model.scene",
    "material": "kaju.agents.materials",
    "plot": "kaju.view",
    "stability": "kaju.model.propagation.stability",
}

__all__ = sorted([*_HOME, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'kaju' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
