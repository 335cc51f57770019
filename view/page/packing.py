"""Columns of numbers as few bytes, and back; `history.js` reads the same."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def pack(header: Mapping[str, Any], columns: Mapping[str, NDArray[Any]], level: int = 9) -> bytes:
    """Write a JSON header, and columns of integers or floats, as one block deflated to a level.

    Bytes of one significance stand together, for deflate then finds far more to leave out.
    """
    arrays = {name: np.ascontiguousarray(column).ravel() for name, column in columns.items()}
    listed = [[name, array.dtype.name, array.size] for name, array in arrays.items()]
    text = json.dumps({**header, "columns": listed}, separators=(",", ":"), allow_nan=False)
    head = text.encode()
    body = b"".join(
        array.view(np.uint8).reshape(-1, array.dtype.itemsize).T.tobytes()
        for array in arrays.values()
    )
    return zlib.compress(len(head).to_bytes(4, "little") + head + body, level)


def unpack(packed: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Read what `pack` wrote."""
    raw = zlib.decompress(packed)
    start = 4 + int.from_bytes(raw[:4], "little")
    header: dict[str, Any] = json.loads(raw[4:start])
    columns: dict[str, NDArray[Any]] = {}
    for name, kind, count in header.pop("columns"):
        width = np.dtype(kind).itemsize
        block = np.frombuffer(raw, np.uint8, count * width, start).reshape(width, count)
        columns[name] = np.ascontiguousarray(block.T).view(kind).ravel()
        start += count * width
    return header, columns
