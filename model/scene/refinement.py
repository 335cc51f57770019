"""The same scene on finer cells."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np

from kaju.arrays import Ints
from kaju.errors import ParameterError, SceneError
from kaju.model.scene import cell_types

from .body import Body
from .lattice import Cells, Lattice
from .loads import LoadTable
from .pictures import Picture, check_size
from .selection import Selection

Kinds = Callable[[Cells], Ints]

_HELD = (cell_types.RIGID, cell_types.DISPLACED)


def refined_body(body: Body, lattice: Lattice, picture: Picture | None, k: int) -> Body:
    """Return a body with k cells along each edge of a former cell, regions asked anew."""
    if isinstance(k, bool) or not isinstance(k, (int, np.integer)) or k < 1:
        raise ParameterError(f"k: must be a whole number, 1 or more, got {k!r}")
    if not lattice.boxes:
        raise SceneError(
            "body.lattice: only squares and cubes can be split into smaller ones, got "
            f"{lattice.kind}s"
        )
    given = dict(body)
    if body.size is None:
        given["cell_size"] = lattice.cell_size / k
    if picture is None:
        given["cells"] = tuple(k * count for count in lattice.shape)
        return Body(**given)
    check_size(tuple(k * count for count in lattice.shape), "body")
    codes = picture.codes
    for axis in range(codes.ndim):
        codes = np.repeat(codes, k, axis=axis)
    return Body(
        **(given | {"drawing": None, "image": None, "nearest_colour": False, "array": codes})
    )


def refined_loads(
    loads: Sequence[LoadTable],
    selections: Sequence[Selection],
    lattice: Lattice,
    fine_kinds: Kinds,
    k: int,
) -> Iterator[LoadTable]:
    """Yield loads of the same force on the same places of the finer lattice.

    Points, regions and sides are places in metres and stay. A load on a face of a cell is
    spread over the smaller cells along that face, a load in a cell's middle over all of
    the cell.
    """
    for load, chosen in zip(loads, selections, strict=True):
        if load.cell is None:
            yield load
            continue
        given = dict(load) | {"cell": None, "side": None}
        direction = int(chosen.direction[0])
        lower, upper = ([(i + end) * lattice.cell_size for i in load.cell] for end in (0, 1))
        if direction < 0:
            yield LoadTable(**given | {"region": {"box": (lower, upper)}})
            continue
        # The smaller cells along the face.
        axis, upper_end = divmod(direction, 2)
        along = [range(k * index, k * index + k) for index in load.cell]
        along[axis] = along[axis][-1:] if upper_end else along[axis][:1]
        children = np.array(list(product(*along)), dtype=np.int64)
        body = children[fine_kinds(children) >= 0]
        beyond = fine_kinds(lattice.neighbours(children, direction))
        exposed = np.all((beyond < 0) & ~np.isin(beyond, _HELD))
        if exposed and len(body) == len(children):
            lower[axis] = upper[axis] = (upper if upper_end else lower)[axis]
            yield LoadTable(**given | {"region": {"box": (lower, upper)}})
        elif len(body) == 0:
            yield LoadTable(**given | {"region": {"box": (lower, upper)}})
        else:
            force = None if load.force is None else tuple(f / len(body) for f in load.force)
            entered = given | {"side": lattice.sides[direction], "force": force}
            for child in body.tolist():
                yield LoadTable(**entered | {"cell": tuple(child)})
