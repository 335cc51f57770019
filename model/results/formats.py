"""Arrays of stored answers whose fields do not say yet what they hold: face agents, outlines.

Sizes go by name: "agents" is the number of rows of the first array that has that name in its
shape; sizes of the scene come from `sizes_of`. Other elastic answers are checked where their agents
are built.
"""

from __future__ import annotations

from .archive import ArchiveColumn

OUTLINE_AGENTS = {
    "x": ArchiveColumn("i", "agents", 0),
    "y": ArchiveColumn("i", "agents", 0),
    "size": ArchiveColumn("i", "agents", 1),
}
