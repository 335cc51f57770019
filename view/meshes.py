"""Motions as files: GLB for Blender and its like, or a series of VTK files for ParaView.

A GLB holds the body at rest and one *morph target* a frame (glTF 2.0, section 3.7.2.2): its
displacements, magnified until they can be seen. Weights that rise and fall one after the other
play the frames, with straight lines between them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Floats, Ints
from kaju.errors import ResultFileError, needing
from kaju.files import atomic_file
from kaju.model.results.mesh import CUBE_FACES

from .deformed import check_magnification, largest_shift
from .motion import Motion
from .picture_files import new_folder
from .style import SIZE
from .units import round_down

_VERTICES, _INDICES = 34962, 34963
_LINES, _TRIANGLES = 1, 4
_COMPONENTS = {"float32": 5126, "uint8": 5121, "uint32": 5125}
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


def _write_glb(
    motion: Motion, path: Path, *, fps: float, hold: float, magnification: float | None = None
) -> None:
    """Write a motion as binary glTF, its last frame held (s), its magnification in the `extras`."""
    check_magnification(magnification)
    surface, shift = _surface(motion), np.asarray(motion.moved)
    used, corners = np.unique(surface, return_inverse=True)
    factor = magnification or _visible(motion.points, shift)
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


def _visible(points: Floats, moved: NDArray[np.floating]) -> float:
    """Return by how much displacements of points are magnified: not, if they can be seen so."""
    span = float(np.ptp(points, axis=0).max())
    farthest = float(np.linalg.norm(moved, axis=2).max(initial=0.0))
    wanted = largest_shift(span) / farthest if farthest > 0.0 else 1.0
    return 1.0 if 0.3 < wanted < 1.0 or farthest == 0.0 else round_down(wanted)


def _colours(moved: Floats) -> NDArray[np.uint8]:
    """Return colours by how far the points move at the end, in linear light."""
    size = np.linalg.norm(moved, axis=1)
    seen = colormaps[SIZE](size / (size.max(initial=0.0) or 1.0))[:, :3]
    light = np.where(seen <= 0.04045, seen / 12.92, ((seen + 0.055) / 1.055) ** 2.4)
    return np.rint(255.0 * np.pad(light, [(0, 0), (0, 1)], constant_values=1.0)).astype(np.uint8)


_VTK = {2: "line", 4: "quad", 6: "polygon", 8: "hexahedron"}


def _write_series(motion: Motion, path: Path, target: Path) -> None:
    """Write true displacements (m) as a ``.vtu`` file a frame, and the ``.pvd`` that lists them."""
    with needing(f"{target}: needs meshlane: pip install 'kaju[vtk]'"):
        import meshlane

    flat = [(0, 0), (0, 3 - motion.points.shape[1])]
    points, moved = np.pad(motion.points, flat), np.asarray(motion.moved)
    cells = [(_VTK[motion.parts.shape[1]], motion.parts)]
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


def write_motion(
    motion: Motion, target: Path, fps: float, hold: float, magnification: float | None
) -> None:
    """Write a motion to a ``.glb`` or ``.pvd`` file, whole or not at all."""
    with atomic_file(target, ResultFileError) as scratch:
        if target.suffix.lower() == ".glb":
            _write_glb(motion, scratch, fps=fps, hold=hold, magnification=magnification)
        else:
            _write_series(motion, scratch, target)
