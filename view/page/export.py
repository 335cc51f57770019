"""A page as one file that opens by a double click: no server, no network, no installation."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import zlib
from collections.abc import Mapping
from functools import cache
from html import escape
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from kaju.agents.parameter import Parameter, declared
from kaju.agents.rules import PrescribedRule
from kaju.errors import KajuError, ParameterError, ResultFileError, brief, by_name, check_type
from kaju.files import atomic_file
from kaju.model.elastic.relaxation.elastic_model import ElasticModel
from kaju.model.results.archive import from_file
from kaju.model.results.result import Result
from kaju.model.rheology.creeping import creep
from kaju.model.scene import Scene
from kaju.model.scene.lattice import BUILT_IN
from kaju.model.stepped_model import SteppedModel
from kaju.model.stepper import counted
from kaju.model.study.solving import solve
from kaju.model.transfer.load_model import LoadModel
from kaju.model.transfer.stability import stability
from kaju.model.transfer.transfer import BOUNDARY_NAMES
from kaju.model.transfer.transfer_result import TransferResult

from . import python as written
from .data import FORMAT, Account, history_columns, motion_data, pack, scene_data

Text = str | Mapping[str, str]
"""What a reader reads: one text, or one for each language ("en", "de", "ja")."""


MODULES = (
    "lattice.js", "history.js", "rule.js", "deformation.js", "words.js", "scene.js", "controls.js",
    "paint.js", "charts.js", "state.js",
    "loads.js", "cell.js", "lesson.js", "twin.js", "cutting.js",
    "panels.js", "page.js", "motion.js",
)  # fmt: skip
"""In the order in which they are joined: each uses only those before it at its top level."""
WRITTEN = ("lattice.js", "history.js", "rule.js", "written.js")
"""What the worker has of them in which agents in Python run."""
START = """
await openPage(document.getElementById("kaju"), document.getElementById("kaju-data").textContent);
"""
UNFOLD = """
const pressed = Uint8Array.from(atob(document.getElementById("kaju-code").textContent),
  (letter) => letter.charCodeAt(0));
const plain = new Blob([pressed]).stream().pipeThrough(new DecompressionStream("deflate"));
document.body.append(Object.assign(document.createElement("script"),
  { type: "module", textContent: await new Response(plain).text() }));
"""
"""What puts the modules into the page: deflated, they are a fifth of what they were."""
LANGUAGES = ("en", "de", "ja")
"""What the page's own words are written in."""


@by_name
def export_page(
    of: Any,
    path: str | Path,
    *,
    title: Text | None = None,
    text: Text = "",
    presets: Mapping[str, Scene | tuple[Scene, str]] | None = None,
    language: str | None = None,
    exact: bool = False,
    lesson: Mapping[str, Any] | None = None,
    python: bool = False,
) -> Path:
    """Write a page that shows a run, and lets readers change it.

    The file needs nothing else: it opens by a double click, without server or network. Where
    the prescribed rule's own agents ran, the page runs the rule itself, and coefficients,
    loads and the body can be changed in it. All else is recorded.

    Parameters
    ----------
    of : Scene, Result, model or path
        What to show. A model that has not come to rest is run to its end, a scene with an
        elastic rule by `ElasticModel`. Of agents of your own give the model, best before it runs:
        a result does not know their source, nor what they did in each generation.
    path : path
        The file to write, ending in ``.html`` or ``.htm``.
    title, text : str or mapping of str to str, optional
        Headline, and what is written beside the picture, in Markdown: headings, lists, tables,
        links, ``**bold**``, ``*emphasis*``. A mapping has a text for each language.
    presets : mapping of str to Scene or (Scene, str), optional
        Further scenes by name, as buttons; the text says what to look for.
    language : {"en", "de", "ja"}, optional
        Language of the page's own words; the reader's own unless given.
    exact : bool
        Record loads as 64-bit numbers.
    lesson : mapping, optional
        Makes the page a lesson: its questions with answers, tolerances and hints, asked one by
        one. README.md beside this file lists the keys.
    python : bool
        Let readers write agents in the page, in Python (needs ``pip install 'kaju[page]'``); the
        page then has some 580 kB.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ParameterError
        If a page cannot show it, or the name of the file ends otherwise.
    ResultFileError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from kaju import Scene, export_page
    >>> scene = Scene(
    ...     body={"cells": [5, 5], "cell_size": 0.01, "material": "steel"},
    ...     sides={"bottom": "rigid"},
    ...     loads=[{"cell": [2, 4], "force": [0.0, -2.0]}],
    ... )
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     export_page(scene, Path(folder) / "plate.html").name
    ...
    'plate.html'
    """
    told = "path: the name of a page comes second, after what it shows, as in export_page(model, "
    if not isinstance(path, str | PathLike):
        raise ParameterError(f"{told}'page.html'); got {brief(path)}")
    target = Path(path)
    if target.suffix not in (".html", ".htm"):
        raise ParameterError(f"{target}: a page is an .html file; name it {target.stem}.html")
    if language not in (None, *LANGUAGES):
        raise ParameterError(f"language: one of {', '.join(LANGUAGES)} is needed, got {language!r}")
    for name, given in (("title", title), ("text", text)):
        check_type(name, given, Text | None)
        for part in given.values() if isinstance(given, Mapping) else ():
            check_type(name, part, str)
    check_type("presets", presets, Mapping[str, Any] | None)
    check_type("python", python, bool)
    for name, preset in (presets or {}).items():
        scene = preset[0] if isinstance(preset, tuple) and len(preset) == 2 else preset
        if not isinstance(scene, Scene):
            raise ParameterError(f"presets: {name!r} must be a Scene, or one with a text, in pairs")
    about = {"title": title, "language": language, "lesson": lesson}
    packed = packed_page(from_file(of), text, presets, about, exact=exact, python=python)
    titles = title if isinstance(title, Mapping) else {"en": title}
    named = titles.get(language or "en") or next(iter(titles.values()), None)
    html = page_html(packed, named or "kaju", python=python)
    with atomic_file(target, ResultFileError) as scratch:
        scratch.write_text(html, encoding="utf-8")
    return target


def packed_page(
    of: Any,
    text: Text = "",
    presets: Mapping[str, Scene | tuple[Scene, str]] | None = None,
    about: Mapping[str, Any] | None = None,
    *,
    exact: bool = False,
    python: bool = False,
) -> bytes:
    """Return a page's data, packed as README.md beside this file describes it."""
    if isinstance(of, Scene) and of.outlined:
        of = solve(of)  # no rule runs within true outlines
    elif isinstance(of, Scene) and not isinstance(of.rule, PrescribedRule):
        creeps = of.history and any(material.rheology for material in of.cell_materials)
        of = creep(of) if creeps else ElasticModel(of)
    elif isinstance(of, Scene) and of.lattice.kind not in BUILT_IN:
        of = LoadModel(of)  # the page knows no neighbours of such cells
    if not (isinstance(of, (Scene, Result)) or hasattr(of, "run")):
        raise ParameterError(f"of: a scene, a model or a result is needed, got {brief(of)}")
    shown: Scene | Result
    account = None
    own = _own_data(of) if isinstance(of, SteppedModel) else {}
    if isinstance(of, LoadModel) and own and of.steps == 0:
        shown, account = _watched(of)
    else:
        shown = of if isinstance(of, (Scene, Result)) else of.run()
    named = own or {"names": getattr(shown, "own_agents", ()), "source": ""}
    header: dict[str, Any] = {"format": FORMAT, "text": text}
    header |= {"own": named} if named["names"] else {}
    header |= {name: told for name, told in (about or {}).items() if told}
    scene = shown.scene if isinstance(shown, TransferResult) else shown
    if not isinstance(shown, Scene) and not (
        isinstance(scene, Scene) and scene.lattice.kind in BUILT_IN
    ):
        if python:
            raise ParameterError(
                "python: agents are written in pages of squares, hexagons or cubes under a "
                "prescribed rule; leave python out"
            )
        pictures, columns = motion_data(shown)
        return pack(header | pictures | {"kind": "pictures"}, columns)
    assert isinstance(scene, Scene)
    data, columns = scene_data(scene)
    header |= {"scene": data, "kind": "runnable"}
    if isinstance(shown, TransferResult) and (own or not _by_the_rule(shown)):
        last, certificate = shown.last, shown.certificate
        if own and shown.seed is not None:
            drawn = {"name": "seed", "label": "seed (rng=)", "value": shown.seed}
            own["parameters"].append(drawn)
        stable, verdict = bool(certificate.stable), certificate.verdict
        if not certificate.known and last.outcome:  # nobody knew before the run; now it is known
            stable = last.outcome.startswith("at rest")
            verdict = last.outcome + (f", {counted(len(last.cells), 'agent')}" if stable else "")
            idle = [told for told in shown.caveats_in_brief if told.startswith("no load reached")]
            verdict = "; ".join([verdict, *idle])
        header |= {
            "kind": "recorded",
            "outcome": last.outcome,
            "stable": stable or (False if certificate.known else None),
            "verdict": verdict,
            "late": account is None,
            "walls": {k: shown.own_boundaries.get(n, "") for k, n in BOUNDARY_NAMES.items()},
            "states": [[s.name, s.meaning, isinstance(s.default, bool)] for s in last.states],
        }
        # What a model noted after each generation; a collector of one's own has no such figures.
        noted = of.datacollector.model_vars if isinstance(of, LoadModel) else {}
        for name in ("dropped", "absorbed"):
            loads = noted.get(f"load_{name}", [])[-last.generations :]
            header |= {name: loads} if any(loads) else {}
        history = history_columns(scene, last, account)
        for name, column in history.items():
            small = column.dtype == np.float64 and not exact
            columns[name] = column.astype(np.float32) if small else column
    header |= written.header(own) if python else {}
    header["presets"] = []
    for number, (name, preset) in enumerate((presets or {}).items()):
        other, note = preset if isinstance(preset, tuple) else (preset, "")
        data, own_columns = scene_data(other)
        if not np.array_equal(own_columns["cells"], columns["cells"]):
            columns[f"cells{number}"] = own_columns["cells"]
        header["presets"].append({"name": name, "note": note, "scene": data})
    return pack(header, columns)


def _own_data(model: Any) -> dict[str, Any]:
    """Return names, source and parameters of agents, boundaries, order and rule of your own."""
    found: list[Any] = []
    for own in model.arguments()[1].values():
        found += list(own.values()) if isinstance(own, Mapping) else [own]
    chosen = (part for part in found if part is not None)
    parts = list(dict.fromkeys(p if hasattr(p, "__name__") else type(p) for p in chosen))
    if not parts:
        return {}
    sources = written.sources(parts)
    if getattr(model.order, "__name__", "").isidentifier():  # not of a lambda
        sources.append(f"order = {model.order.__name__}")
    values = getattr(model, "parameters", {})
    classes = [part for part in parts if isinstance(part, type)]
    return {
        "names": [part.__name__ for part in parts],
        "source": "\n\n".join(sources),
        "parameters": [
            {"name": name, "label": parameter.text or name, "value": values[name]}
            for name, parameter in declared(classes, Parameter).items()
            if name in values
        ],
    }


def _watched(model: LoadModel) -> tuple[TransferResult, Account]:
    """Run a model to its end; return also what its agents did in each generation."""
    account = Account(model.scene)

    def note(model: LoadModel) -> bool:
        nonlocal account
        if model.generation == 1:  # a stage of loading has begun
            account = Account(model.scene)
        if model.generation:
            account.note(model.generation, model.engine.totals(), model.engine.returned)
        return False

    result = model.run(until=note)
    note(model)
    return result, account


_DONE = (
    ("cells", "spawn_step", "taken", "kept", "shortened", "widened", "passed", "dropped"),
    ("boundary_cells", "boundary_spawn_step", "returned", "arrived"),
)


def _by_the_rule(result: TransferResult) -> bool:
    """Tell whether the rule's own agents give these loads again: then the page can run them.

    A result does not know its agents' classes, and need not: what counts is what they did.
    """
    scene = result.scene
    whole = result.certificate.known and len(result.stages) == scene.stages
    if not (whole and stability(scene).stable):
        return False
    again = LoadModel(scene, engine="arrays").run().last
    for names in _DONE:
        row, other = (
            np.argsort(scene.lattice.key(getattr(s, names[0]))) for s in (result.last, again)
        )
        for name in names:
            ours, theirs = getattr(result.last, name)[row], getattr(again, name)[other]
            rounding = 1e-12 * np.abs(theirs).max(initial=0.0)
            if ours.shape != theirs.shape or not np.allclose(ours, theirs, 1e-9, rounding):
                return False
    return True


@cache
def joined(modules: tuple[str, ...] = MODULES) -> str:
    """Return modules as the text of one: their imports and exports are taken out."""
    folder = files(__package__)
    parts = [folder.joinpath(name).read_text("utf-8") for name in modules]
    constants: dict[str, Any] = {}
    if "words.js" in modules:
        words = json.loads(folder.joinpath("words.json").read_text("utf-8"))
        more = json.loads(written.text_of("words.json")) if "agent.js" in modules else {}
        constants["WORDS"] = {key: texts | more.get(key, {}) for key, texts in words.items()}
    if "page.js" in modules:
        style = folder.joinpath("page.css").read_text("utf-8")
        constants |= {"STYLE": re.sub(r"\n *", "\n", style), "ELASTIC": worker()}
    code = "\n".join(parts)
    code = re.sub(r"^import [^;]*;$\n?", "", code, flags=re.M)
    code = re.sub(r"^export (?=const|let|function|class|async)", "", code, flags=re.M)
    code = re.sub(r" {2,}// .*$", "", code, flags=re.M)
    code = re.sub(r"^\s*(//.*\n|/\*\*.*\*/\n)?\s*", "", code, flags=re.M)
    return "".join(f"const {name} = {json.dumps(of)};\n" for name, of in constants.items()) + code


ANSWER = """
onmessage = ({ data: { scene, cells, loads } }) => {
  try {
    postMessage({ answer: elasticAnswer(scene, cells, loads) });
  } catch (error) { postMessage({ error: error.message }); }
};
"""


@cache
def worker() -> str:
    """Return the text of the worker that answers with elasticity."""
    return joined(("lattice.js", "elastic.js")) + ANSWER


def page_html(packed: bytes, title: str, python: bool = False) -> str:
    """Return the file: the page's modules, their data, and a strict content policy.

    The modules are deflated, half of the file's bytes otherwise, and put in by a short script.
    Only these two, whose hashes the policy names, may run; nothing may be fetched.
    """
    code = joined((*MODULES, "agent.js") if python else MODULES) + START
    digests = [hashlib.sha256(script.encode()).digest() for script in (UNFOLD, code)]
    fields = {
        "hashes": " ".join(f"'sha256-{base64.b64encode(d).decode()}'" for d in digests)
        + (" 'unsafe-eval'" if python else ""),  # Brython turns Python into functions
        "python": written.worker(joined(WRITTEN)) if python else "",
        "title": escape(title),
        "data": base64.b64encode(packed).decode(),
        "code": base64.b64encode(zlib.compress(code.encode(), 9)).decode(),
        "unfold": UNFOLD,
    }
    template = files(__package__).joinpath("page.html").read_text("utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda match: fields[match[1]], template)


def html_of(of: Any) -> str:
    """Return what a notebook shows: of a scene a picture, of all else a page, or a picture."""
    if isinstance(of, Scene):
        return _picture(of)
    shown = of
    if isinstance(of, SteppedModel):  # what has happened, or will; the model stays as it is
        shown = of.result() if of.steps else of.again(of.scene)
    try:
        page = page_html(packed_page(shown), "kaju")
    except KajuError:
        return _picture(of)
    return (
        f'<iframe title="kaju" sandbox="allow-scripts allow-downloads" srcdoc="{escape(page)}" '
        f'style="width:100%;height:640px;border:0"></iframe>'
    )


def _picture(of: Any) -> str:
    from kaju.view.plots import plot

    try:
        data = plot(of)._repr_png_()  # type: ignore[attr-defined]
    except KajuError:
        return f"<pre>{escape(repr(of))}</pre>"
    picture = base64.b64encode(data).decode()
    return f'<img alt="{escape(repr(of))}" src="data:image/png;base64,{picture}">'
