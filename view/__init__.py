"""How people see it: pictures and films.

In comes a result, out go figures, films and meshes; nothing is computed again.
Read `plots` and `animation` (the verbs), `style`, `section` and `body_in_space` (what all pictures
share), then the file of a subject, such as `agents` or `maps`. This file loads no drawing library.
"""

from kaju.result_kinds import KINDS

_DRAWN = {name for kind in KINDS.values() for name in kind.pictures if name != "scene"}
PICTURES = tuple(f"{name}.png" for name in sorted(_DRAWN | {"agents_section"}))
"""Names of all files that `plot_all` may write."""
