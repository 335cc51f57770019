"""Images and arrays from files, read with limits: a bad file is one clear error."""

from __future__ import annotations

import warnings
from base64 import b64decode, b64encode
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kaju.errors import SceneFileError

MOST_PIXELS = 50_000_000
"""Images above this many pixels are not read."""

MOST_CELLS = 200_000_000
"""Bodies above this many cells are never held cell by cell."""


EMBEDDED = "data:image/png;base64,"
"""What an image that a scene carries with it starts with, in place of a path (RFC 2397)."""


def embedded(dark: NDArray[np.bool_]) -> str:
    """Return a text for which `read_pixels` gives black pixels where `dark`, else white ones.

    `dark` is indexed along x from the left and along y from the bottom.
    """
    from PIL import Image

    file = BytesIO()
    grey = np.where(dark.T[::-1], 0, 255).astype(np.uint8)
    Image.fromarray(grey).save(file, "PNG")
    return EMBEDDED + b64encode(file.getvalue()).decode("ascii")


def read_pixels(path: str, key: str) -> NDArray[np.uint8]:
    """Return an image's pixels as red, green, blue and opacity, shape (height, width, 4)."""
    from PIL import Image

    source: str | BytesIO = path
    if path.startswith(EMBEDDED):
        path, source = "the embedded image", BytesIO(b64decode(path.removeprefix(EMBEDDED)))
    elif not Path(path).is_file():
        raise SceneFileError(f"{key}: there is no image {path}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(source) as image:
                if image.width * image.height > MOST_PIXELS:
                    raise SceneFileError(
                        f"{key}: {path} has {image.width} x {image.height} pixels, more than "
                        f"{MOST_PIXELS:.0e}; draw it smaller and refine the scene"
                    )
                return np.asarray(image.convert("RGBA"))
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


def read_array(path: str, key: str) -> NDArray[np.generic]:
    """Return the array in an ``.npy`` file without reading more than its head at first."""
    if not Path(path).is_file():
        raise SceneFileError(f"{key}: there is no array {path}")
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (OSError, ValueError, EOFError):
        raise SceneFileError(
            f"{key}: {path} cannot be read as an array of numbers; write it with numpy.save"
        ) from None
    if not isinstance(array, np.ndarray):
        raise SceneFileError(f"{key}: {path} holds several arrays; save one with numpy.save")
    return array
