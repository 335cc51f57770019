"""Results in one ``.npz`` file: written whole or not at all, and checked when they are read.

A file may come from anywhere, and its arrays end in compiled loops that check nothing. So every
array is read to its end, where the zip's checksum (CRC) is, nothing out of proportion is unpacked,
no pickle is read, and the fields of the result say what each array must be (`stored`).
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, cast

import numpy as np
from numpy.typing import NDArray

from kaju import __version__
from kaju.errors import KajuError, ParameterError, ResultError, ResultFileError
from kaju.files import atomic_file, file_to_read, is_there
from kaju.model.scene import load_scene
from kaju.result_kinds import KINDS, fetch

from .stored import Arrays, read, write

if TYPE_CHECKING:
    from .result import Result

FORMAT = 1  # version of the files; others are refused


class Stored:
    """What is kept in one file: a dataclass of which every field says how."""

    kind: ClassVar[str]

    def save(self, path: str | Path) -> Path:
        """Write it to one ``.npz`` file, whole or not at all; `kaju.load_result` reads results.

        Raises
        ------
        ResultError
            If agents of your own have left a value that no result can hold, such as NaN.
        ResultFileError
            If the file cannot be written.
        """
        target = Path(path)
        if target.suffix != ".npz":
            target = target.with_name(target.name + ".npz")
        arrays: Arrays = {}
        try:
            text = write(type(self), self, "", arrays, {})
        except ResultError as error:
            raise ResultError(
                f"save: this result could not be read again, so it is not written: {error}"
            ) from error
        label = {"kind": self.kind, "format": FORMAT, "kaju_version": __version__}
        described = np.frombuffer(json.dumps(label | text).encode(), dtype=np.uint8)
        with (
            atomic_file(target, ResultFileError) as scratch,
            # The usual level of 6 takes three times as long for 2 % less.
            zipfile.ZipFile(scratch, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        ):
            for name, array in {"json": described, **arrays}.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                    np.lib.format.write_array(file, np.asanyarray(array), allow_pickle=False)
        return target

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote; refuse a file that is damaged, or holds something else."""
        return cast(Self, read_stored(path, {cls.kind: cls}.get, f"not of {cls.kind!r}"))


def read_stored(path: str | Path, class_of: Callable[[str], Any], others: str) -> Any:
    """Return what `save` wrote, every array read to its end, by its kind; refuse all `others`."""
    file = file_to_read(path, ResultFileError)
    if file.suffix == ".toml":
        raise ResultFileError(f"{file}: is a scene; run it first: kaju run {file}")
    with reading(file):
        arrays = _unpacked(file)
        about = json.loads(arrays.pop("json").tobytes().decode())
        if not isinstance(about, dict) or not isinstance(about.get("kind"), str):
            raise ResultError("it has no kind")
    if about.get("format") != FORMAT:
        raise ResultFileError(
            f"{file}: was saved by kaju {about.get('kaju_version')} in version "
            f"{about.get('format')!r} of the format, and kaju {__version__} reads {FORMAT}: read "
            "it with that kaju, or compute it again"
        )
    if (kind := class_of(about["kind"])) is None:
        raise ResultFileError(f"{path}: holds a result of kind {about['kind']!r}, {others}")
    with reading(path):
        return read(kind, about, "", arrays, {})


def _unpacked(file: Path) -> dict[str, NDArray[Any]]:
    """Return all arrays, read to where the checksum is."""
    with zipfile.ZipFile(file) as archive:
        entries = archive.infolist()
        whole, packed = sum(entry.file_size for entry in entries), file.stat().st_size
        if whole > (1 << 24) + 200 * packed:
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


# Any file, and what people hand over: a scene, a model, or an answer.


def load_result(path: str | Path) -> Result:
    """Return the result that `Result.save` wrote.

    Parameters
    ----------
    path : str or pathlib.Path
        An ``.npz`` file, or a folder with ``result.npz`` or, in pieces, ``result.xdmf``.

    Raises
    ------
    ResultFileError
        If the file is missing, or is no result of kaju's.

    Examples
    --------
    >>> import kaju
    >>> result = kaju.LoadModel(kaju.load_scene("plate.toml")).run()
    >>> kaju.load_result(result.save("plate.kaju")).last.generations
    8
    """
    return cast("Result", stored_at(path))


def stored_at(path: str | Path, **others: type) -> Any:
    """Return the result in a file or folder, or what is of one of the `others`, by their kinds."""
    file = Path(path)
    if file.suffix == ".xdmf" or is_there(file / "result.xdmf"):
        return fetch(KINDS["elasticity in pieces"].result).load(file)
    if is_there(file) and file.is_dir():
        file = file / "result.npz"

    def class_of(kind: str) -> Any:
        return fetch(KINDS[kind].result) if kind in KINDS else others.get(kind)

    return read_stored(file, class_of, "which this kaju cannot read")


def from_file(subject: Any) -> Any:
    """Return the scene or result in a file; what is no path is returned as it is."""
    if isinstance(subject, type):
        name, into = subject.__name__, getattr(subject, "goes_into", "{}")
        made = into.format(name).replace(",", "(scene,") if "," in into else f"{name}(scene"
        raise ParameterError(f"{name}: is a class, of which nothing is made yet; give {made})")
    if not isinstance(subject, (str, Path)):
        return subject
    return load_scene(subject) if Path(subject).suffix == ".toml" else load_result(subject)


def answer_of(subject: Any) -> Any:
    """Return what can be drawn: of a model the answer as far as it has come, of a file its own."""
    subject = from_file(subject)
    if hasattr(subject, "step") and hasattr(subject, "result"):
        return subject.result() if callable(subject.result) else subject.result
    return subject
