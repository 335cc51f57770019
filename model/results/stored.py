"""Any dataclass in one file: its fields say what is stored, and what it must be when it is read.

To store a result, annotate the fields of its dataclass, in the order in which they are read:

- an array: ``cells: Annotated[Ints, Column("agents dimension", 0, "cells")]``. The sizes of axes
  go by name: the first array that uses a name decides it, later ones must agree. A scene that was
  read before gives the names of `sizes_of`. ``high="cells"`` means indices into that size.
- a `Scene`, another dataclass, ``tuple[X, ...]`` or ``list[X]`` of such, or ``X | None``: each by
  its own fields. Where a field may hold one of several dataclasses (``Scene | SpringNetwork``), the
  file keeps the name of the class.
- anything else must be what pydantic turns into JSON and back, of the type that is annotated.

Only what the constructor takes is stored; what holds between fields is checked by the class in
``__post_init__`` (raise `ResultError`). What is known when a result is made, and found again when
it is read, is an ``InitVar``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache, partial
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, TypeAdapter, ValidationError

from kaju.errors import ResultError, brief
from kaju.model.scene import Scene

Arrays = dict[str, NDArray[Any]]
Sizes = dict[str, Any]
_is_record: Callable[[Any], bool] = is_dataclass
# NaN stays NaN: before pydantic 2.13 one within a named tuple became None.
_adapter = cache(partial(TypeAdapter[Any], config=ConfigDict(ser_json_inf_nan="constants")))


@dataclass(frozen=True)
class Column:
    """What an array must be; the type of its numbers is that of its annotation."""

    shape: str  # sizes along its axes, numbers or names; "..." is any
    low: float | None = None  # smallest value
    high: float | str | None = None  # largest; whole numbers stay below a size that is named
    finite: bool = True  # whether floating-point numbers must be finite
    order: Literal["", "rising"] = ""  # of one value at least

    def check(self, name: str, found: NDArray[Any], dtype: np.dtype[Any], sizes: Sizes) -> None:
        """Refuse an array that is not so; add the sizes that it is the first to have."""
        axes = self.shape.split()
        needed = [int(axis) if axis.isdigit() else sizes.get(axis) for axis in axes]
        if found.dtype != dtype:
            raise _wrong(name, f"must hold {dtype}, and holds {found.dtype}")
        if self.shape != "...":
            fits = len(needed) == found.ndim
            if not (fits and all(n in (None, m) for n, m in zip(needed, found.shape, strict=True))):
                known = ", ".join("any" if size is None else str(size) for size in needed)
                raise _wrong(name, f"must be of shape ({known}), and is of shape {found.shape}")
            sizes |= dict(zip(axes, found.shape, strict=True))
        high: Any = self.high
        if isinstance(high, str):
            high = sizes[high] - (dtype.kind == "i")
        if dtype.kind == "f" and self.finite and not np.isfinite(found).all():
            raise _wrong(name, "must hold finite numbers, and does not")
        if self.low is not None and np.any(found < self.low):
            raise _wrong(name, f"must be {self.low:g} or more, and holds {np.nanmin(found):g}")
        if high is not None and np.any(found > high):
            raise _wrong(name, f"must be {high} or less, and holds {np.nanmax(found):g}")
        if self.order and not (len(found) and np.all(np.diff(found) > 0)):
            raise _wrong(name, "must hold rising numbers, one or more, and does not")


def sizes_of(scene: Scene) -> Sizes:
    """Return the sizes that a scene gives to the arrays of its results."""
    lattice = scene.lattice
    return {
        "dimension": lattice.dimension,
        "directions": lattice.directions,
        "axes": len(lattice.axes),
        "materials": len(scene.cell_materials),
        "sets of arms": 1 << lattice.directions,
        "cells": np.array(lattice.shape),
        "cells and beyond": np.array(lattice.shape) + 1,
    }


@cache
def fields_of(kind: type) -> dict[str, Any]:
    """Return what the fields of a dataclass that its constructor takes hold."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in fields(kind) if field.init}


def _column(form: Any) -> Column | None:
    marks = get_args(form)[1:] if get_origin(form) is Annotated else ()
    return next((mark for mark in marks if isinstance(mark, Column)), None)


def _dtype(form: Any) -> np.dtype[Any]:
    held = get_args(get_args(form)[0])[-1]  # of an array: its dtype, or since NumPy 2.5 its number
    number: np.dtype[Any] = np.dtype((get_args(held) or (held,))[0])
    return number


@cache
def _has_parts(form: Any) -> bool:
    """Tell whether a form is a dataclass or an array, or holds any."""
    if form is Scene or _is_record(form) or _column(form) is not None:
        return True
    return get_origin(form) not in (None, Annotated, Literal) and any(
        map(_has_parts, get_args(form))
    )


def _inside(name: str, part: object) -> str:
    return f"{name}.{part}" if name else str(part)


def _choices(form: Any) -> dict[str, Any]:
    """Return the forms with parts that a union names, by the names of their classes."""
    parts = filter(_has_parts, get_args(form))
    return {"array" if _column(each) else each.__name__: each for each in parts}


# The writer and the reader go through the same forms.


def write(form: Any, value: Any, name: str, arrays: Arrays, sizes: Sizes) -> Any:
    """Put arrays by where they stand, and return the rest of a value, as JSON can hold it."""
    column = _column(form)
    if column is not None:
        arrays[name] = np.ascontiguousarray(value).reshape(np.shape(value))
        return column.check(name, arrays[name], _dtype(form), sizes)
    if form is Scene:
        text, own_arrays = value.to_archive()
        arrays |= {_inside(name, key): array for key, array in own_arrays.items()}
        sizes |= sizes_of(value)
        return text
    if not _has_parts(form):
        try:
            return _adapter(form).dump_python(value, mode="json")
        except ValueError as error:
            raise _wrong(name, f"cannot be saved: {error.__cause__ or error}") from error
    if _is_record(form):
        return {
            field: write(inner, getattr(value, field), _inside(name, field), arrays, sizes)
            for field, inner in fields_of(form).items()
        }
    if get_origin(form) in (Union, UnionType):
        if value is None:
            return None
        kind = "array" if isinstance(value, np.ndarray) else type(value).__name__
        return {kind: write(_choices(form)[kind], value, name, arrays, sizes)}
    return [  # each part has sizes of its own
        write(get_args(form)[0], part, _inside(name, number), arrays, dict(sizes))
        for number, part in enumerate(value)
    ]


def read(form: Any, plain: Any, name: str, arrays: Mapping[str, NDArray[Any]], sizes: Sizes) -> Any:
    """Return a value that `write` took apart; refuse what is not as its form says."""
    column, origin = _column(form), get_origin(form)
    if column is not None:
        if name not in arrays:
            raise _wrong(name, "is missing")
        column.check(name, arrays[name], _dtype(form), sizes)
        return arrays[name]
    if form is Scene:
        start = _inside(name, "")
        own = {key.removeprefix(start): a for key, a in arrays.items() if key.startswith(start)}
        scene = Scene.from_archive(_plain(str, plain, name), own)
        sizes |= sizes_of(scene)
        return scene
    if not _has_parts(form):
        return _plain(form, plain, name)
    if _is_record(form):
        table, made = _holding(dict, plain, name), {}
        for field, inner in fields_of(form).items():
            where = _inside(name, field)
            if field not in table:
                raise _wrong(where, "is missing")
            made[field] = read(inner, table[field], where, arrays, sizes)
        return form(**made)
    if origin in (Union, UnionType):
        choices = _choices(form)
        if plain is None and type(None) in get_args(form):
            return None
        kind = next(iter(_holding(dict, plain, name)), "")
        if kind not in choices:
            raise _wrong(name, f"must be of one of the classes {sorted(choices)}, and is {kind!r}")
        return read(choices[kind], plain[kind], name, arrays, sizes)
    parts: Any = origin  # a tuple or a list
    return parts(
        read(get_args(form)[0], part, _inside(name, number), arrays, dict(sizes))
        for number, part in enumerate(_holding(list, plain, name))
    )


def _holding(kind: type, plain: Any, name: str) -> Any:
    if not isinstance(plain, kind):
        what = "a table" if kind is dict else "a list"
        raise _wrong(name or "json", f"must be {what}, and is {brief(plain)}")
    return plain


def _plain(form: Any, plain: Any, name: str) -> Any:
    """Return a value that JSON holds, if it is of a form."""
    if (odd := _odd_number(plain)) is not None:
        raise _wrong(name, f"must hold numbers of 64 bits, and holds {odd:.3g}")
    try:
        return _adapter(form).validate_json(json.dumps(plain), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, (name or "json", *first["loc"])))
        rule = first["msg"].removeprefix("Input should ").replace("be a ", "be ", 1)
        raise _wrong(where, f"must {rule}, and is {brief(first['input'])}") from error


def _odd_number(value: Any) -> float | None:
    """Return a number that is NaN, or an integer that is too large to compute with."""
    if isinstance(value, dict | list):
        parts = value.values() if isinstance(value, dict) else value
        return next((odd for odd in map(_odd_number, parts) if odd is not None), None)
    huge = isinstance(value, int) and not -(2**63) <= value < 2**63
    return float(value) if huge or value != value else None


def _wrong(name: str, what: str) -> ResultError:
    return ResultError(f"{name!r} {what}")
