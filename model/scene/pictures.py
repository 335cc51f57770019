"""Bodies given cell by cell: a drawing in letters, an image in colours, an array in codes.

All three become a `Picture`: one small integer per cell and the names these stand for. Files are
read with limits: a bad one is one clear error.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.errors import SceneError, SceneFileError, needing
from kaju.files import file_to_read

MOST_PIXELS = 50_000_000
"""Images above this many pixels are not read."""

MOST_CELLS = 200_000_000
"""Bodies above this many cells are never held cell by cell."""


def read_pixels(path: str, key: str) -> NDArray[np.uint8]:
    """Return an image's pixels as red, green, blue and opacity, shape (height, width, 4)."""
    with opened(path, key) as image:
        if image.mode in _DEPTHS:
            grey = (255.0 * _grey(np.asarray(image), path, key)).round().astype(np.uint8)
            return np.dstack([grey, grey, grey, np.full_like(grey, 255)])
        return np.asarray(image.convert("RGBA"))


def read_darkness(path: str, key: str) -> Floats:
    """Return how dark an image's pixels are, 0 to 1, shape (height, width); clear ones are 0."""
    with opened(path, key) as image:
        if image.mode in _DEPTHS:
            return 1.0 - _grey(np.asarray(image), path, key)
        pixels = np.asarray(image.convert("RGBA"), dtype=np.float64)
    weights = np.array([0.299, 0.587, 0.114])  # of the eye (ITU-R BT.601)
    brightness = (pixels[:, :, :3] @ weights / 255.0).clip(0.0, 1.0)  # rounding passes 1
    return np.asarray((1.0 - brightness) * pixels[:, :, 3] / 255.0)


_DEPTHS = ("I", "F", "I;16", "I;16L", "I;16B", "I;16N")
"""Pillow's grey modes of more than 8 bits."""


def _grey(values: NDArray[Any], path: str, key: str) -> Floats:
    """Return the brightness of grey pixels: shares of the largest value of their type.

    For floats that is 1. Numbers of 32 bits up to 65535 were written with 16 bits. What lies
    outside of 0 to 1 is refused.
    """
    white = 1.0 if values.dtype.kind in "fb" else float(np.iinfo(values.dtype).max)
    if values.dtype.itemsize == 4 and values.dtype.kind in "iu" and values.max() <= 65535:
        white = 65535.0
    grey = values.astype(np.float64) / white
    if not (np.isfinite(grey).all() and grey.min() >= 0.0 and grey.max() <= 1.0):
        raise SceneFileError(
            f"{key}: {path} has values from {values.min():g} to {values.max():g}; black is 0 and "
            f"white is {white:g}. Scale it to these, or save it as an .npy array"
        )
    return grey


@contextmanager
def opened(path: str, key: str) -> Iterator[Any]:
    """Yield Pillow's image, turned as its camera says (EXIF); refuse what is none, or too large."""
    from PIL import Image, ImageOps

    file_to_read(path, SceneFileError, key=key)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(path) as image:
                if image.width * image.height > MOST_PIXELS:
                    raise SceneFileError(
                        f"{key}: {path} has {image.width} x {image.height} pixels, more than "
                        f"{MOST_PIXELS:.0e}; draw it smaller and refine the scene"
                    )
                pages = getattr(image, "n_frames", 1)
                if pages > 1:
                    raise SceneFileError(
                        f"{key}: {path} has {pages} pages; one is needed. Save a single "
                        "page, or give a TIFF of layers to a body in space"
                    )
                yield ImageOps.exif_transpose(image)
    except Image.DecompressionBombError:
        raise SceneFileError(
            f"{key}: {path} unpacks to an enormous image; at most {MOST_PIXELS:.0e} pixels are read"
        ) from None
    except SceneFileError:
        raise
    # Pillow's readers fail in many ways on broken files, SyntaxError among them
    except Exception as error:
        raise SceneFileError(
            f"{key}: {path} cannot be read as an image ({error}); save it as PNG"
        ) from None


def read_layers(path: str, key: str) -> Floats:
    """Return how dark the layers of a TIFF are, 0 to 1, indexed [x, y, z]; the first is lowest."""
    with needing(f"{key}: layers of a TIFF need tifffile: pip install 'kaju[cad]'"):
        import tifffile
    file_to_read(path, SceneFileError, key=key)
    try:
        with tifffile.TiffFile(path) as file:
            shape, axes = file.series[0].shape, file.series[0].axes
            fits = (
                len(shape) == 3 and "S" not in axes and np.prod(shape, dtype=float) <= MOST_PIXELS
            )
            values = file.asarray() if fits else None
    except Exception as error:  # broken files fail in many ways
        raise SceneFileError(f"{key}: {path} cannot be read as a TIFF ({error})") from None
    if values is None:
        needed = f"grey layers of one size are needed, with at most {MOST_PIXELS:.0e} pixels"
        raise SceneFileError(f"{key}: {path} has the shape {shape}; {needed}")
    return (1.0 - _grey(values, path, key))[:, ::-1].transpose(2, 1, 0)


def read_array(path: str, key: str) -> NDArray[np.generic]:
    """Return the array in an ``.npy`` file without reading more than its head at first."""
    file_to_read(path, SceneFileError, key=key)
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError):
        raise SceneFileError(
            f"{key}: {path} cannot be read as an array of numbers; write it with numpy.save"
        ) from None
    if not isinstance(array, np.ndarray):
        raise SceneFileError(f"{key}: {path} holds several arrays; save one with numpy.save")
    return array


_LETTERS = "#o*+xO%@&ABCDEFGHIJKLMNPQRSTUVWXYZabcdefghijklmnpqrstuvwyz0123456789"


@dataclass(frozen=True, eq=False)
class Picture:
    """A body given cell by cell."""

    codes: NDArray[np.int16]
    """For every cell an index into `names`; first index along x from the left, second along y from
    the bottom (front in 3-D), third along z from the bottom."""
    names: tuple[str, ...]
    """Materials, "air" and "rigid" that the codes stand for."""

    @property
    def drawable(self) -> bool:
        """Whether the picture can be written as a drawing of reasonable length."""
        few = self.codes.size <= 20_000 and len(self.names) <= len(_LETTERS)
        return few and self.codes.ndim == 2

    def drawing(self) -> tuple[str, dict[str, str]]:
        """Return the picture as a drawing and its legend."""
        free = iter(_LETTERS)
        usual = {"air": ".", "rigid": "="}
        letters = [usual.get(name) or next(free) for name in self.names]
        rows = ("".join(letters[code] for code in row) for row in self.codes.T[::-1])
        return "\n".join(rows) + "\n", dict(zip(letters, self.names, strict=True))


def from_drawing(drawing: str, legend: Mapping[str, str]) -> Picture:
    """Read a drawing: one letter a cell, the top row first."""
    for letter in legend:
        if len(letter) != 1 or not letter.isprintable():
            raise SceneError(f"legend: {letter!r} is not a letter; a drawing has one for each cell")
    lines = drawing.replace("\r\n", "\n").strip("\n").split("\n")
    rows = lines if " " in legend else [line.strip() for line in lines]
    if not rows[0]:
        raise SceneError("body.drawing: is empty; draw one letter a cell, the top row first")
    check_size((len(rows), len(rows[0])), "body.drawing")
    for number, row in enumerate(rows, start=1):
        if len(row) != len(rows[0]):
            raise SceneError(
                f"body.drawing: line {number} has {len(row)} letters, line 1 has "
                f"{len(rows[0])}; all rows must be equally long, with a letter for air"
            )
    letters = np.array([list(row) for row in rows])
    names, code_of = _coded(legend)
    codes = np.full(letters.shape, -1, dtype=np.int16)
    for letter, code in code_of.items():
        codes[letters == letter] = code
    for line, place in np.argwhere(codes < 0).tolist():
        first = f"line {line + 1}, letter {place + 1} is {str(letters[line, place])!r}"
        raise _unexplained(f"body.drawing: {first}, which", legend)
    return Picture(codes[::-1].T, names)


def _unexplained(what: str, legend: Mapping[str, str], remedy: str = "") -> SceneError:
    listed = ", ".join(f"{key!r} ({name})" for key, name in legend.items()) or "nothing"
    return SceneError(f"{what} [legend] does not explain; it explains {listed}{remedy}")


def from_image(path: str, legend: Mapping[str, str], nearest: bool = False) -> Picture:
    """Read an image: one pixel a cell, in the legend's colours, or each in the nearest of them."""
    names, code_of = _coded(legend)
    pixels = read_pixels(path, "body.image")
    packed = np.ascontiguousarray(pixels).view(np.uint32)[:, :, 0]
    codes = np.full(packed.shape, -1, dtype=np.int16)
    for colour, code in code_of.items():
        if colour == "transparent":
            codes[pixels[:, :, 3] == 0] = code
        else:
            codes[packed == np.array(_colour(colour), dtype=np.uint8).view(np.uint32)] = code
    unknown = codes < 0
    if nearest and unknown.any():
        codes[unknown] = _nearest(pixels[unknown], code_of)
    elif unknown.any():
        row, column = np.argwhere(unknown)[0].tolist()
        colour = pixels[row, column].tobytes().hex().removesuffix("ff")
        raise _unexplained(
            f"body.image: {np.count_nonzero(unknown)} pixels of {path} have a colour, first "
            f"#{colour} in row {row + 1} from the top, column {column + 1}, that",
            legend,
            ". Draw without smoothing (antialiasing), or set body.nearest_colour = true",
        )
    return Picture(codes[::-1].T, names)


def _nearest(pixels: NDArray[np.uint8], code_of: Mapping[str, int]) -> NDArray[np.int16]:
    """Return the codes of the colours nearest to pixels; what is mostly clear is "transparent"."""
    if not (names := [name for name in code_of if name != "transparent"]):
        raise SceneError("legend: has no colour, so none is the nearest")
    colours = np.array([_colour(name)[:3] for name in names], dtype=np.float32)
    distance = np.linalg.norm(pixels[:, None, :3].astype(np.float32) - colours, axis=2)
    codes = np.array([code_of[name] for name in names], dtype=np.int16)[distance.argmin(axis=1)]
    if "transparent" in code_of:
        codes[pixels[:, 3] < 128] = code_of["transparent"]
    return np.asarray(codes)


def from_array(array: NDArray[np.generic] | str, legend: Mapping[str, str]) -> Picture:
    """Take an array of whole numbers, or the ``.npy`` file that holds it."""
    if isinstance(array, str):
        array = read_array(array, "body.array")
    if array.ndim not in (2, 3) or array.size == 0:
        raise SceneError(
            f"body.array: must have cells along two or three axes, got shape {array.shape}"
        )
    check_size(array.shape, "body.array")
    if array.dtype.kind not in "iub":
        raise SceneError(f"body.array: must hold whole numbers, got {array.dtype}; round it first")
    names, code_of = _coded(legend)
    codes = np.full(array.shape, -1, dtype=np.int16)
    for key, code in code_of.items():
        if not key.lstrip("-").isdecimal():
            raise SceneError(f"legend: {key!r} is not a whole number, as the array's codes are")
        codes[array == int(key)] = code
    unknown = codes < 0
    if unknown.any():
        cell = np.argwhere(unknown)[0].tolist()
        raise _unexplained(
            f"body.array: {np.count_nonzero(unknown)} cells have a code, first "
            f"{array[tuple(cell)]} in cell {cell}, that",
            legend,
        )
    return Picture(codes, names)


def check_size(shape: tuple[int, ...], key: str) -> None:
    """Refuse to hold more than `MOST_CELLS` cells."""
    if np.prod(shape, dtype=float) > MOST_CELLS:
        raise SceneError(
            f"{key}: {' x '.join(map(str, shape))} cells are more than the {MOST_CELLS:.0e} "
            "that can be held cell by cell; describe the body by size, cells and regions, or "
            "take larger cells"
        )


def _coded(legend: Mapping[str, str]) -> tuple[tuple[str, ...], dict[str, int]]:
    code_of = {name: code for code, name in enumerate(dict.fromkeys(legend.values()))}
    check_count(len(code_of))
    return tuple(code_of), {key: code_of[name] for key, name in legend.items()}


def check_count(materials: int) -> None:
    """Refuse more materials than there are numbers for kinds of cells."""
    if materials > (most := 1 << 15):  # kinds of cells are kept in 16 bits
        raise SceneError(
            f"materials: a body has {most} at most, got {materials}; where every cell "
            "has a stiffness of its own, describe one material and solve with kaju.solve(scene, "
            "stiffness=array)"
        )


def _colour(name: str) -> tuple[int, ...]:
    from PIL import ImageColor

    try:
        return (*ImageColor.getrgb(name), 255)[:4]
    except ValueError:
        raise SceneError(
            f'legend: {name!r} is not a colour; write "#rrggbb" or a name such as "black"'
        ) from None
