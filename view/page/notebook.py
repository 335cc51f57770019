"""Pages inside notebooks: as a frame that needs no kernel, or as a widget that Python feeds.

The frame is the same file that `export_page` writes, put into the notebook as text and shut
off from it (a sandbox without a shared origin): it stays when the notebook is saved, its
kernel has ended, or nbconvert has made a document of it.
"""

from __future__ import annotations

import base64
import io
from functools import cache
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kaju.errors import KajuError, needing
from kaju.mesa_model import SteppedModel
from kaju.model.results.archive import Archive
from kaju.model.results.subjects import subject_from

from .export import MODULES, joined, packed_page, page_html
from .live import Session, Watched, sessions_of

if TYPE_CHECKING:
    from anywidget import AnyWidget

HEIGHT = 640
"""Of a page in a notebook (pixels)."""

RENDER = """
export default {
  async render({ model, el }) {
    el.style.height = `${model.get("height")}px`;
    const ask = (question) => model.send(question);
    const listen = (heard) => model.on("msg:custom", (_, [bytes]) =>
      heard(new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength)));
    await connect(el, model.get("page"), ask, listen);
  },
};
"""


def html_of(of: Any) -> str:
    """Return what a notebook shows of a model or a result: a page, or else a picture."""
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
    return of.again(subject_from(Archive(Path(), *of.checkpoint_parts())))


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


def live(of: Watched, height: int = HEIGHT) -> AnyWidget:
    """Return a widget that shows agents while Python computes them, for notebooks.

    Parameters
    ----------
    of : Scene, LoadModel or ElasticModel
        With a prescribed or an elastic rule; a model may have agents of your own.
    height : int
        Of the widget (pixels).

    Raises
    ------
    MissingExtraError
        If anywidget is not installed.
    ParameterError
        If it is none of these.
    """
    run = sessions_of(of)()
    page = base64.b64encode(run.opening()).decode()
    return _widget()(run, page=page, height=height)


@cache
def _widget() -> type[AnyWidget]:
    with needing("live: a widget needs anywidget: pip install 'kaju[notebook]'"):
        import anywidget
        import traitlets

    class LivePage(anywidget.AnyWidget):
        """One page, and the run behind it."""

        _esm = joined((*MODULES, "live.js")) + RENDER
        page = traitlets.Unicode().tag(sync=True)
        height = traitlets.Int().tag(sync=True)

        def __init__(self, run: Session, **traits: Any) -> None:
            super().__init__(**traits)
            self.run = run
            self.on_msg(self._asked)

        def _asked(self, _widget: object, question: Any, _buffers: object) -> None:
            self.send({}, buffers=[self.run.answer(question)])

    return LivePage
