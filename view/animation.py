"""Animations of stored runs: as pictures that move, or as meshes that move."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError, ResultFileError, brief, needing, require
from kaju.files import atomic_file, hidden_folder
from kaju.model.results.archive import answer_of
from kaju.model.results.mesh import CUBE_FACES
from kaju.model.results.result import Result
from kaju.model.scene import Scene
from kaju.result_kinds import KINDS, fetch

from .deformed import check_magnification
from .films import WRITERS, Film, evenly, ffmpeg, frames
from .motion import Motion
from .plots import check_options, pictures_of
from .section import check_word
from .style import SIZE, figure_of
from .units import visible

MOST_FRAMES = 200
"""Of longer runs evenly spaced frames are shown."""
MESHES = (".glb", ".pvd")


def animate(
    result: Any,
    path: str | Path,
    what: str | None = None,
    *,
    fps: float | None = None,
    hold: float = 3.0,
    bare: bool = False,
    magnification: float | None = None,
    **options: Any,
) -> Path:
    """Write an animation of a run: one of its pictures, over one of its options.

    Scale, magnification and camera stay the same from the first frame to the last.

    Parameters
    ----------
    result : Result, model or path
        Of a model, a solver, or `kaju.creep`; a model shows what it has done so far, and one
        that has not begun is run.
    path : path
        The ending decides: ``.gif``, ``.webp`` or ``.mp4`` are films; a name without ending is
        a folder of pictures without background (PNG with alpha), one a frame; ``.glb`` is a
        mesh with one morph target a frame, for Blender; ``.pvd`` is a list of VTK files in a
        folder beside it, for ParaView.
    what : str, optional
        One of the result's `films`, the first of them unless given: such as "generations",
        "stages", "loading", "gaps" (generations coloured by the gap between the agents' two
        opinions), "waves", "increments", "breaks", "steps", "times" or "curves".
    fps : float, optional
        Frames per second, up to 50; unless given 25 of what moves in time, 2 of steps.
    hold : float
        For how long the last frame stays (s).
    bare : bool
        Leave out axes, words and scales; of pictures only.
    magnification : float, optional
        How many times larger than true a ``.glb`` shows displacements. Unless given, a round
        number that makes them visible, or 1; it is stated in the file.
    **options
        Those of the picture, as for `plot`.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ParameterError
        If there is no such animation, or it has no such option, or the ending or a number is out
        of its rule.
    MissingExtraError
        If an MP4 is asked for and there is no ffmpeg, or a series and there is no meshlane.
    ResultFileError
        If the file cannot be written, or the folder is there already.

    Examples
    --------
    >>> import kaju
    >>> answer = kaju.solve(kaju.load_scene("plate.toml"), tolerance=0.5)
    >>> kaju.animate(answer, "agents.gif").name
    'agents.gif'
    """
    told = "path: the name of a film comes second, after what it shows, as in animate(result, "
    require(isinstance(path, str | PathLike), f"{told}'film.gif'); got {brief(path)}")
    target = Path(path)
    ending = target.suffix.lower()
    _check(target, ending, fps, hold)
    if getattr(result, "steps", None) == 0 and hasattr(result, "run"):
        result = result.run()
    result = answer_of(result)
    if isinstance(result, Scene):
        raise ParameterError(
            "result: a Scene has no film yet; run it first, kaju.animate(LoadModel(scene).run(), "
            f"{str(target)!r}), or solve it"
        )
    if not isinstance(result, Result):
        raise ParameterError(f"result: an answer of kaju is needed, got {type(result).__name__}")
    kind = KINDS[result.kind]
    if ending in MESHES:
        motion = _chosen(kind.meshes, what)(result)
        with atomic_file(target, ResultFileError) as scratch:
            if ending == ".glb":
                _write_glb(motion, scratch, fps or 2.0, hold, magnification)
            else:
                _write_series(motion, scratch, target)
        return target
    known = {name: kind.films.get(name, "view.agents:GENERATIONS") for name in result.films}
    film: Film = _chosen(known, what)
    if what is not None and what not in kind.films:  # what agents of your own know
        film = film._replace(picture=what)
    picture = pictures_of(result)[film.picture]
    check_options(film.picture, picture, options)
    if magnification is not None:
        options["magnification"] = magnification
    options = film.fixed(result, options) | options

    def draw(moment: Any) -> Figure:
        drawn = picture(result, **options, **{film.option: moment})
        return drawn if isinstance(drawn, Figure) else figure_of(drawn)

    every = film.moments(result)
    moments = [every[k] for k in evenly(len(every), MOST_FRAMES)]
    if not ending:
        with new_folder(target) as folder:
            for number, image in enumerate(frames(draw, moments, bare=bare, mode="RGBA")):
                image.save(folder / f"{number:04d}.png")
        return target
    with atomic_file(target, ResultFileError) as scratch:
        WRITERS[ending](frames(draw, moments, bare=bare), scratch, fps or film.fps, hold)
    return target


def _check(target: Path, ending: str, fps: float | None, hold: float) -> None:
    endings = (*WRITERS, *MESHES)
    if ending and ending not in endings:
        raise ParameterError(
            f"{target}: an animation ends in {', '.join(endings)}, or in nothing (a folder of "
            f"pictures), not in {ending!r}"
        )
    if fps is not None and not (isfinite(fps) and 0.0 < fps <= 50.0):
        raise ParameterError(f"fps: a number above 0 and up to 50 is needed, got {fps}")
    require(isfinite(hold) and hold >= 0.0, f"hold: a time from 0 s upwards is needed, got {hold}")
    if ending == ".mp4":
        ffmpeg(target)


@contextmanager
def new_folder(target: Path) -> Iterator[Path]:
    """Yield a folder to fill, which takes the target's name only if all goes well."""
    if target.exists() and not (target.is_dir() and not any(target.iterdir())):
        raise ResultFileError(f"{target}: is there already; take another name, or remove it")
    with hidden_folder(target, ResultFileError) as scratch:
        yield scratch
        scratch.replace(target.resolve())  # refused where it is not empty


def _chosen(known: Mapping[str, str], what: str | None) -> Any:
    name = next(iter(known), "mesh") if what is None else what
    check_word("what", name, known)
    return fetch(known[name])


_VERTICES, _INDICES = 34962, 34963
_LINES, _TRIANGLES = 1, 4
_COMPONENTS = {"float32": 5126, "uint8": 5121, "uint32": 5125}
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


def _write_glb(
    motion: Motion, path: Path, fps: float, hold: float, magnification: float | None
) -> None:
    """Write a motion as binary glTF, its last frame held (s), its magnification in the `extras`."""
    check_magnification(magnification)
    surface, shift = _surface(motion), np.asarray(motion.moved)
    used, corners = np.unique(surface, return_inverse=True)
    span, farthest = np.ptp(motion.points, axis=0).max(), np.linalg.norm(shift, axis=2).max()
    factor = magnification or visible(float(span), float(farthest))
    moved = [_upright(factor * frame[used]) for frame in shift]
    glb = _Buffer()
    primitive = {
        "indices": glb.add(corners.ravel().astype(np.uint32)[:, None], _INDICES),
        "attributes": {
            "POSITION": glb.add_bounded(_upright(motion.points[used]), _VERTICES),
            "COLOR_0": glb.add(_colours(shift[-1, used]), _VERTICES, normalized=True),
        },
        "material": 0,
        "mode": _LINES if surface.shape[1] == 2 else _TRIANGLES,
        "targets": [{"POSITION": glb.add_bounded(move, _VERTICES)} for move in moved[1:]],
    }
    # The weight of each frame's target rises to 1 at its time, and falls until the next one's.
    times, weights = np.arange(len(moved)) / fps, np.eye(len(moved))[:, 1:]
    if hold > 0.0:
        times, weights = np.append(times, times[-1] + hold), np.vstack([weights, weights[-1]])
    keys = glb.add_bounded(times.astype(np.float32)[:, None])
    values = glb.add(weights.astype(np.float32).reshape(-1, 1))
    sampler = {"input": keys, "output": values, "interpolation": "LINEAR"}
    channel = {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    extras = {"magnification": factor, "unit": "m"}
    mesh = {
        "primitives": [primitive],
        "weights": [0.0] * (len(moved) - 1),
        "extras": {"targetNames": [f"frame {k}" for k in range(1, len(moved))]},
    }
    matte = {"metallicFactor": 0.0, "roughnessFactor": 0.9}
    about = {
        "asset": {"version": "2.0", "generator": f"kaju {__version__}", "extras": extras},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "body"}],
        "meshes": [mesh],
        "materials": [{"name": "displacement", "doubleSided": True, "pbrMetallicRoughness": matte}],
        "animations": [{"channels": [channel], "samplers": [sampler]}],
        "buffers": [{"byteLength": len(glb.data)}],
        "bufferViews": glb.views,
        "accessors": glb.accessors,
    }
    text = json.dumps(about, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    parts = b"".join(
        len(part).to_bytes(4, "little") + name + part
        for name, part in ((b"JSON", text), (b"BIN\0", bytes(glb.data)))
    )
    head = b"glTF" + (2).to_bytes(4, "little") + (12 + len(parts)).to_bytes(4, "little")
    path.write_bytes(head + parts)


class _Buffer:
    """The binary part of a GLB, and the tables of what lies where."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, array: NDArray[Any], target: int | None = None, **more: Any) -> int:
        """Add rows of numbers of 8 or 32 bits; return the number of their accessor."""
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes}
        self.views.append(view if target is None else view | {"target": target})
        self.data += array.tobytes() + bytes(-array.nbytes % 4)
        accessor = {
            "bufferView": len(self.views) - 1,
            "componentType": _COMPONENTS[array.dtype.name],
            "count": len(array),
            "type": _TYPES[array.shape[1]],
        }
        self.accessors.append(accessor | more)
        return len(self.accessors) - 1

    def add_bounded(self, array: NDArray[Any], target: int | None = None) -> int:
        """Add rows of numbers with the least and the largest of each column."""
        bounds = {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        return self.add(array, target, **bounds)


def _surface(motion: Motion) -> Ints:
    """Return springs as they are, and all else as triangles that can be seen from outside."""
    parts = motion.parts.astype(np.int64)
    if parts.shape[1] == 2:
        return parts
    if parts.shape[1] == 8:
        faces = parts[:, CUBE_FACES].reshape(-1, 4)
        _, number, count = np.unique(
            np.sort(faces, axis=1), axis=0, return_inverse=True, return_counts=True
        )
        parts = faces[count[number.ravel()] == 1]
    fans = [parts[:, [0, k, k + 1]] for k in range(1, parts.shape[1] - 1)]
    return np.concatenate(fans)


def _upright(points: Floats) -> NDArray[np.float32]:
    """Return points with y upwards, as glTF wants them: z of a body in space is its height."""
    if points.shape[1] == 2:
        found = np.pad(points, [(0, 0), (0, 1)])
    else:
        found = np.stack([points[:, 0], points[:, 2], -points[:, 1]], axis=1)
    return found.astype(np.float32)


def _colours(moved: Floats) -> NDArray[np.uint8]:
    """Return colours by how far the points move at the end, in linear light."""
    size = np.linalg.norm(moved, axis=1)
    seen = colormaps[SIZE](size / (size.max(initial=0.0) or 1.0))[:, :3]
    light = np.where(seen <= 0.04045, seen / 12.92, ((seen + 0.055) / 1.055) ** 2.4)
    return np.rint(255.0 * np.pad(light, [(0, 0), (0, 1)], constant_values=1.0)).astype(np.uint8)


def _write_series(motion: Motion, path: Path, target: Path) -> None:
    """Write true displacements (m) as a ``.vtu`` file a frame, and the ``.pvd`` that lists them."""
    with needing(f"{target}: needs meshlane: pip install 'kaju[vtk]'"):
        import meshlane

    flat = [(0, 0), (0, 3 - motion.points.shape[1])]
    points, moved = np.pad(motion.points, flat), np.asarray(motion.moved)
    kinds = {2: "line", 4: "quad", 6: "polygon", 8: "hexahedron"}
    cells = [(kinds[motion.parts.shape[1]], motion.parts)]
    lines = ['<?xml version="1.0"?>']
    lines += ['<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">']
    lines += ["  <Collection>"]
    with new_folder(target.with_suffix("")) as folder:
        for number, (time, shift) in enumerate(zip(motion.at, moved, strict=True)):
            name = f"{target.stem}_{number:04d}.vtu"
            values = {of: [column[number]] for of, (_, column) in motion.values.items()}
            shown = {"displacement": np.pad(shift, flat)}
            meshlane.Mesh(points, cells, shown, values).write(folder / name)
            file = quoteattr(f"{target.stem}/{name}")
            lines.append(f'    <DataSet timestep="{float(time)!r}" part="0" file={file}/>')
    path.write_text("\n".join([*lines, "  </Collection>", "</VTKFile>", ""]))
