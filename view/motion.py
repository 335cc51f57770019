"""A stored run as a mesh in motion, for Blender, ParaView and their like.

Points stay the same from frame to frame, so that a moving body is its rest form and one
displacement field a frame. Files of it are GLB, for Blender and its like, or a series of VTK files
for ParaView. A GLB holds the body at rest and one *morph target* a frame (glTF 2.0, section
3.7.2.2): its displacements, magnified until they can be seen. Weights that rise and fall one after
the other play the frames, with straight lines between them.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Floats, Ints
from kaju.errors import ResultFileError, needing
from kaju.files import atomic_file
from kaju.model.results.mesh import CUBE_FACES, corner_order
from kaju.model.results.result import BodyResult
from kaju.model.transfer.transfer_result import TransferResult

from .deformed import Joined, check_magnification, join, largest_shift
from .picture_files import new_folder
from .style import SIZE
from .units import round_down

if TYPE_CHECKING:
    from kaju.model.elastic.elastic_result import ElasticResult
    from kaju.model.network.network_result import NetworkResult
    from kaju.model.rheology.creeping_elastic import ElasticCreepResult
    from kaju.model.rheology.creeping_elements import TransferCreepResult
    from kaju.model.rheology.creeping_network import NetworkCreepResult


class Frame(NamedTuple):
    """A moment of a motion."""

    time: float  # its number, or time (s)
    moved: Floats  # displacements of the points (m); shape (n, dimension)
    values: dict[str, Floats]  # of the parts


@dataclass(frozen=True, eq=False)
class Motion:
    """Points, what they are the corners of, and where they are in every frame."""

    points: Floats  # places at rest (m); shape (n, dimension)
    parts: Ints
    """Corners of springs (2), triangles (3), squares (4) or hexagons (6) in turn, or of cubes (8,
    as VTK has them). Shape (parts, corners)."""
    frames: Sequence[Frame]  # from rest to the end

    @property
    def farthest(self) -> float:
        """Largest displacement of all frames (m)."""
        return max(
            float(np.linalg.norm(frame.moved, axis=1).max(initial=0.0)) for frame in self.frames
        )


def _body(result: BodyResult) -> tuple[Joined, Ints]:
    """Return the cells of a result's grid, and where they are."""
    lattice = result.grid.lattice
    cells = np.argwhere(result.grid.rasterise() >= 0)
    if lattice.boxes:
        forms = lattice.cell_size * (corner_order(lattice.dimension) - 0.5)[None]
    else:
        forms = np.stack([lattice.outline(form) for form in range(lattice.forms)])
    corners = lattice.centres(cells)[:, None] + forms[lattice.form(cells)]
    return join(corners, np.diag(lattice.pitch)), cells


def _on(cells: Ints, shape: tuple[int, ...], where: Ints, values: Floats) -> Floats:
    """Spread the values of some cells over all, 0 elsewhere."""
    field = np.zeros(shape)
    field[tuple(where.T)] = values
    return np.asarray(field[tuple(cells.T)])


def so_far(result: TransferResult, generation: int) -> TransferResult:
    """Return a run with what its last stage had taken up to a generation."""
    stage = result.last
    history = stage.history
    then = history.generation <= generation
    taken = np.zeros_like(stage.taken)
    np.add.at(taken, (history.agent[then], history.direction[then]), history.load[then])
    # What deforms a cell grows with the loads along each axis, pulls counted against pushes.
    axis = result.scene.lattice.axis_of[history.direction]
    load = np.where(history.pull, -history.load, history.load)
    grown, whole = np.zeros_like(stage.kept), np.zeros_like(stage.kept)
    np.add.at(whole, (history.agent, axis), load)
    np.add.at(grown, (history.agent[then], axis[then]), load[then])
    share = np.divide(grown, whole, out=np.zeros_like(grown), where=whole != 0.0)
    deforming = {n: share * getattr(stage, n) for n in ("kept", "shortened", "widened")}
    return replace(result, stages=(*result.stages[:-1], replace(stage, taken=taken, **deforming)))


def generations(result: TransferResult) -> Motion:
    """Return the last stage of a run, generation by generation."""
    states = [so_far(result, number) for number in range(result.last.generations + 1)]
    return _transfer(result, states)


def stages(result: TransferResult) -> Motion:
    """Return a run at rest, and at the end of every stage of loading."""
    ended = [result.at_stage(number) for number in range(1, len(result.stages) + 1)]
    return _transfer(result, [so_far(ended[0], 0), *ended])


def _transfer(result: TransferResult, states: Sequence[TransferResult]) -> Motion:
    body, cells = _body(result)
    shape = result.scene.lattice.shape
    frames = []
    for number, state in enumerate(states):
        taken = _on(cells, shape, state.last.cells, state.last.taken.sum(axis=1))
        frames.append(Frame(number, body.moved(state.displacement_at), {"load_taken": taken}))
    return Motion(body.points, body.parts, frames)


def loaded(result: ElasticResult) -> Motion:
    """Return an elastic body at rest and under its load."""
    d = result.lower.shape[1]
    places = result.lower[:, None] + result.size[:, None, None] * corner_order(d)
    body = join(places, np.full(d, result.size.min()))
    values = {"von_mises": result.von_mises, "level": result.level.astype(np.float64)}
    moved = body.moved(result.displacement_at)
    rest = Frame(0.0, np.zeros_like(moved), {name: np.zeros_like(v) for name, v in values.items()})
    return Motion(body.points, body.parts, [rest, Frame(1.0, moved, values)])


def increments(result: NetworkResult) -> Motion:
    """Return the states of a spring network along its load path."""
    return _springs(result, result.stage)


def _springs(result: NetworkResult, times: Floats) -> Motion:
    frames = [
        Frame(float(time), moved, {"tension": tension})
        for time, moved, tension in zip(times, result.displacement, result.tension, strict=True)
    ]
    return Motion(result.network.positions, result.network.springs, frames)


def network_times(result: NetworkCreepResult) -> Motion:
    """Return a spring network in time."""
    return _springs(result.to_network_result(), result.times)


def times(result: TransferCreepResult | ElasticCreepResult) -> Motion:
    """Return a creeping body, one frame a time asked for."""
    body, _ = _body(result.static)
    frames = [
        Frame(float(time), body.moved(lambda at, k=k: result.displacement_at(at, k)), {})  # type: ignore[misc]
        for k, time in enumerate(result.times)
    ]
    return Motion(body.points, body.parts, frames)


_VERTICES, _INDICES = 34962, 34963
_LINES, _TRIANGLES = 1, 4
_COMPONENTS = {"float32": 5126, "uint8": 5121, "uint32": 5125}
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


def _write_glb(
    motion: Motion, path: Path, *, fps: float, hold: float, magnification: float | None = None
) -> None:
    """Write a motion as binary glTF, its last frame held (s), its magnification in the `extras`."""
    check_magnification(magnification)
    surface = _surface(motion)
    used, corners = np.unique(surface, return_inverse=True)
    factor = magnification or _visible(motion)
    moved = [_upright(factor * frame.moved[used]) for frame in motion.frames]
    glb = _Buffer()
    primitive = {
        "indices": glb.add(corners.ravel().astype(np.uint32)[:, None], _INDICES),
        "attributes": {
            "POSITION": glb.add_bounded(_upright(motion.points[used]), _VERTICES),
            "COLOR_0": glb.add(_colours(motion.frames[-1].moved[used]), _VERTICES, normalized=True),
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
    parts = motion.parts
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


def _visible(motion: Motion) -> float:
    span = float(np.ptp(motion.points, axis=0).max())
    farthest = motion.farthest
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
    points = np.pad(motion.points, flat)
    cells = [(_VTK[motion.parts.shape[1]], motion.parts)]
    lines = ['<?xml version="1.0"?>']
    lines += ['<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">']
    lines += ["  <Collection>"]
    with new_folder(target.with_suffix("")) as folder:
        for number, frame in enumerate(motion.frames):
            name = f"{target.stem}_{number:04d}.vtu"
            moved = {"displacement": np.pad(frame.moved, flat)}
            values = {label: [column] for label, column in frame.values.items()}
            meshlane.Mesh(points, cells, moved, values).write(folder / name)
            file = quoteattr(f"{target.stem}/{name}")
            lines.append(f'    <DataSet timestep="{frame.time!r}" part="0" file={file}/>')
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
