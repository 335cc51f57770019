"""What a cell can be.

A kind from 0 upwards is a material: its index in `Scene.cell_materials`. The negative ones
are what is not body, inside the array or beyond its sides.
"""

from __future__ import annotations

from typing import Final

AIR: Final = -1  # Nothing: whatever lies before it is a free surface.
RIGID: Final = -2  # Ground, a wall, a punch: holds what touches it in every direction.
ROLLER: Final = -3  # A wall without friction: holds across, lets slide along.
FOUNDATION: Final = -4  # An elastic bed of given stiffness per area.
DISPLACED: Final = -5  # A wall that moves what touches it by a given displacement.

NAMES: Final = {
    AIR: "air",
    RIGID: "rigid",
    ROLLER: "a roller",
    FOUNDATION: "a foundation",
    DISPLACED: "a displaced wall",
}
PINNED: Final = "pinned"  # What is rigid, and turns about its middle: within true outlines alone.
HOLDING: Final = "rigid", PINNED
NOT_BODY: Final = {
    **dict.fromkeys(("air", "water", "gas", "vacuum"), AIR),
    **dict.fromkeys(HOLDING, RIGID),
    "roller": ROLLER,
}
"""What scenes call a cell that is not body: whatever surrounds it gives loads back like air."""
INSIDE: Final = "rigid"  # Name of the support that rigid cells inside the array give.
