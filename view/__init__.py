"""How people see it: pictures and films.

In comes a result, out go figures, films and meshes; nothing is computed again.
Read `plots` and `animation` (the verbs), `style`, `section` and `body_in_space` (what all pictures
share), then the file of a subject, such as `agents` or `maps`. Functions are looked up when they
are first used, so that ``import kaju.view`` loads no drawing library.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from kaju.result_kinds import KINDS

if TYPE_CHECKING:
    from .animation import animate
    from .plots import plot, plot_all

__all__ = ["PICTURES", "animate", "plot", "plot_all"]

_DRAWN = {name for kind in KINDS.values() for name in kind.pictures if name != "scene"}
PICTURES = tuple(f"{name}.png" for name in sorted(_DRAWN | {"agents_section"}))
"""Names of all files that `plot_all` may write."""


def __getattr__(name: str) -> object:
    if name == "animate":
        from .animation import animate

        return animate
    if name in __all__:
        from . import plots

        return getattr(plots, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
