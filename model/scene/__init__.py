"""What is asked: bodies, supports and loads."""

from .body import Body
from .lattice import Lattice
from .loads import LoadRegion, LoadTable
from .regions import Region, RegionImage, Round
from .scene import Scene, load_scene, scene_needed
from .selection import AppliedLoads
from .sides import SideCondition

__all__ = [
    "AppliedLoads", "Body", "Lattice", "LoadRegion", "LoadTable", "Region", "RegionImage", "Round",
    "Scene", "SideCondition", "load_scene", "scene_needed",
]  # fmt: skip
