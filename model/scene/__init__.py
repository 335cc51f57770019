"""What is asked: bodies, supports and loads.

In comes a TOML file or keyword arguments; out go kinds of cells and forces on their faces.
Read `scene` (the whole), `description` (what each table may hold), `regions` (where material is),
then `resolved_body` and `selection` (which cells and faces these are).
"""

from .description import Body, LoadTable, SideCondition
from .lattice import Lattice
from .regions import LoadRegion, Region, RegionImage
from .scene import Scene, body_cells, load_scene, named, scene_needed
from .selection import AppliedLoads

__all__ = [
    "AppliedLoads", "Body", "Lattice", "LoadRegion", "LoadTable", "Region", "RegionImage",
    "Scene", "SideCondition", "body_cells", "load_scene", "named", "scene_needed",
]  # fmt: skip
