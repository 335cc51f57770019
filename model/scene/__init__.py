"""What is asked: bodies, supports and loads."""

from .body import Body
from .lattice import Lattice
from .loads import Load
from .scene import Scene, load_scene
from .selection import AppliedLoads
from .sides import SideCondition

__all__ = ["AppliedLoads", "Body", "Lattice", "Load", "Scene", "SideCondition", "load_scene"]
