"""Stored files taken apart, changed and written again."""

import io
import json

import numpy as np


def parts_of(data):
    """Return the arrays and the plain values of an archive's bytes."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = dict(archive)
    return arrays, json.loads(arrays.pop("json").tobytes()) if "json" in arrays else {}


def joined(arrays, about):
    """Return the bytes of an archive."""
    arrays = {**arrays, "json": np.frombuffer(json.dumps(about).encode(), dtype=np.uint8)}
    out = io.BytesIO()
    np.savez_compressed(out, **arrays)
    return out.getvalue()


def rewritten(path, change, to=None):
    """Write an archive again, its arrays and values changed by a function; return its path."""
    arrays, about = parts_of(path.read_bytes())
    change(arrays, about)
    to = to or path
    to.write_bytes(joined(arrays, about))
    return to
