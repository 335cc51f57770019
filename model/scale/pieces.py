"""Answers in pieces: each process writes its own, and each piece can be read by itself.

A result is a folder of VTK image files, one a piece, with ``result.pvti`` that names them; ParaView
reads it as it is. Data lie raw behind the header of each file, so a reader takes only what it
wants. The folder gets its name when all pieces are on the disk.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar
from xml.etree import ElementTree
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import (
    KajuError,
    ParameterError,
    ResultError,
    ResultFileError,
    SceneError,
    SupportError,
    WorkerError,
)
from kaju.files import file_to_read, hidden_folder, move_into_place
from kaju.model.elastic.equal import fields
from kaju.model.elastic.equal.staggered import axis_pairs
from kaju.model.results.archive import Archive, open_archive, reading, write_archive
from kaju.model.results.result import BodyResult, cells_of_points
from kaju.model.scene import Scene

if TYPE_CHECKING:
    import pandas

Answer = TypeVar("Answer")
Fields = dict[str, NDArray[Any]]

INDEX = "result.pvti"
SUMMARY = "summary.json"
SCENE = "scene.npz"
FIGURES: dict[str, Any] = {
    "seconds": float,
    "subdivision": int,
    "strain_energy": float,
    "error_estimate": float,
    "iterations": int,
    "max_displacement": float,
    "reaction": dict[str, list[float]],
}
"""What the summary must tell, and in which form."""
_TYPES = {"Float64": "<f8", "Int32": "<i4"}
_HEADER = b'<AppendedData encoding="raw">\n_'


@dataclass(frozen=True)
class Piece:
    """The answer on a box of cells."""

    lower: tuple[int, ...]  # first cell of the box
    upper: tuple[int, ...]  # behind its last
    nodes: Fields  # "displacement" (m) at the cells' corners, shape (n + 1, ..., dimension)
    cells: Fields
    """"kind" (index of the material, negative where there is none), "displacement" (m) of the
    middles, shape (n, ..., dimension), "stress" (Pa), shape (n, ..., dimension, dimension)."""

    def holds(self, cells: Ints) -> Flags:
        """Tell which cells lie in the piece."""
        return np.asarray(np.all((cells >= self.lower) & (cells < self.upper), axis=1))


class StoredPiece(Piece):
    """A piece whose arrays are read when they are asked for, and not kept."""

    def __init__(self, path: Path, grid: Scene) -> None:
        header, _ = _opened_file(path)
        extent = _extent(header.find("ImageData/Piece"), path)
        shape = grid.lattice.shape
        ends = [(extent[2 * a], extent[2 * a + 1]) for a in range(len(shape))]
        if not all(0 <= low < high <= n for (low, high), n in zip(ends, shape, strict=True)):
            raise ResultFileError(f"{path}: holds cells that are not the body's: {ends}")
        object.__setattr__(self, "path", path)
        object.__setattr__(self, "lower", tuple(low for low, _ in ends))
        object.__setattr__(self, "upper", tuple(high for _, high in ends))
        object.__setattr__(self, "materials", len(grid.cell_materials))

    path: Path
    materials: int

    @property
    def nodes(self) -> Fields:
        """The fields at the corners, read from the file."""
        shape = tuple(b - a + 1 for a, b in zip(self.lower, self.upper, strict=True))
        with reading(self.path):
            return {"displacement": self._vector("PointData", "displacement", shape)}

    @property
    def cells(self) -> Fields:
        """The fields of the cells, read from the file."""
        shape = tuple(b - a for a, b in zip(self.lower, self.upper, strict=True))
        d = len(shape)
        with reading(self.path):
            read = _read(self.path, "CellData")
            stress = np.empty((*shape, d, d))
            for a in range(d):
                stress[..., a, a] = _shaped(read["stress_" + 2 * "xyz"[a]], shape)
            for a, b in axis_pairs(d):
                stress[..., a, b] = _shaped(read[f"stress_{'xyz'[a]}{'xyz'[b]}"], shape)
                stress[..., b, a] = stress[..., a, b]
            if read["kind"].max() >= self.materials:
                raise ResultError("it holds materials that the scene does not have")
            return {
                "kind": _shaped(read["kind"], shape),
                "displacement": self._vector("CellData", "displacement", shape),
                "stress": stress,
            }

    def _vector(self, kind: str, name: str, shape: tuple[int, ...]) -> Floats:
        values = _read(self.path, kind)[name].reshape(-1, 3)[:, : len(shape)]
        return np.stack([_shaped(column, shape) for column in values.T], axis=-1)


class PiecedResult(BodyResult):
    """Linear elasticity of a scene, known piece by piece.

    During a run on several processes each knows its own piece; a stored result knows all of them
    and reads a piece when it is asked for something there. `figures` is the summary.
    """

    kind: ClassVar[str] = "elasticity in pieces"
    name: ClassVar[str] = "elasticity"

    def __init__(
        self,
        scene: Scene,
        grid: Scene,
        stage: int | None,
        pieces: Sequence[Piece],
        figures: dict[str, Any],
        comm: Any = None,
    ) -> None:
        self.scene = scene
        self._grid = grid
        self.stage = stage  # type: ignore[misc]
        self.pieces = tuple(pieces)
        self.figures = figures
        self.seconds = float(figures["seconds"])
        self._comm = comm

    @property
    def grid(self) -> Scene:
        """The scene on the cells that were solved."""
        return self._grid

    @classmethod
    def of_processes(
        cls,
        scene: Scene,
        grid: Scene,
        stage: int | None,
        piece: Piece,
        borne: dict[str, Floats],
        figures: dict[str, Any],
        comm: Any,
    ) -> Self:
        """Return the answer of which this process has a piece; `borne`: what supports bear (N)."""
        reaction: dict[str, Floats] = {}
        for part in comm.allgather(borne):
            for name, force in part.items():
                reaction[name] = reaction.get(name, 0.0) + force
        body = piece.cells["kind"] >= 0
        moved = np.linalg.norm(piece.cells["displacement"][body], axis=-1)
        whole = figures | {
            "reaction": {name: force.tolist() for name, force in sorted(reaction.items())},
            "max_displacement": max(comm.allgather(float(moved.max(initial=0.0)))),
            "agents": sum(comm.allgather(int(np.count_nonzero(body)))),
            "processes": comm.Get_size(),
            "seconds": max(comm.allgather(figures["seconds"])),
            "kaju_version": __version__,
        }
        return cls(scene, grid, stage, [piece], whole, comm)

    def summary(self) -> dict[str, Any]:
        """Return the key figures of the whole body."""
        return dict(self.figures)

    @property
    def strain_energy(self) -> float:
        """Energy (J) stored in the whole body."""
        return float(self.figures["strain_energy"])

    @property
    def iterations(self) -> int:
        """Number of iterations."""
        return int(self.figures["iterations"])

    @property
    def error_estimate(self) -> float:
        """Estimated error in the energy norm, relative to the solution."""
        return float(self.figures["error_estimate"])

    @property
    def max_displacement(self) -> float:
        """Largest displacement of a cell's middle (m)."""
        return float(self.figures["max_displacement"])

    @cached_property
    def reactions(self) -> dict[str, Floats]:
        """Force (N) of each support on the body."""
        return {name: np.array(force) for name, force in self.figures["reaction"].items()}

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""
        points, cells = cells_of_points(self.grid, points)
        found = np.empty(points.shape)
        for piece, here in self._pieces_of(cells):
            local = points[here] / self.grid.lattice.cell_size - cells[here]
            inside = cells[here] - np.array(piece.lower)
            nodes = piece.nodes["displacement"]
            found[here] = fields.at_nodes(nodes, inside, np.clip(local, 0.0, 1.0))
        return found

    def stress_at(self, points: Floats) -> Floats:
        """Return the stress tensor (Pa) of the cell in which each point (m) lies."""
        points, cells = cells_of_points(self.grid, points)
        d = points.shape[1]
        found = np.empty((len(points), d, d))
        for piece, here in self._pieces_of(cells):
            inside = cells[here] - np.array(piece.lower)
            found[here] = piece.cells["stress"][tuple(inside.T)]
        return found

    def _pieces_of(self, cells: Ints) -> list[tuple[Piece, Flags]]:
        parted = [(piece, piece.holds(cells)) for piece in self.pieces]
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

        d = self.grid.lattice.dimension
        frames = []
        for piece in self.pieces:
            fields = piece.cells
            place = np.argwhere(fields["kind"] >= 0)
            at = tuple(place.T)
            centre = (place + np.array(piece.lower) + 0.5) * self.grid.lattice.cell_size
            columns: dict[str, Any] = {"xyz"[a]: centre[:, a] for a in range(d)}
            names = np.array([material.name for material in self.grid.cell_materials])
            columns["material"] = names[fields["kind"][at]]
            for a in range(d):
                columns[f"u_{'xyz'[a]}"] = fields["displacement"][at][:, a]
            for a in range(d):
                for b in range(a, d):
                    columns[f"stress_{'xyz'[a]}{'xyz'[b]}"] = fields["stress"][at][:, a, b]
            frames.append(pandas.DataFrame(columns))
        return pandas.concat(frames, ignore_index=True)

    def save(self, path: str | Path) -> Path:
        """Write the result to a new folder, every process its own piece; all take part."""
        target, comm = Path(path), self._comm
        if comm is None:
            raise ResultError("save: a stored result is a folder already; copy that")
        first = comm.Get_rank() == 0
        hidden = None
        holder = hidden_folder(target, ResultFileError) if first else None
        try:
            hidden = together(comm, lambda: holder and _entered(holder, target))
            place = Path(comm.bcast(str(hidden)))
            together(comm, lambda: self._write_piece(place))
            together(comm, lambda: self._finish(place, target) if first else None)
        finally:
            if holder is not None and hidden is not None:
                holder.__exit__(None, None, None)
        return target

    def _write_piece(self, place: Path) -> None:
        rank = self._comm.Get_rank()
        (piece,) = self.pieces
        _write(place / f"piece-{rank:05}.vti", piece, self.grid)

    def _finish(self, place: Path, target: Path) -> None:
        try:
            pieces = sorted(place.glob("piece-*.vti"))
            (place / INDEX).write_bytes(_index(pieces, self.grid))
            text, arrays = self.scene.to_archive()
            summary = json.dumps(self.figures, indent=2, allow_nan=False)
            (place / SUMMARY).write_text(summary + "\n", encoding="utf-8")
            about = {"scene": text, "stage": self.stage, "files": _checksums(place)}
            write_archive(place / SCENE, "pieces", arrays, about)
            move_into_place(place, target)
        except OSError as error:
            raise ResultFileError(f"{target}: cannot be written: {error}") from error

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Open a folder that `save` wrote; pieces are read when they are asked for."""
        folder = Path(path)
        folder = folder.parent if folder.is_file() else folder
        archive = open_archive(folder / SCENE, "pieces")
        with reading(folder):
            if "files" in archive.about and archive.value("files", dict[str, int]) != _checksums(
                folder
            ):
                raise ResultError("its files are not those that were saved")
            scene = Scene.from_archive(archive.value("scene", str), archive.arrays)
            summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
            figures = Archive(folder / SUMMARY, {}, summary)
            for name, form in FIGURES.items():
                figures.value(name, form)
            index = ElementTree.parse(folder / INDEX)  # noqa: S314 (our own, refused if odd)
            division = summary["subdivision"]
            if not 1 <= division <= 1 << 20:
                raise ResultError("subdivision must be 1 or more")
            grid = scene if division == 1 else scene.refine(division)
            names = [part.attrib["Source"] for part in index.iter("Piece")]
            pieces = [StoredPiece(folder / Path(name).name, grid) for name in names]
            return cls(scene, grid, archive.value("stage", int | None), pieces, summary)


def _entered(holder: Any, target: Path) -> Path:
    if target.exists():
        raise ResultFileError(f"{target}: exists already; take another folder")
    return Path(holder.__enter__())


def _write(path: Path, piece: Piece, grid: Scene) -> None:
    """Write one piece as VTK image data, raw."""
    d, cells = len(piece.lower), piece.cells
    points = {"displacement": _three(piece.nodes["displacement"])}
    fields: Fields = {
        "kind": cells["kind"].ravel(order="F").astype("<i4"),
        "displacement": _three(cells["displacement"]),
    }
    for a in range(d):
        for b in range(a, d):
            values = cells["stress"][..., a, b].ravel(order="F").astype("<f8")
            fields[f"stress_{'xyz'[a]}{'xyz'[b]}"] = values
    extent = _text_of(piece.lower, piece.upper)
    blocks, described = [], {}
    offset = 0
    for kind, group in (("PointData", points), ("CellData", fields)):
        lines = []
        for name, values in group.items():
            number = "Int32" if values.dtype.kind == "i" else "Float64"
            parts = 3 if values.ndim == 2 else 1
            checksum = crc32(np.ascontiguousarray(values).data)
            lines.append(
                f'<DataArray type="{number}" Name="{name}" NumberOfComponents="{parts}" '
                f'format="appended" offset="{offset}" crc32="{checksum}"/>'
            )
            blocks.append(values)
            offset += 8 + values.nbytes
        described[kind] = f"<{kind}>{''.join(lines)}</{kind}>"
    header = (
        f'<?xml version="1.0"?>\n<VTKFile type="ImageData" version="1.0" '
        f'byte_order="LittleEndian" header_type="UInt64">\n<ImageData WholeExtent="{extent}" '
        f'{_spacing(grid)}>\n<Piece Extent="{extent}">\n{described["PointData"]}\n'
        f"{described['CellData']}\n</Piece>\n</ImageData>\n"
    )
    try:
        with path.open("xb") as file:
            file.write(header.encode() + _HEADER)
            for values in blocks:
                file.write(np.array(values.nbytes, dtype="<u8").tobytes())
                file.write(np.ascontiguousarray(values).tobytes())
            file.write(b"\n</AppendedData>\n</VTKFile>\n")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise ResultFileError(f"{path}: cannot be written: {error.strerror}") from error


def _index(pieces: list[Path], grid: Scene) -> bytes:
    headers = [_opened_file(path)[0] for path in pieces]
    extents = [_extent(h.find("ImageData/Piece"), p) for h, p in zip(headers, pieces, strict=True)]
    whole = [(min if k % 2 == 0 else max)(extent[k] for extent in extents) for k in range(6)]
    arrays = headers[0].find("ImageData/Piece")
    assert arrays is not None
    lines = []
    for kind in ("PointData", "CellData"):
        group = arrays.find(kind)
        assert group is not None
        for item in group:
            item.attrib.pop("format")
            item.attrib.pop("offset")
            item.attrib.pop("crc32")
            item.tag = "PDataArray"
        lines.append(
            f"<P{kind}>{''.join(ElementTree.tostring(i, 'unicode') for i in group)}</P{kind}>"
        )
    named = "\n".join(
        f'<Piece Extent="{" ".join(map(str, extent))}" Source="{path.name}"/>'
        for extent, path in zip(extents, pieces, strict=True)
    )
    return (
        f'<?xml version="1.0"?>\n<VTKFile type="PImageData" version="1.0" '
        f'byte_order="LittleEndian" header_type="UInt64">\n<PImageData WholeExtent="'
        f'{" ".join(map(str, whole))}" GhostLevel="0" {_spacing(grid)}>\n{"".join(lines)}\n'
        f"{named}\n</PImageData>\n</VTKFile>\n"
    ).encode()


def _three(values: Floats) -> Floats:
    """Return vectors as VTK has them: three components, the first axis running fastest."""
    d = values.shape[-1]
    columns = [values[..., a].ravel(order="F") for a in range(d)]
    columns += [np.zeros_like(columns[0])] * (3 - d)
    return np.stack(columns, axis=-1).astype("<f8")


def _text_of(lower: tuple[int, ...], upper: tuple[int, ...]) -> str:
    ends = [*zip(lower, upper, strict=True), (0, 0)][:3]
    return " ".join(f"{a} {b}" for a, b in ends)


def _spacing(grid: Scene) -> str:
    h = repr(grid.lattice.cell_size)
    return f'Origin="0 0 0" Spacing="{h} {h} {h}"'


def _checksums(folder: Path) -> dict[str, int]:
    """Return checksums of index, summary and the pieces' headers, which hold those of the rest."""
    found = {}
    for path in sorted(folder.glob("*")):
        if path.name in (INDEX, SUMMARY):
            found[path.name] = crc32(file_to_read(path, ResultFileError).read_bytes())
        elif path.suffix == ".vti":
            with file_to_read(path, ResultFileError).open("rb") as file:
                found[path.name] = crc32(file.read(1 << 16).partition(_HEADER)[0])
    return found


def _opened_file(path: Path) -> tuple[ElementTree.Element, int]:
    """Return the header of a piece, and where its data begin."""
    try:
        with file_to_read(path, ResultFileError).open("rb") as file:
            start = file.read(1 << 16)
        length = start.index(_HEADER)
        return ElementTree.fromstring(start[:length] + b"</VTKFile>"), length + len(_HEADER)  # noqa: S314
    except (OSError, ValueError, ElementTree.ParseError) as error:
        raise ResultFileError(f"{path}: is no piece of a result: {error}") from error


def _extent(piece: ElementTree.Element | None, path: Path) -> list[int]:
    numbers = [] if piece is None else piece.attrib.get("Extent", "").split()
    try:
        extent = [int(number) for number in numbers]
    except ValueError:
        extent = []
    if len(extent) != 6:
        raise ResultFileError(f"{path}: does not say which cells it holds")
    return extent


def _read(path: Path, kind: str) -> Fields:
    """Return the arrays of a piece's corners ("PointData") or cells ("CellData"), flat."""
    header, begin = _opened_file(path)
    fields: Fields = {}
    group = header.find(f"ImageData/Piece/{kind}")
    try:
        assert group is not None
        with path.open("rb") as file:
            for item in group:
                file.seek(begin + int(item.attrib["offset"]))
                size = int(np.frombuffer(file.read(8), dtype="<u8")[0])
                if size > path.stat().st_size:
                    raise ValueError(f"{item.attrib['Name']} is said to have {size} bytes")
                stored = file.read(size)
                if crc32(stored) != int(item.attrib["crc32"]):
                    raise ValueError(f"the checksum of {item.attrib['Name']} is wrong")
                fields[item.attrib["Name"]] = np.frombuffer(stored, _TYPES[item.attrib["type"]])
    except (OSError, ValueError, KeyError, IndexError, AssertionError) as error:
        raise ResultFileError(f"{path}: is damaged: {error}") from error
    return fields


def _shaped(values: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    if values.size != int(np.prod(shape)):
        raise ResultFileError(f"a piece holds {values.size} values for {shape} cells")
    return values.reshape(shape, order="F")


def together(comm: Any, step: Callable[[], Answer]) -> Answer:
    """Take a step without messages on all processes; if it fails on any, fail on all."""
    failure: Exception | None = None
    answer: Answer | None = None
    try:
        answer = step()
    except Exception as error:  # sent to the others, and raised below
        failure = error
    # Errors that other processes cannot rebuild travel in words.
    portable = (type(None), SupportError, SceneError, ParameterError, ResultFileError)
    travels = type(failure) in portable
    failures = comm.allgather(failure if travels else f"{type(failure).__name__}: {failure}")
    first = next((rank for rank, error in enumerate(failures) if error is not None), None)
    if first is None:
        return answer  # type: ignore[return-value]
    reason = failures[first]
    if isinstance(reason, KajuError):
        raise reason
    raise WorkerError(f"process {first} of {len(failures)} failed: {reason}") from failure
