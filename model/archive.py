"""Results in one ``.npz`` file: written whole or not at all, and believed only after a look.

A file may come from anywhere, and its arrays end in compiled loops that check nothing. So
every checksum is read to its end, nothing is unpacked that is out of proportion, and whoever
reads an array says what it must be.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.errors import KajuError, ResultFileError
from kaju.files import scratch_beside

FORMAT = 2
"""Version of the files; 1 were those of kaju 0.1."""
PACKED_AT_MOST, SMALL = 200, 1 << 24
"""How many times larger than its file an archive may be, but for its first bytes."""

Value = TypeVar("Value")
Kind = Literal["f", "i", "b"]
_NAMES = {"f": "floating-point numbers", "i": "whole numbers", "b": "true or false"}


@dataclass(frozen=True, eq=False)
class Archive:
    """What a file holds, taken out by name and looked at.

    Attributes
    ----------
    path : Path
    arrays : dict of str to array
    about : dict of str to plain values
    """

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
        high: float | None = None,
        finite: bool = True,
    ) -> NDArray[Any]:
        """Return an array of 64-bit numbers (or of truth values) that is what it must be.

        Parameters
        ----------
        name : str
        kind : {"f", "i", "b"}
            Floating-point numbers, whole numbers, or true and false.
        shape : tuple
            None stands for any length along an axis, or for any shape.
        low, high : float, optional
            The smallest and the largest value allowed.
        finite : bool
            Whether floating-point numbers must be finite.

        Raises
        ------
        ResultFileError
            Naming the array, what it must be, and what it is.
        """
        if name not in self.arrays:
            raise ResultFileError(f"{self.path}: the array {name!r} is missing")
        found = self.arrays[name]
        kinds = {"f": "f", "i": "iu", "b": "b"}[kind]
        if found.dtype.kind not in kinds or (kind != "b" and found.dtype.itemsize != 8):
            raise self._wrong(name, f"hold {_NAMES[kind]} of 64 bits", f"is of {found.dtype}")
        fits = shape is None or (
            found.ndim == len(shape)
            and all(
                length in (None, given) for length, given in zip(shape, found.shape, strict=True)
            )
        )
        if not fits and shape is not None:
            told = tuple("any" if length is None else length for length in shape)
            raise self._wrong(name, f"be of shape {told}", f"is of shape {found.shape}")
        if kind == "f" and finite and not np.isfinite(found).all():
            raise self._wrong(name, "hold finite numbers", "does not")
        if low is not None and found.size and not np.nanmin(found) >= low:
            raise self._wrong(name, f"be {low:g} or more", f"holds {np.nanmin(found):g}")
        if high is not None and found.size and not np.nanmax(found) <= high:
            raise self._wrong(name, f"be {high:g} or less", f"holds {np.nanmax(found):g}")
        return np.ascontiguousarray(found, dtype=found.dtype.newbyteorder("="))

    def value(self, name: str, *types: type[Value]) -> Value:
        """Return a plain value of one of some types; None counts as such if NoneType is one.

        Raises
        ------
        ResultFileError
            If it is missing, or of another type.
        """
        found = self.about.get(name)
        wanted = " or ".join(known.__name__ for known in types)
        if name not in self.about:
            raise ResultFileError(f"{self.path}: {name!r} is missing")
        if not isinstance(found, types) or (isinstance(found, bool) and bool not in types):
            raise self._wrong(name, f"be of {wanted}", f"is {found!r:.40}")
        return found

    def _wrong(self, name: str, rule: str, found: str) -> ResultFileError:
        return ResultFileError(
            f"{self.path}: {name!r} must {rule}, and {found}: the file is damaged, or no result "
            "of kaju's; compute it again"
        )


def write_archive(
    path: str | Path, kind: str, arrays: dict[str, NDArray[Any]], text: dict[str, Any]
) -> Path:
    """Write arrays and plain values to one ``.npz`` file, whole or not at all.

    Parameters
    ----------
    path : path
        The file; the ending ``.npz`` is added if it is missing.
    kind : str
        Label of the result, which `read_archive` checks.
    arrays : dict of str to array
        Numbers; no objects, so that reading needs no pickle.
    text : dict
        Anything that JSON can hold.

    Raises
    ------
    ResultFileError
        If the file cannot be written.
    """
    target = Path(path)
    if target.suffix != ".npz":
        target = target.with_name(target.name + ".npz")
    labelled = {"kind": kind, "format": FORMAT, "kaju_version": __version__, **text}
    described = np.frombuffer(json.dumps(labelled).encode(), dtype=np.uint8)
    with scratch_beside(target, ResultFileError) as scratch:
        np.savez_compressed(scratch, allow_pickle=False, json=described, **arrays)
    return target


def read_archive(
    path: str | Path, kind: str | None = None
) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Read what `write_archive` wrote; see `open_archive`."""
    found = open_archive(path, *([] if kind is None else [kind]))
    return found.arrays, found.about


def open_archive(path: str | Path, *kinds: str) -> Archive:
    """Read what `write_archive` wrote.

    Parameters
    ----------
    path : path
        The file.
    *kinds : str
        The labels that are expected; without any, all are.

    Raises
    ------
    ResultFileError
        If the file is missing, is no archive of kaju's, is damaged or out of proportion, comes
        from a later version, or holds another kind of result.
    """
    file = Path(path)
    try:
        arrays = _unpacked(file)
        about = json.loads(arrays.pop("json").tobytes().decode())
    except FileNotFoundError as error:
        raise ResultFileError(f"{file}: there is no such file") from error
    except ResultFileError:
        raise
    except Exception as error:
        raise ResultFileError(f"{file}: is not a result that kaju has saved ({error})") from error
    if not isinstance(about, dict) or not isinstance(about.get("kind"), str):
        raise ResultFileError(f"{file}: is not a result that kaju has saved (it has no kind)")
    version = about.get("format", 1)
    if not isinstance(version, int) or version > FORMAT:
        raise ResultFileError(
            f"{file}: was saved by kaju {about.get('kaju_version')} in version {version!r} of the "
            f"format, this is kaju {__version__} and knows {FORMAT}; read it with the later one"
        )
    if kinds and about["kind"] not in kinds:
        raise ResultFileError(
            f"{file}: holds a result of kind {about['kind']!r}, not of {kinds[0]!r}"
        )
    return Archive(file, arrays, about)


def _unpacked(file: Path) -> dict[str, NDArray[Any]]:
    """Return all arrays, every one read to the end, where its checksum is."""
    with zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
        whole, packed = sum(entry.file_size for entry in entries), file.stat().st_size
        if whole > SMALL + PACKED_AT_MOST * packed:
            raise ResultFileError(
                f"{file}: {packed:,} bytes would unpack to {whole:,}, more than results do; it was "
                "not read"
            )
        return {
            entry.filename.removesuffix(".npy"): _array(archive.read(entry)) for entry in entries
        }


def _array(stored: bytes) -> NDArray[Any]:
    stream = BytesIO(stored)
    found: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    if stream.read(1):
        raise ValueError("an array is shorter than what is stored of it")
    return found


@contextmanager
def reading(path: str | Path) -> Iterator[None]:
    """Turn whatever goes wrong while a file is taken apart into an error that names it.

    Raises
    ------
    ResultFileError
        Instead of the errors of what is built from the file's contents.
    """
    try:
        yield
    except ResultFileError:
        raise
    except (KajuError, ArithmeticError, AssertionError, AttributeError) as error:
        raise ResultFileError(_damaged(path, error)) from error
    except (IndexError, KeyError, TypeError, ValueError, MemoryError, RecursionError) as error:
        raise ResultFileError(_damaged(path, error)) from error


def _damaged(path: str | Path, error: BaseException) -> str:
    told = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return f"{path}: is damaged, or no result of kaju's ({told}); compute it again"
