"""Pages inside notebooks, as a frame that needs no kernel.

The frame is the same file that `export_page` writes, put into the notebook as text and shut
off from it (a sandbox without a shared origin): it stays when the notebook is saved, its
kernel has ended, or nbconvert has made a document of it.
"""

from __future__ import annotations

import base64
import io
from html import escape
from typing import Any

from kaju.errors import KajuError
from kaju.model.scene import Scene
from kaju.model.stepped_model import SteppedModel

from .export import packed_page, page_html

HEIGHT = 640
"""Of a page in a notebook (pixels)."""


def html_of(of: Any) -> str:
    """Return what a notebook shows: of a scene a picture, of all else a page, or a picture."""
    if isinstance(of, Scene):
        return _picture(of)
    try:
        page = page_html(packed_page(_so_far(of)), "kaju")
    except KajuError:
        return _picture(of)
    return (
        f'<iframe title="kaju" sandbox="allow-scripts allow-downloads" srcdoc="{escape(page)}" '
        f'style="width:100%;height:{HEIGHT}px;border:0"></iframe>'
    )


def _so_far(of: Any) -> Any:
    """Return what to show: of a model what has happened, or will; the model stays as it is."""
    if not isinstance(of, SteppedModel):
        return of
    if of.steps:
        return of.result()
    return of.again(of.scene)


def _picture(of: Any) -> str:
    from kaju.view.plots import plot

    try:
        figure = plot(of)
    except KajuError:
        return f"<pre>{escape(repr(of))}</pre>"
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=100)
    picture = base64.b64encode(data.getvalue()).decode()
    return f'<img alt="{escape(repr(of))}" src="data:image/png;base64,{picture}">'
