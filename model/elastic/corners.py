"""Where stresses have no limit: re-entrant corners, ends of supports, corners between materials.

Round a point of the plane the body is a wedge of one to four quarters between two sides. Stresses
grow without limit towards its tip if both sides are free, or both held, and it is wider than half a
turn; or if one is free and the other held, from a quarter turn on (M. L. Williams, *Journal of
Applied Mechanics* 19, 1952). A roller is a mirror: the wedge counts twice. Where materials meet,
they do unless their boundary is straight there, and does not end (D. B. Bogy, *Journal of Applied
Mechanics* 38, 1971). In space the same holds in the plane across an edge.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import combinations, product

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.moduli import constants_of
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, DISPLACED, FOUNDATION, RIGID, ROLLER

MOST_CELLS = 1_000_000  # Larger arrays of several kinds are not looked through
ON_EDGE = 1e-6  # Of a cell: a point that is nearer to a line of the cells lies on it
ROUND = np.array([[-1, -1], [0, -1], [0, 0], [-1, 0]])
"""The four cells round a point of the plane, each beside the next."""


def sharp_places(scene: Scene, near: Floats | None = None) -> tuple[Floats, list[str]]:
    """Return where (m) stresses grow without limit, and why: points, in space middles of edges.

    In the whole array, or near a point alone.
    """
    lattice, d, h = scene.lattice, scene.lattice.dimension, scene.lattice.cell_size
    if near is not None:
        first = np.clip(np.floor(near / h), 0, lattice.shape).astype(np.int64) - 2
        along = [
            np.arange(max(low, -1), min(low + 5, n + 1))
            for low, n in zip(first.tolist(), lattice.shape, strict=True)
        ]
    elif scene.uniform:  # a full box has none but at its own corners
        along = [np.array([-1, 0, n]) for n in lattice.shape]
    elif lattice.size <= MOST_CELLS:
        along = [np.arange(-1, n + 1) for n in lattice.shape]
    else:
        return np.empty((0, d)), []
    found, why, pairs = [np.empty((0, d))], [], combinations(range(d), 2)
    for across, (reasons, which) in zip(pairs, _patterns(scene, along), strict=True):
        lines: list[Floats] = [1.0 * cells[1:] for cells in along]  # below each but the first
        for axis in set(range(d)).difference(across):
            lines[axis] = np.arange(along[axis][1], along[axis][-1]) + 0.5
            which = np.repeat(which, len(lines[axis]) // which.shape[axis], axis)
        at = np.argwhere(np.array([bool(reason) for reason in reasons])[which])
        found.append(np.stack([line[k] for line, k in zip(lines, at.T, strict=True)], axis=1))
        why += [reasons[number] for number in which[tuple(at.T)]]
    return np.asarray(h * np.concatenate(found)), why


def _patterns(scene: Scene, along: list[Ints]) -> Iterator[tuple[list[str], Ints]]:
    """Yield for each pair of axes why stresses have no limit, and which reason each corner has.

    Of the corners between the cells `along` each axis.
    """
    cells = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1)
    kinds = scene.kinds(cells.reshape(-1, len(along))).reshape(cells.shape[:-1])
    base = int(np.ptp(kinds)) + 1
    for across in combinations(range(len(along)), 2):
        around = np.stack(
            [_beside(kinds, dict(zip(across, step, strict=True))) for step in ROUND], axis=-1
        )
        # One number for each pattern of four: rows would be sorted far more slowly.
        _, first, which = np.unique(
            around @ base ** np.arange(4), return_index=True, return_inverse=True
        )
        fours = around.reshape(-1, 4)[first]
        yield [_reason(_sides(scene, four)) for four in fours], which.reshape(around.shape[:-1])


def _beside(kinds: Ints, steps: dict[int, int]) -> Ints:
    """Return what lies below (step -1) or above (0) of lines between cells, across some axes."""
    beyond = {-1: slice(None, -1), 0: slice(1, None)}
    own = (beyond[steps[axis]] if axis in steps else slice(1, -1) for axis in range(kinds.ndim))
    return kinds[tuple(own)]


def singular_at(scene: Scene, point: Floats) -> str:
    """Return why stresses have no limit at a point (m); empty if they have, or it is unknown."""
    (places, reasons), h = sharp_places(scene, np.asarray(point)), scene.lattice.cell_size
    # an edge reaches half a cell to either side of its middle
    reach = h * (ON_EDGE + 0.5 * (np.rint(2.0 * places / h) % 2))
    for number in np.flatnonzero((np.abs(places - point) <= reach).all(axis=1)):
        return reasons[number]
    points = [load.point for load in scene.loads if load.point is not None]
    if any(np.abs(point - np.array(at)).max() < h for at in points):
        return "a force acts at a point, and is spread over a cell"
    return ""


def _sides(scene: Scene, kinds: Ints) -> tuple[int, ...]:
    """Return four kinds, those merged that hold in the same way or are of the same stiffness."""
    stiffness = constants_of(scene).tolist()
    merged = {AIR: AIR, FOUNDATION: AIR, RIGID: RIGID, DISPLACED: RIGID, ROLLER: ROLLER}
    return tuple(
        merged[kind] if kind < 0 else stiffness.index(stiffness[kind]) for kind in kinds.tolist()
    )


@cache
def _reason(around: tuple[int, ...]) -> str:
    """Return why stresses have no limit between four cells, each beside the next."""
    if all(kind >= 0 for kind in around):
        pairs = [around[k] == around[(k + 1) % 4] for k in range(4)]
        straight = all(pairs) or pairs in ([True, False, True, False], [False, True, False, True])
        return "" if straight else "materials meet in a corner"
    for first, quarters in product(range(4), (1, 2, 3)):
        wedge = {around[(first + k) % 4] for k in range(quarters)}
        sides = {around[first - 1], around[(first + quarters) % 4]}
        if min(wedge) < 0 or max(sides) >= 0:
            continue
        if len(wedge) > 1 and not (quarters == 2 and sides == {ROLLER}):
            return "the boundary between two materials ends at the surface"
        if len(wedge) == 1 and sides == {AIR, RIGID}:
            return "a support ends"
        if len(wedge) == 1 and quarters == 3:
            return "a re-entrant corner"
        if len(wedge) == 1 and quarters == 2 and len(sides) == 2:  # one of them a roller
            return "a roller ends"
    return ""
