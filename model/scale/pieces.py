"""Answers in pieces: each process writes its own, and each piece can be read by itself.

A result is a folder of NumPy files, one for every field of every piece, with ``result.xdmf`` that
tells ParaView where in them the numbers lie. Files are mapped into memory, so a reader takes only
what it wants. The folder gets its name when all pieces are on the disk.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from kaju import errors
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import KajuError, ParameterError, ResultError, ResultFileError, SupportError
from kaju.files import hidden_folder
from kaju.model.elastic.equal import fields
from kaju.model.results.archive import Stored, reading
from kaju.model.results.result import BodyResult, in_columns
from kaju.model.scene import Scene

if TYPE_CHECKING:
    import pandas

Answer = TypeVar("Answer")
Fields = dict[str, NDArray[Any]]

SCENE = "scene.npz"


@dataclass(frozen=True)
class Piece:
    """The answer on a box of cells."""

    lower: tuple[int, ...]  # first cell of the box
    upper: tuple[int, ...]  # behind its last
    fields: Fields
    """"nodes": displacement (m) of the cells' corners, shape (n + 1, ..., dimension). Of the cells
    "kind" (index of the material, negative where there is none), "displacement" (m) of the
    middles, shape (n, ..., dimension), "stress" (Pa), shape (n, ..., dimension, dimension)."""

    @property
    def farthest(self) -> float:
        """Largest displacement (m), of corners and middles."""
        own = self.fields["displacement"][self.fields["kind"] >= 0], self.fields["nodes"]
        sizes = [np.linalg.norm(np.nan_to_num(u), axis=-1).max(initial=0.0) for u in own]
        return float(max(sizes))


@dataclass(frozen=True)
class Whole(Stored):
    """What is stored of all pieces together."""

    kind: ClassVar[str] = "pieces"

    scene: Scene
    stage: int | None
    figures: dict[str, Any]
    boxes: list[tuple[tuple[int, ...], tuple[int, ...]]]  # first cell, and behind the last


def _figure(name: str) -> Any:
    """Return a property that is one of a result's figures."""
    return property(lambda result: float(result.figures[name]))


@dataclass(frozen=True, eq=False, repr=False)
class PiecedResult(BodyResult):
    """Linear elasticity of a scene, known piece by piece.

    During a run on several processes each knows its own piece; a stored result knows all of them
    and reads a piece when it is asked for something there. `figures` is the summary.
    """

    kind: ClassVar[str] = "elasticity in pieces"
    name: ClassVar[str] = "elasticity"
    scene: Scene
    stage: int | None
    pieces: tuple[Piece, ...]
    figures: dict[str, Any]
    comm: Any = None  # the processes, during a run

    @cached_property
    def grid(self) -> Scene:
        """The scene on the cells that were solved."""
        division = int(self.figures["subdivision"])
        return self.scene if division == 1 else self.scene.refine(division)

    def summary(self) -> dict[str, Any]:
        """Return the key figures of the whole body."""
        return dict(self.figures)

    seconds = _figure("seconds")
    """Time that the computation took (s)."""
    strain_energy = _figure("strain_energy")
    """Energy (J) stored in the whole body."""
    max_displacement = _figure("max_displacement")
    """Largest displacement (m), of corners and middles of cells."""

    @property
    def reactions(self) -> dict[str, Floats]:
        """Force (N) of each support on the body."""
        return {name: np.array(force) for name, force in self.figures["reaction"].items()}

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""
        points, cells = self.located(points)
        found = np.empty(points.shape)
        for piece, here in self._pieces_of(cells):
            local = points[here] / self.grid.lattice.cell_size - cells[here]
            inside = cells[here] - np.array(piece.lower)
            nodes = piece.fields["nodes"]
            found[here] = fields.at_nodes(nodes, inside, np.clip(local, 0.0, 1.0))
        return found

    def stress_at(self, points: Floats) -> Floats:
        """Return the stress tensor (Pa) of the cell in which each point (m) lies."""
        points, cells = self.located(points)
        d = points.shape[1]
        found = np.empty((len(points), d, d))
        for piece, here in self._pieces_of(cells):
            inside = cells[here] - np.array(piece.lower)
            found[here] = piece.fields["stress"][tuple(inside.T)]
        return found

    def _pieces_of(self, cells: Ints) -> list[tuple[Piece, Flags]]:
        inside = [np.all((cells >= p.lower) & (cells < p.upper), axis=1) for p in self.pieces]
        parted = list(zip(self.pieces, inside, strict=True))
        missing = ~np.any([here for _, here in parted], axis=0)
        if missing.any():
            cell = tuple(int(i) for i in cells[np.argmax(missing)])
            raise ResultError(
                f"points: cell {cell} belongs to another process; save the result, and read it "
                "with load_result, which knows all pieces"
            )
        return [(piece, here) for piece, here in parted if here.any()]

    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row per cell of the body in the pieces that are known here."""
        import pandas

        names = np.array([material.name for material in self.grid.cell_materials])
        lattice, frames = self.grid.lattice, []
        for piece in self.pieces:
            body = piece.fields["kind"] >= 0
            middle = lattice.centres(np.argwhere(body) + np.array(piece.lower))
            kind, moved, stress = (
                piece.fields[n][body] for n in ("kind", "displacement", "stress")
            )
            columns: dict[str, Any] = in_columns("{}", middle) | {"material": names[kind]}
            columns |= in_columns("u_{}", moved) | in_columns("stress_{}", stress)
            frames.append(pandas.DataFrame(columns))
        return pandas.concat(frames, ignore_index=True)

    def save(self, path: str | Path) -> Path:
        """Write the result to a new folder, every process its own piece; all take part."""
        target, comm = Path(path), self.comm
        if comm is None:
            raise ResultError("save: this result is stored in a folder already; copy the folder")
        first = comm.Get_rank() == 0
        with ExitStack() as stack:
            place = comm.bcast(together(comm, lambda: _hidden(stack, target) if first else None))
            together(comm, lambda: self._write_piece(place))
            boxes = comm.allgather((self.pieces[0].lower, self.pieces[0].upper))
            together(comm, lambda: self._finish(place, target, boxes) if first else None)
        return target

    def _write_piece(self, place: Path) -> None:
        rank, (piece,) = self.comm.Get_rank(), self.pieces
        for name, values in _to_file(piece).items():
            np.save(place / f"{name}-{rank:05}.npy", values)

    def _finish(self, place: Path, target: Path, boxes: list[Any]) -> None:
        """Write what all pieces have in common, and give the folder its name."""
        try:
            (place / "result.xdmf").write_text(_index(place, boxes, self.grid), encoding="utf-8")
            Whole(self.scene, self.stage, self.figures, boxes).save(place / SCENE)
            place.replace(target.resolve())  # refused where it is not empty
        except OSError as error:
            raise ResultFileError(f"{target}: cannot be written: {error}") from error

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Open a folder that `save` wrote; pieces are read when they are asked for."""
        folder = Path(path)
        folder = folder.parent if folder.is_file() else folder
        whole = Whole.load(folder / SCENE)
        with reading(folder):
            scene = whole.scene
            pieces = [_stored(folder, rank, *box) for rank, box in enumerate(whole.boxes)]
            known = len(scene.cell_materials)
            for rank, piece in enumerate(pieces):
                if piece.fields["kind"].max(initial=-1) >= known:
                    raise ResultError(f"kind of piece {rank} names none of {known} materials")
            return cls(scene, whole.stage, tuple(pieces), whole.figures)


def _hidden(stack: ExitStack, target: Path) -> Path:
    """Return a folder to write to, which goes with the stack."""
    if target.exists():
        raise ResultFileError(f"{target}: exists already; take another folder")
    return stack.enter_context(hidden_folder(target, ResultFileError))


def _to_file(piece: Piece) -> Fields:
    """Return a piece's fields as files have them: in space, the first axis running fastest."""
    d, found = len(piece.lower), {}
    for name, values in piece.fields.items():
        if d == 2:  # a plane of cells is a layer of them between two layers of corners
            values = np.stack([values] * (1 + (name == "nodes")), axis=2)
        width = [(0, 0)] * 3 + [(0, 3 - d)] * (values.ndim - 3)
        turned = np.pad(values, width).transpose(2, 1, 0, *range(3, values.ndim))
        found[name] = np.ascontiguousarray(turned)
    return found


def _stored(folder: Path, rank: int, lower: tuple[int, ...], upper: tuple[int, ...]) -> Piece:
    """Return a piece whose fields are read from the disk where they are looked at."""
    d, cells, read = len(lower), np.array([*np.subtract(upper, lower), 1][:3]), {}
    for name, parts in (("nodes", (3,)), ("displacement", (3,)), ("stress", (3, 3)), ("kind", ())):
        values = np.load(folder / f"{name}-{rank:05}.npy", mmap_mode="r", allow_pickle=False)
        if values.shape != (*(cells + (name == "nodes"))[::-1], *parts):
            raise ResultError(f"{name} of piece {rank} has the shape {values.shape}")
        turned = values.transpose(2, 1, 0, *range(3, values.ndim))
        flat = turned[:, :, 0] if d == 2 else turned
        read[name] = flat[(..., *[slice(d)] * len(parts))]
    return Piece(lower, upper, read)


def _index(folder: Path, boxes: list[Any], grid: Scene) -> str:
    """Return where the numbers of all pieces lie, in XDMF."""
    h, parts = grid.lattice.cell_size, []
    spacing = [grid.thickness if grid.lattice.dimension == 2 else h, h, h]
    described = (
        ("nodes", "displacement", "Node", "Vector"),
        ("displacement", "displacement of cells", "Cell", "Vector"),
        ("stress", "stress", "Cell", "Tensor"),
        ("kind", "kind", "Cell", "Scalar"),
    )

    def item(values: Sequence[float]) -> str:
        text = " ".join(map(repr, map(float, values)))
        return f'<DataItem Dimensions="3" Precision="8" Format="XML">{text}</DataItem>'

    for rank, (lower, _) in enumerate(boxes):
        fields, corners = "", ""
        for file, name, centre, sort in described:
            stored = np.load(folder / f"{file}-{rank:05}.npy", mmap_mode="r")
            corners = corners or " ".join(map(str, stored.shape[:3]))
            shape = (*stored.shape[:3], *[stored[0, 0, 0].size] * (stored.ndim > 3))
            number = "Int" if stored.dtype.kind == "i" else "Float"
            fields += (
                f'<Attribute Name="{name}" Center="{centre}" AttributeType="{sort}">'
                f'<DataItem Format="Binary" Endian="Little" Seek="{stored.offset}" '
                f'NumberType="{number}" Precision="{stored.itemsize}" '
                f'Dimensions="{" ".join(map(str, shape))}">{file}-{rank:05}.npy</DataItem>'
                "</Attribute>\n"
            )
        origin = [h * a for a in [*lower, 0][:3]][::-1]
        parts.append(
            f'<Grid Name="piece {rank}">\n<Topology TopologyType="3DCoRectMesh" '
            f'Dimensions="{corners}"/>\n<Geometry GeometryType="ORIGIN_DXDYDZ">{item(origin)}'
            f"{item(spacing)}</Geometry>\n{fields}</Grid>\n"
        )
    return (
        '<?xml version="1.0"?>\n<Xdmf Version="2.0"><Domain>\n<Grid Name="result" '
        f'GridType="Collection" CollectionType="Spatial">\n{"".join(parts)}</Grid>\n'
        "</Domain></Xdmf>\n"
    )


def together(comm: Any, step: Callable[[], Answer]) -> Answer:
    """Take a step without messages on all processes; if it fails on any, fail on all."""
    failure: Exception | None = None
    answer: Answer | None = None
    try:
        answer = step()
    except Exception as error:  # sent to the others, and raised below
        failure = error
    # Errors that other processes cannot rebuild travel in words.
    portable = (type(None), SupportError, errors.SceneError, ParameterError, ResultFileError)
    travels = type(failure) in portable
    failures = comm.allgather(failure if travels else f"{type(failure).__name__}: {failure}")
    first = next((rank for rank, error in enumerate(failures) if error is not None), None)
    if first is None:
        return answer  # type: ignore[return-value]
    reason = failures[first]
    if isinstance(reason, KajuError):
        raise reason
    raise errors.WorkerError(f"process {first} of {len(failures)} failed: {reason}") from failure
