"""kaju (荷重, load): agents that carry load through a body.

Describe a body and press on it (`Scene`, `load_scene`), let agents pass the load on
(`LoadModel`), and look at what they did (`plot`, `animate`). Public names are listed below, each
with the module that has it. The ground of all rooms is here: read `errors`, `arrays`, `files`, then
`result_kinds` (the one list of kinds of results) and `stepping` (what steps).
"""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

# Editors and type checkers read this list as it stands. Names are fetched when first asked for, so
# that `import kaju` is quick: Mesa brings pandas with it, the views bring matplotlib.
if TYPE_CHECKING:
    from kaju.agents.boundary_agent import BoundaryAgent as BoundaryAgent
    from kaju.agents.boundary_agent import FreeBoundaryAgent as FreeBoundaryAgent
    from kaju.agents.boundary_agent import RigidBoundaryAgent as RigidBoundaryAgent
    from kaju.agents.boundary_agent import RollerBoundaryAgent as RollerBoundaryAgent
    from kaju.agents.elastic_rule import ElasticRule as ElasticRule
    from kaju.agents.face_agent import FaceAgent as FaceAgent
    from kaju.agents.material_agent import MaterialAgent as MaterialAgent
    from kaju.agents.materials import Material as Material
    from kaju.agents.materials import material as material
    from kaju.agents.parameter import Parameter as Parameter
    from kaju.agents.parameter import State as State
    from kaju.agents.rules import Coefficients as Coefficients
    from kaju.agents.rules import PrescribedRule as PrescribedRule
    from kaju.agents.shares import Emission as Emission
    from kaju.agents.shares import Load as Load
    from kaju.agents.shares import Shares as Shares
    from kaju.errors import KajuError as KajuError
    from kaju.model.elastic.elastic_result import ElasticResult as ElasticResult
    from kaju.model.elastic.goals.quantities import Deflection as Deflection
    from kaju.model.elastic.goals.quantities import Reaction as Reaction
    from kaju.model.elastic.goals.quantities import Stress as Stress
    from kaju.model.elastic.relaxation.elastic_model import ElasticModel as ElasticModel
    from kaju.model.elastic.spawning_model import SpawningModel as SpawningModel
    from kaju.model.fracture.fracture_model import FractureModel as FractureModel
    from kaju.model.fracture.fracture_result import FractureResult as FractureResult
    from kaju.model.growth.growth_model import GrowthModel as GrowthModel
    from kaju.model.growth.growth_result import GrowthResult as GrowthResult
    from kaju.model.network import NetworkModel as NetworkModel
    from kaju.model.network import NetworkResult as NetworkResult
    from kaju.model.network import SpringNetwork as SpringNetwork
    from kaju.model.results.archive import load_result as load_result
    from kaju.model.results.result import Result as Result
    from kaju.model.rheology.creeping import CreepModel as CreepModel
    from kaju.model.rheology.creeping import creep as creep
    from kaju.model.rheology.element import ThreeElement as ThreeElement
    from kaju.model.rheology.load_history import History as History
    from kaju.model.scale.solve_petsc import solve_petsc as solve_petsc
    from kaju.model.scene import Lattice as Lattice
    from kaju.model.scene import Scene as Scene
    from kaju.model.scene import load_scene as load_scene
    from kaju.model.scene.lattice import Cubes as Cubes
    from kaju.model.scene.lattice import Squares as Squares
    from kaju.model.scene.level_sets import sampled_shape as sampled_shape
    from kaju.model.study.compare import compare as compare
    from kaju.model.study.finite_elements import finite_elements as finite_elements
    from kaju.model.study.fitting import fit_rule as fit_rule
    from kaju.model.study.reference import Reference as Reference
    from kaju.model.study.solving import solve as solve
    from kaju.model.study.sweep import sweep as sweep
    from kaju.model.transfer.load_model import LoadModel as LoadModel
    from kaju.model.transfer.stability import stability as stability
    from kaju.model.transfer.transfer_result import TransferResult as TransferResult
    from kaju.view.animation import animate as animate
    from kaju.view.page.export import export_page as export_page
    from kaju.view.plots import plot as plot

_LISTED = re.findall(r"^    from (\S+) import (\w+) as", Path(__file__).read_text("utf-8"), re.M)
_HOME = {name: module for module, name in _LISTED}

__all__ = sorted([*_HOME, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'kaju' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
