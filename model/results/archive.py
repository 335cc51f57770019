"""Results in one ``.npz`` file: written whole or not at all, and checked when they are read.

A file may come from anywhere, and its arrays end in compiled loops that check nothing. So every
array is read to its end, where the zip's checksum (CRC) is, nothing out of proportion is unpacked,
no pickle is read, and the fields of the result say what each array must be (`stored`).
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError
from typing_extensions import TypedDict

from kaju import __version__
from kaju.errors import KajuError, ResultFileError
from kaju.files import atomic_file, file_to_read

FORMAT = 4  # version of the files; others are refused
PACKED_AT_MOST, SMALL = 200, 1 << 24  # limit of unpacked over packed size, past so many bytes
QUICK = 1  # level of compression: the usual 6 takes three times as long for 2 % less

Kind = Literal["f", "s", "i", "b"]  # floating point, single precision, whole numbers, truth values
_NAMES = {"f": "float64", "s": "float32", "i": "int64", "b": "bool"}
_TYPES = {"f": ("f8",), "s": ("f4",), "i": ("i8", "u8"), "b": ("b1",)}


class ArchiveColumn(NamedTuple):
    """What an array of a stored result must be."""

    kind: Kind
    shape: str  # sizes along its axes, each a number or a name; arrays that use a name agree
    low: float | None = None  # smallest value
    high: float | str | None = None  # largest; of a named size whole numbers stay below
    finite: bool = True  # whether floating-point numbers must be finite
    optional: bool = False  # earlier versions did not write it, or not every result has it
    order: Literal["", "rising", "never falling"] = ""  # of one value at least

    def text(self) -> str:
        """Return the same in words."""
        words = [f"({', '.join(self.shape.split())}) {_NAMES[self.kind]}"]
        if self.high is not None:
            below = isinstance(self.high, str) and self.kind != "f"
            upper = self.high if isinstance(self.high, str) else f"{self.high:g}"
            words += [f"in [{self.low:g}, {upper}{')' if below else ']'}"]
        elif self.low is not None:
            words += [f"≥ {self.low:g}"]
        words += ["" if self.finite else "or NaN", "optional" if self.optional else "", self.order]
        return " ".join(filter(None, words))


@dataclass(frozen=True, eq=False)
class Archive:
    """The contents of a file; every array and value is checked when it is taken out."""

    path: Path
    arrays: dict[str, NDArray[Any]]
    about: dict[str, Any]

    def array(
        self,
        name: str,
        kind: Kind,
        shape: tuple[int | None, ...] | None,
        *,
        low: float | None = None,
        high: float | NDArray[Any] | None = None,
        finite: bool = True,
    ) -> NDArray[Any]:
        """Return an array of a kind, shape (None: any) and range; `high` may differ by column."""
        if name not in self.arrays:
            raise ResultFileError(f"{self.path}: the array {name!r} is missing")
        found = self.arrays[name]
        if found.dtype.str[1:] not in _TYPES[kind]:
            raise self._wrong(name, f"hold {_NAMES[kind]}", f"is of {found.dtype}")
        if shape is not None and (
            found.ndim != len(shape)
            or any(length not in (None, n) for length, n in zip(shape, found.shape, strict=True))
        ):
            needed = tuple("any" if length is None else length for length in shape)
            raise self._wrong(name, f"be of shape {needed}", f"is of shape {found.shape}")
        if kind in "fs" and finite and not np.isfinite(found).all():
            raise self._wrong(name, "hold finite numbers", "does not")
        if low is not None and found.size and not np.nanmin(found) >= low:
            raise self._wrong(name, f"be {low:g} or more", f"holds {np.nanmin(found):g}")
        if high is not None and not np.all((found <= high) | np.isnan(found)):
            raise self._wrong(name, f"be {high} or less", f"holds {np.nanmax(found):g}")
        return found

    def columns(
        self, table: Mapping[str, ArchiveColumn], sizes: Mapping[str, Any], prefix: str = ""
    ) -> dict[str, NDArray[Any]]:
        """Return the arrays of a table; the first that names an unknown size gives it."""
        sizes, found = dict(sizes), {}
        for name, column in table.items():
            if column.optional and prefix + name not in self.arrays:
                continue
            axes = column.shape.split()
            shape = tuple(int(axis) if axis.isdigit() else sizes.get(axis) for axis in axes)
            high: Any = column.high
            if isinstance(high, str):
                high = sizes[high] - (column.kind == "i")  # indices stay below a size
            values = self.array(
                prefix + name, column.kind, shape, low=column.low, high=high, finite=column.finite
            )
            if column.order:
                step = np.diff(values)
                right = np.all(step > 0 if column.order == "rising" else step >= 0)
                if not (len(values) and right):
                    rule = f"hold {column.order} numbers, one or more"
                    raise self._wrong(prefix + name, rule, "does not")
            found[name] = values
            sizes |= dict(zip(axes, values.shape, strict=True))
        return found

    def part(self, prefix: str) -> dict[str, NDArray[Any]]:
        """Return the arrays whose names begin so, by the rest of their names."""
        found = [name for name in self.arrays if name.startswith(prefix)]
        return {name.removeprefix(prefix): self.arrays[name] for name in found}

    def value(self, name: str, form: Any) -> Any:
        """Return a plain value of some form: a type, a union of types, a record."""
        if name not in self.about:
            raise ResultFileError(f"{self.path}: {name!r} is missing")
        text = json.dumps(self.about[name])
        if "NaN" in text and _has_nan(self.about[name]):
            raise self._wrong(name, "hold numbers", "holds NaN")
        try:
            return TypeAdapter(form).validate_json(text, strict=True)
        except ValidationError as error:
            first = error.errors()[0]
            inside = ".".join(map(str, (name, *first["loc"])))
            rule = first["msg"].removeprefix("Input should ").replace("be a ", "be ", 1)
            raise self._wrong(inside, rule, f"is {first['input']!r:.40}") from error

    def record(self, name: str, kind: type) -> dict[str, Any]:
        """Return the plain fields of a dataclass, which `plain_of` has listed."""
        found: dict[str, Any] = self.value(name, TypedDict(kind.__name__, _plain(kind)))  # type: ignore[operator]
        return found

    def _wrong(self, name: str, rule: str, found: str) -> ResultFileError:
        return ResultFileError(
            f"{self.path}: {name!r} must {rule}, and {found}: the file is damaged, or no result "
            "of kaju's; compute it again"
        )


def _has_nan(value: Any) -> bool:
    if isinstance(value, (dict, list)):
        return any(map(_has_nan, value.values() if isinstance(value, dict) else value))
    return isinstance(value, float) and value != value


def _plain(kind: type) -> dict[str, Any]:
    """Return the fields of a dataclass that hold numbers, texts, or lists of them."""
    kinds = (float, int, str, bool, list[float], list[str])
    return {name: form for name, form in get_type_hints(kind).items() if form in kinds}


def plain_of(record: object) -> dict[str, Any]:
    """Return the plain fields of a dataclass: all but arrays, and classes of kaju's."""
    return {name: getattr(record, name) for name in _plain(type(record))}


def write_archive(
    path: str | Path, kind: str, arrays: dict[str, NDArray[Any]], text: dict[str, Any]
) -> Path:
    """Write arrays, and what JSON can hold, to an ``.npz`` file of a kind, whole or not at all."""
    target = Path(path)
    if target.suffix != ".npz":
        target = target.with_name(target.name + ".npz")
    labelled = {"kind": kind, "format": FORMAT, "kaju_version": __version__, **text}
    described = np.frombuffer(json.dumps(labelled).encode(), dtype=np.uint8)
    with (
        atomic_file(target, ResultFileError) as scratch,
        zipfile.ZipFile(scratch, "w", zipfile.ZIP_DEFLATED, compresslevel=QUICK) as archive,
    ):
        for name, array in {"json": described, **arrays}.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asanyarray(array), allow_pickle=False)
    return target


def open_archive(path: str | Path, *kinds: str) -> Archive:
    """Read a file that `write_archive` wrote, with one of these labels; without any, all do."""
    file = Path(path)
    try:
        arrays = unpacked(file)
        about = json.loads(arrays.pop("json").tobytes().decode())
    except ResultFileError:
        raise
    except Exception as error:
        raise ResultFileError(f"{file}: is not a result that kaju has saved ({error})") from error
    if not isinstance(about, dict) or not isinstance(about.get("kind"), str):
        raise ResultFileError(f"{file}: is not a result that kaju has saved (it has no kind)")
    if about.get("format") != FORMAT:
        raise ResultFileError(
            f"{file}: was saved by kaju {about.get('kaju_version')} in version "
            f"{about.get('format')!r} of the format, and kaju {__version__} reads {FORMAT}: read "
            "it with that kaju, or compute it again"
        )
    if kinds and about["kind"] not in kinds:
        raise ResultFileError(
            f"{file}: holds a result of kind {about['kind']!r}, not of {kinds[0]!r}"
        )
    return Archive(file, arrays, about)


def unpacked(file: Path) -> dict[str, NDArray[Any]]:
    """Return all arrays, every one read to its end, where the checksum is."""
    with zipfile.ZipFile(file_to_read(file, ResultFileError)) as archive:
        entries = archive.infolist()
        whole, packed = sum(entry.file_size for entry in entries), file.stat().st_size
        if whole > SMALL + PACKED_AT_MOST * packed:
            raise ResultFileError(
                f"{file}: {packed:,} bytes would unpack to {whole:,}, more than results do; it was "
                "not read"
            )
        arrays: dict[str, NDArray[Any]] = {}
        for entry in entries:
            stream = BytesIO(archive.read(entry))
            name = entry.filename.removesuffix(".npy")
            array = np.lib.format.read_array(stream, allow_pickle=False)
            arrays[name] = np.asarray(array, dtype=array.dtype.newbyteorder("="), order="C")
            if stream.read(1):
                raise ValueError("an array is shorter than what is stored of it")
    return arrays


@contextmanager
def reading(path: str | Path) -> Iterator[None]:
    """Turn whatever goes wrong while a file is taken apart into an error that names it."""
    try:
        yield
    except ResultFileError:
        raise
    except Exception as error:
        cause = str(error) if isinstance(error, KajuError) else f"{type(error).__name__}: {error}"
        raise ResultFileError(
            f"{path}: is damaged, or is not a result of kaju ({cause.rstrip(': ')}); compute it "
            "again"
        ) from error
