"""What is asked: bodies, supports and loads."""

from .body import Body
from .lattice import Lattice
from .loads import LoadTable
from .regions import LoadRegion, Region, RegionImage
from .scene import Scene, body_cells, load_scene, scene_needed
from .selection import AppliedLoads
from .sides import SideCondition

__all__ = [
    "AppliedLoads", "Body", "Lattice", "LoadRegion", "LoadTable", "Region", "RegionImage",
    "Scene", "SideCondition", "body_cells", "load_scene", "scene_needed",
]  # fmt: skip
