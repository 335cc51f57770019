"""Results in one ``.npz`` file: written whole or not at all, and checked when they are read.

A file may come from anywhere, and its arrays end in compiled loops that check nothing. So every
array is read to its end, where the zip's checksum (CRC) is, nothing out of proportion is unpacked,
no pickle is read, and the fields of the result say what each array must be (`stored`).
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.errors import KajuError, ResultFileError
from kaju.files import atomic_file, file_to_read

FORMAT = 4  # version of the files; others are refused
PACKED_AT_MOST, SMALL = 200, 1 << 24  # limit of unpacked over packed size, past so many bytes
QUICK = 1  # level of compression: the usual 6 takes three times as long for 2 % less


class Archive(NamedTuple):
    """The contents of a file."""

    arrays: dict[str, NDArray[Any]]
    about: dict[str, Any]


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


def open_archive(path: str | Path, kind: str | None = None) -> Archive:
    """Read a file that `write_archive` wrote, of a kind or of any."""
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
    if kind not in (None, about["kind"]):
        raise ResultFileError(f"{file}: holds a result of kind {about['kind']!r}, not of {kind!r}")
    return Archive(arrays, about)


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
