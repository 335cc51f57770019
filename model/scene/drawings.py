"""Outlines in SVG drawings, in metres and y upwards, read by svgpathtools."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np

from kaju.arrays import Floats
from kaju.errors import SceneError, needing

from .curves import flattened
from .shapes import Polygon

_PIXEL = 0.0254 / 96.0
_UNITS = {
    **{"": _PIXEL, "px": _PIXEL, "in": 0.0254, "pt": 0.0254 / 72.0, "pc": 0.0254 / 6.0},
    **{"cm": 0.01, "mm": 0.001, "Q": 0.00025},
}
"""Metres, as CSS has them."""
_LENGTH = re.compile(r"\s*([-+\d.eE]+?)\s*(px|in|pt|pc|cm|mm|Q|)\s*$")
_GROUPS = ("svg", "g", "a")
_OUTLINES = ("path", "rect", "circle", "ellipse", "polygon")
_SILENT = ("defs", "metadata", "title", "desc", "style", "namedview", "clipPath", "mask", "marker")
_PLACED = ("clip-path", "mask")  # attributes that hide a part of an outline
_SVG = "{http://www.w3.org/2000/svg}"


def read_drawing(text: str, read_path: Callable[[str], list[Floats]]) -> list[Floats]:
    """Return the closed lines of a drawing, each of shape (n, 4, 3).

    The page's lower left corner is the origin. Lines within a line go round holes, whatever their
    colour; within a path its fill rule says so. `read_path` reads the lines of each.
    """
    with needing("path.file: an SVG drawing needs svgpathtools: pip install 'kaju[cad]'"):
        from svgpathtools.document import CONVERSIONS
        from svgpathtools.parser import parse_transform
    if "<!ENTITY" in text:
        raise _wrong("entities are not read; save it as plain SVG")
    try:
        root = ElementTree.fromstring(text)  # noqa: S314 (without entities)
    except ElementTree.ParseError as error:
        raise _wrong(f"is not an SVG drawing ({error}); save it as plain SVG") from None
    found: list[list[Floats]] = []
    for element, place in _elements(root, _page(root), parse_transform):
        try:
            data = CONVERSIONS[_name(element)](_rounded(element))
            lines = [_moved(line, place) for line in read_path(data)]
        except (SceneError, ValueError) as error:
            raise _wrong(f"{_called(element)} is no outline ({error})") from None
        found.append(lines if _style(element, "fill-rule") == "evenodd" else _nonzero(lines))
    if not found:
        raise _wrong("holds no outline; draw a path, rect, circle, ellipse or polygon")
    _check_apart([line for lines in found for line in lines])
    return [line for lines in found for line in lines]


def _wrong(what: str) -> SceneError:
    return SceneError(f"path.file: {what}")


def _name(element: Any) -> str:
    return str(element.tag).rpartition("}")[2]


def _called(element: Any) -> str:
    name = element.get("id")
    return f"<{_name(element)}{f' id={name!r}' if name else ''}>"


def _style(element: Any, key: str) -> str:
    """Return a property from an element's style, or its attribute of that name."""
    found = re.search(rf"(?:^|;)\s*{key}\s*:\s*([^;]+)", element.get("style", ""))
    return (found[1] if found else element.get(key, "")).strip()


def _page(root: Any) -> Floats:
    """Return the matrix from a drawing's own units to metres, y upwards."""
    if _name(root) != "svg":
        raise _wrong(f"its first element is <{_name(root)}>, not <svg>; save it as plain SVG")
    size = [_length(root.get(key, "")) for key in ("width", "height")]
    box = [float(part) for part in re.split(r"[\s,]+", root.get("viewBox", "").strip()) if part]
    if len(box) != 4 and size[1] is None:
        raise _wrong("has neither height nor viewBox, so which way is up is not known; give one")
    if len(box) != 4:
        box = [0.0, 0.0, *((length or 1.0) / _PIXEL for length in size)]
    if min(box[2:]) <= 0.0:
        raise _wrong(f"its viewBox {box} has no area")
    whole = [b * _PIXEL if a is None else a for a, b in zip(size, box[2:], strict=True)]
    if size.count(None) == 1:  # the other side keeps the proportions
        known = int(size[0] is None)
        whole[1 - known] = whole[known] * box[3 - known] / box[2 + known]
    scale = min(whole[0] / box[2], whole[1] / box[3])
    x, y = (0.5 * (a - scale * b) for a, b in zip(whole, box[2:], strict=True))  # in the middle
    return np.array(
        [
            [scale, 0.0, x - scale * box[0]],
            [0.0, -scale, whole[1] - y + scale * box[1]],
            [0.0, 0.0, 1.0],
        ]
    )


def _length(text: str) -> float | None:
    """Return a length (m); None for what is left out or a share of the screen."""
    found = _LENGTH.match(text)
    if not text.strip() or text.strip().endswith("%") or text == "auto":
        return None
    if not found:
        raise _wrong(
            f"its size {text!r} is no length; give it in {', '.join(filter(None, _UNITS))}"
        )
    return float(found[1]) * _UNITS[found[2]]


def _elements(element: Any, place: Floats, transform: Any) -> Iterator[tuple[Any, Floats]]:
    """Yield each outline of a drawing, and the matrix to metres of its coordinates."""
    for child in element:
        name = _name(child)
        own = str(child.tag).startswith(_SVG) or "}" not in str(child.tag)
        if not own or name in _SILENT or _style(child, "display") == "none":
            continue
        if name not in (*_GROUPS[1:], *_OUTLINES):
            raise _wrong(f"{_called(child)} is no outline; turn it into a path, or remove it")
        for key in _PLACED:
            if _style(child, key) not in ("", "none"):
                raise _wrong(f"{_called(child)} has a {key}; cut its outline in the drawing")
        try:
            inner = place @ transform(child.get("transform", ""), strict=True)
        except (ValueError, TypeError) as error:
            raise _wrong(f"{_called(child)}: its transform is not read ({error})") from None
        if name in _GROUPS:
            yield from _elements(child, inner, transform)
        else:
            yield child, inner


def _rounded(element: Any) -> Any:
    """Return a rectangle whose corners are no rounder than its sides allow, as SVG draws it."""
    if _name(element) != "rect":
        return element
    given = dict(element.attrib)
    for key, other, side in (("rx", "ry", "width"), ("ry", "rx", "height")):
        radius = element.get(key, element.get(other))
        if radius not in (None, "auto"):
            given[key] = str(min(float(radius), 0.5 * float(element.get(side, 0))))
    return ElementTree.Element(element.tag, given)


def _moved(line: Floats, place: Floats) -> Floats:
    """Return arcs moved by a matrix; control points are homogeneous."""
    return line @ place.T


def _polygon(line: Floats) -> Polygon:
    return Polygon(tuple(map(tuple, flattened(line, 16).tolist())))


def _turn(line: Floats) -> int:
    x, y = flattened(line, 16).T
    return 1 if x @ np.roll(y, -1) > y @ np.roll(x, -1) else -1


def _nonzero(lines: list[Floats]) -> list[Floats]:
    """Return the lines of a path beside which the winding number is 0 on one side alone."""
    turns, shapes = [_turn(line) for line in lines], [_polygon(line) for line in lines]
    kept = []
    for one, line in enumerate(lines):
        start = line[:1, 0, :2] / line[:1, 0, 2:]
        outside = sum(
            turns[k] for k, shape in enumerate(shapes) if k != one and shape.contains(start)[0]
        )
        if (outside == 0) != (outside + turns[one] == 0):
            kept.append(line)
    return kept


def _check_apart(lines: list[Floats]) -> None:
    """Refuse outlines that cross: which of both is meant cannot be told by lines within lines."""
    shapes = [_polygon(line) for line in lines]
    for one, shape in enumerate(shapes):
        for other in shapes[:one]:
            for inner, outer in ((shape, other), (other, shape)):
                inside = outer.contains(np.array(inner.corners))
                if inside.any() and not inside.all():
                    x, y = np.array(inner.corners)[int(np.argmax(inside))]
                    raise _wrong(
                        f"two outlines cross or touch near ({x:.4g}, {y:.4g}) m; join them to one "
                        "path in the drawing"
                    )
