"""Where loads act: from a description to cells and faces, and to the forces on them by stages.

A selection is made of integer ranges and of the cells in them; the body is never
rasterised for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.agents.materials import suggestion
from kaju.arrays import Floats, Ints
from kaju.errors import SceneError
from kaju.model.scene import cell_types

from .contents import Contents
from .filling import CellBox, Filling, count, grid, slabs
from .lattice import Cells, Lattice
from .loads import LoadTable
from .shapes import Box, Shape

MOST_FACES = 50_000_000
"""A load acts on at most this many faces or cells."""

_NEAR = 1e-6  # of a cell: a coordinate this near to a face lies on it
Corners = tuple[tuple[float, ...], tuple[float, ...]]


@dataclass(frozen=True, eq=False)
class Selection:
    """The faces (or, with direction -1, cells) on which one load acts."""

    cells: Cells
    """The body's cells, shape (n, dimension)."""
    direction: Ints
    """Index of the face, -1 for the cell's middle, shape (n,)."""
    part: Floats | None = None
    """Lower and upper corner of what the load covers of each, from 0 to 1, shape (n, 2, dimension);
    unless given all."""
    offset: Floats | None = None
    """How far (in cells) from the middle of each a force at a point acts, shape (n, dimension)."""

    @property
    def share(self) -> Floats:
        """Part of each face (or cell) that the load covers, up to 1."""
        if self.part is None:
            return np.ones(len(self.cells))
        return np.asarray((self.part[:, 1] - self.part[:, 0]).prod(axis=1))

    def uneven(self, load: LoadTable, force: Floats, lattice: Lattice, thickness: float) -> Uneven:
        """Return which faces the load covers in part, or not evenly, and how."""
        n, d = self.cells.shape
        if self.part is None and self.offset is None and load.pressure_slope is None:
            n = 0
        whole = np.tile(np.array([[0.0], [1.0]]), (n, 1, d))
        part = whole if self.part is None else self.part
        growth = np.zeros((n, d, d))
        if load.pressure_slope is not None:
            change = np.asarray(load.pressure_slope) * lattice.cell_size
            area = lattice.face_area(thickness)
            growth = -area * lattice.normals[self.direction[:n]][:, :, None] * change
        if self.offset is not None:  # the linear traction of that moment
            growth = 12.0 * force[:, :, None] * self.offset[:, None]
        way = self.direction[:n]
        growth[np.arange(n), :, np.maximum(way, 0) // 2] = 0.0
        odd = (growth.any(axis=(1, 2)) | (part != whole).any(axis=(1, 2))) & (way >= 0)
        row = np.flatnonzero(odd)
        return Uneven(row, part[row], growth[row])

    def forces(self, load: LoadTable, lattice: Lattice, thickness: float) -> Floats:
        """Return the force (N) on each face or cell, shape (n, dimension)."""
        if load.force is not None:
            return np.outer(self.share / self.share.sum(), np.asarray(load.force))
        if load.couple is not None:
            return self._couple(np.atleast_1d(load.couple), lattice)
        assert load.pressure is not None
        area = self.share * lattice.face_area(thickness)
        pressure = np.full(len(area), load.pressure)
        if load.pressure_slope is not None:
            pressure = pressure + self._levers(lattice) @ np.asarray(load.pressure_slope)
        return -(pressure * area)[:, None] * lattice.normals[self.direction]

    def _levers(self, lattice: Lattice) -> Floats:
        """Return the middles of what is covered of the faces, or cells (m)."""
        middle = lattice.face_middles(self.cells, self.direction)
        if self.part is None:
            return middle
        return np.asarray(middle + (self.part.mean(axis=1) - 0.5) * lattice.cell_size)

    def steps_of_couple(self, lattice: Lattice) -> float:
        """Return the share of a couple's moment that even forces on faces take from within them."""
        arm = self._levers(lattice)
        arm = arm - self.share @ arm / self.share.sum()
        edge = np.ones_like(arm) if self.part is None else self.part[:, 1] - self.part[:, 0]
        edge[np.arange(len(arm)), self.direction // 2] = 0.0
        between = float(self.share @ (arm * arm).sum(axis=1))
        within = float(self.share @ (edge * edge).sum(axis=1)) * lattice.cell_size**2 / 12.0
        return within / (between + within)

    def _couple(self, moment: Floats, lattice: Lattice) -> Floats:
        """Return forces a × r, r from their middle, without a sum, whose moment (N m) is given."""
        arm = self._levers(lattice)
        arm = np.pad(arm - self.share @ arm / self.share.sum(), ((0, 0), (0, 3 - arm.shape[1])))
        square = np.einsum("n,ni,nj->ij", self.share, arm, arm)
        inertia = np.trace(square) * np.eye(3) - square
        wanted = np.pad(moment, (3 - len(moment), 0))
        turn = np.linalg.lstsq(inertia, wanted, rcond=1e-9)[0]
        if np.abs(inertia @ turn - wanted).max() > 1e-6 * np.abs(wanted).max():
            raise SceneError(
                "couple: the faces it acts on lie on one line along it, or are only one, and so "
                "have no lever; take a larger side or region"
            )
        forces: Floats = self.share[:, None] * np.cross(turn, arm)
        return forces[:, : lattice.dimension]


def faces_on_side(filling: Filling, side: str, where: str) -> Selection:
    """Return all faces of the body that look out of the array on one of its sides."""
    lattice = filling.lattice
    number = lattice.sides.index(side)
    axis, upper_end = divmod(number, 2)
    lower, upper = (corner.copy() for corner in filling.bounds())
    edge = lattice.shape[axis] - 1 if upper_end else 0
    lower[axis], upper[axis] = max(lower[axis], edge), min(upper[axis], edge + 1)
    cells = _body_cells(filling, (lower, upper), where)
    if len(cells) == 0:
        raise SceneError(
            f"{where}: no cell of the body lies at the {side} of the array; select the surface "
            "by a region = {box = [lower corner, upper corner]} without thickness"
        )
    arms = [number] if lattice.boxes else list(range(lattice.directions))
    faces = [cells[lattice.side_beyond(lattice.neighbours(cells, arm)) == number] for arm in arms]
    direction = np.repeat(arms, [len(some) for some in faces])
    cells = np.concatenate(faces)
    _check_free(filling, cells, direction, where)
    return Selection(cells, direction)


def faces_on_plane(filling: Filling, corners: Corners, axis: int, where: str) -> Selection:
    """Return the surface in a box without thickness; faces covered in part take a part."""
    lattice = filling.lattice
    if not lattice.boxes:
        raise SceneError(
            f"{where}: {lattice.kind}s have no faces in a plane; use side, cell, or a box with "
            "thickness"
        )
    place = corners[0][axis] / lattice.cell_size
    plane = round(place)
    if abs(place - plane) > _NEAR or not 0 <= plane <= lattice.shape[axis]:
        near = min(max(plane, 0), lattice.shape[axis]) * lattice.cell_size
        raise SceneError(
            f"{where}: no faces of cells lie at {'xyz'[axis]} = {corners[0][axis]:g} m; the "
            f"nearest do at {near:g} m"
        )
    lower, upper = _covered(lattice, corners)
    lower[axis], upper[axis] = plane, plane + 1
    if count((lower, upper)) == 0:
        raise SceneError(f"{where}: lies outside the array, which goes from 0 to {lattice.extent}")
    _check_count((lower, upper), where)
    cells, direction, covered = _split_faces(filling, (lower, upper), axis)
    if len(cells) == 0:
        inside = "inside the body" if covered else "in the air or on the ground"
        raise SceneError(
            f"{where}: no surface of the body lies in this box at {'xyz'[axis]} = "
            f"{corners[0][axis]:g} m; it is {inside}"
        )
    _check_free(filling, cells, direction, where)
    return Selection(cells, direction, _part(lattice, cells, corners, skip=axis))


def _split_faces(filling: Filling, box: CellBox, axis: int) -> tuple[Cells, Ints, bool]:
    """Return where body and no body meet at the lower faces, across `axis`, of a box's cells.

    The cells are the body's, on whichever side they lie; last comes whether there is any
    body above those faces.
    """
    cells = [grid(box[0], box[0])]
    direction = [np.empty(0, dtype=np.int64)]
    covered = False
    for above in slabs(box):
        below = above.copy()
        below[:, axis] -= 1
        body_above, body_below = filling.kinds(above) >= 0, filling.kinds(below) >= 0
        upwards, downwards = body_below & ~body_above, body_above & ~body_below
        cells += [below[upwards], above[downwards]]
        direction.append(np.repeat([2 * axis + 1, 2 * axis], [upwards.sum(), downwards.sum()]))
        covered = covered or bool(body_above.any())
    return np.concatenate(cells), np.concatenate(direction), covered


def cells_in_box(filling: Filling, corners: Corners, where: str) -> Selection:
    """Return the squares or cubes in a box; those covered in part take part of the load."""
    cells = _body_cells(filling, _covered(filling.lattice, corners), where)
    if len(cells) == 0:
        raise SceneError(f"{where}: there is no cell of the body in this box")
    part = _part(filling.lattice, cells, corners)
    return Selection(cells, np.full(len(cells), -1, dtype=np.int64), part)


def cells_in_shape(filling: Filling, shape: Shape, where: str) -> Selection:
    """Return the body's cells whose middles lie in a shape."""
    cells = _body_cells(filling, filling.cells_of(shape), where)
    cells = cells[shape.contains(filling.lattice.centres(cells))]
    if len(cells) == 0:
        raise SceneError(f"{where}: there is no middle of a cell of the body in this shape")
    return Selection(cells, np.full(len(cells), -1, dtype=np.int64))


def faces_in_shape(filling: Filling, shape: Shape, where: str) -> Selection:
    """Return the body's free, unheld faces whose middles lie in a shape, as round a hole."""
    lattice = filling.lattice
    lower, upper = filling.cells_of(shape)
    box = (np.maximum(lower - 1, 0), np.minimum(upper + 1, np.asarray(lattice.shape)))
    body = _body_cells(filling, box, where)
    found, arms = [body[:0]], [np.empty(0, dtype=np.int64)]
    for arm in range(lattice.directions):
        middles = lattice.face_middles(body, np.full(len(body), arm))
        beyond = filling.kinds(lattice.neighbours(body, arm))
        chosen = body[(beyond == cell_types.AIR) & shape.contains(middles)]
        found.append(chosen)
        arms.append(np.full(len(chosen), arm, dtype=np.int64))
    cells = np.concatenate(found)
    if len(cells) == 0:
        raise SceneError(
            f"{where}: no middle of a free face of the body lies in this shape; round a hole "
            "take one that is larger by a cell"
        )
    return Selection(cells, np.concatenate(arms))


def _covered(lattice: Lattice, corners: Corners) -> CellBox:
    """Return the cells of the array that a box covers at least in part."""
    shape = np.asarray(lattice.shape, dtype=np.int64)
    lower, upper = (np.asarray(corner) / lattice.cell_size for corner in corners)
    first = np.clip(np.floor(lower + _NEAR), 0, shape).astype(np.int64)
    last = np.clip(np.ceil(upper - _NEAR), 0, shape).astype(np.int64)
    return first, np.maximum(first, last)


def _part(
    lattice: Lattice, cells: Cells, corners: Corners, skip: int | None = None
) -> Floats | None:
    """Return which part of each cell lies in a box, the axis `skip` left out; None: all of all."""
    ends = np.array(corners) / lattice.cell_size
    ends = np.where(np.abs(ends - np.rint(ends)) < _NEAR, np.rint(ends), ends)
    part = np.clip(ends - cells[:, None], 0.0, 1.0)
    if skip is not None:
        part[:, :, skip] = (0.0, 1.0)
    return None if np.all(part[:, 0] == 0.0) and np.all(part[:, 1] == 1.0) else part


def _body_cells(filling: Filling, box: CellBox, where: str) -> Cells:
    lower, upper = box
    box = (lower, np.maximum(lower, upper))
    _check_count(box, where)
    found = [cells[filling.kinds(cells) >= 0] for cells in slabs(box)]
    return np.concatenate([grid(lower, lower), *found])


def _check_count(box: CellBox, where: str) -> None:
    if count(box) > MOST_FACES:
        raise SceneError(
            f"{where}: selects up to {count(box):.3g} cells, more than {MOST_FACES:.0e}; load a "
            "smaller part or take larger cells"
        )


def _check_free(filling: Filling, cells: Cells, direction: Ints, where: str) -> None:
    """Refuse to press on faces whose displacement is given: the ground would take it all."""
    for arm in np.unique(direction):
        chosen = cells[direction == arm]
        beyond = filling.kinds(filling.lattice.neighbours(chosen, int(arm)))
        held = (beyond == cell_types.RIGID) | (beyond == cell_types.DISPLACED)
        if held.any():
            raise SceneError(
                f"{where}: {np.count_nonzero(held)} of its faces are held, first that of cell "
                f"{chosen[held][0].tolist()}, where {cell_types.NAMES[int(beyond[held][0])]} lies "
                "beyond; load the free surface"
            )


_NUDGE = 1e-6  # of a cell: a point this near to a neighbour belongs to both


def select(filling: Filling, load: LoadTable, where: str) -> Selection:
    """Return the faces and cells that a load acts on."""
    lattice = filling.lattice
    if load.force is not None:
        _check_axes(load.force, lattice, f"{where}.force")
    if load.pressure_slope is not None:
        _check_axes(load.pressure_slope, lattice, f"{where}.pressure_slope")
    if load.couple is not None and np.size(load.couple) != 2 * lattice.dimension - 3:
        needed = "three numbers" if lattice.dimension == 3 else "one number"
        raise SceneError(f"{where}.couple: {needed} (N m) are needed, got {load.couple}")
    if load.side is not None and load.side not in lattice.sides:
        raise SceneError(
            f"{where}.side: there is no side {load.side!r}{suggestion(load.side, lattice.sides)}; "
            f"there is {', '.join(lattice.sides)}"
        )
    if load.cell is not None:
        return _into(filling, _named_cell(filling, load.cell, f"{where}.cell"), load, where)
    if load.point is not None:
        return _into(filling, _cells_at(filling, load.point, f"{where}.point"), load, where)
    if load.region is None:
        assert load.side is not None
        return faces_on_side(filling, load.side, f"{where}.side")
    if load.region.box is None:
        shape = load.region.shape_in(lattice.dimension, f"{where}.region")
        if load.force is None:
            return faces_in_shape(filling, shape, f"{where}.region")
        return cells_in_shape(filling, shape, f"{where}.region")
    return _in_region(filling, load, load.region.box, f"{where}.region.box")


def _in_region(filling: Filling, load: LoadTable, box: Corners, where: str) -> Selection:
    assert load.region is not None
    region = load.region
    for corner in box:
        _check_axes(corner, filling.lattice, where)
    flat = region.flat_axis(filling.lattice.cell_size, where)
    if flat is not None:
        return faces_on_plane(filling, box, flat, where)
    if load.force is None:
        what = "couple" if load.pressure is None else "pressure"
        raise SceneError(
            f"{where}: a {what} acts on a surface; give the box no thickness along one axis, or "
            "take another shape"
        )
    if not filling.lattice.boxes:
        lower, upper = (tuple(corner) for corner in box)
        return cells_in_shape(filling, Box(lower, upper), where)
    return cells_in_box(filling, box, where)


def _check_axes(numbers: tuple[float, ...], lattice: Lattice, where: str) -> None:
    if len(numbers) != lattice.dimension:
        raise SceneError(
            f"{where}: {list(numbers)} should have {lattice.dimension} numbers, one for each "
            "axis of the cells"
        )


def _named_cell(filling: Filling, cell: tuple[int, ...], where: str) -> Cells:
    lattice = filling.lattice
    _check_axes(cell, lattice, where)
    cells = np.array([cell], dtype=np.int64)
    if not lattice.contains(cells)[0]:
        raise SceneError(
            f"{where}: {list(cell)} lies outside the array of "
            f"{' x '.join(map(str, lattice.shape))} cells, which count from 0"
        )
    kind = int(filling.kinds(cells)[0])
    if kind < 0:
        raise SceneError(
            f"{where}: {list(cell)} is {cell_types.NAMES[kind]}, not body; "
            "choose a cell of material"
        )
    return cells


def _cells_at(filling: Filling, point: tuple[float, ...], where: str) -> Cells:
    """Return the body cells that a point lies in or on: several if it lies between them."""
    lattice = filling.lattice
    _check_axes(point, lattice, where)
    if not all(
        -_NUDGE <= x / edge <= 1.0 + _NUDGE for x, edge in zip(point, lattice.extent, strict=True)
    ):
        raise SceneError(
            f"{where}: {list(point)} m lies outside the array, which goes from 0 to "
            f"{list(lattice.extent)} m"
        )
    around = np.array(list(product((-1.0, 1.0), repeat=lattice.dimension)))
    if not lattice.boxes:
        around = np.concatenate([around, lattice.normals])
    nearby = np.asarray(point) + _NUDGE * lattice.cell_size * around
    cells = np.unique(lattice.locate(nearby), axis=0)
    found = filling.kinds(cells)
    if not np.any(found >= 0):
        named = " and ".join(sorted({cell_types.NAMES[int(kind)] for kind in found}))
        raise SceneError(
            f"{where}: {list(point)} m lies in cell {cells[0].tolist()}, where there is {named}, "
            "not body; choose a point in or on the body"
        )
    return cells[found >= 0]


def _into(filling: Filling, cells: Cells, load: LoadTable, where: str) -> Selection:
    """Return the faces by which a load enters single cells."""
    if load.side is not None:
        lattice = filling.lattice
        arms = [lattice.arms_of_side(load.side, form) for form in lattice.form(cells)]
        direction = np.array([arm for some in arms for arm in some], dtype=np.int64)
        cells = np.repeat(cells, [len(some) for some in arms], axis=0)
    elif load.force is not None:
        force = np.asarray(load.force)
        entries = [_entering(filling, cell, force) for cell in cells]
        direction = np.array(entries, dtype=np.int64)
    else:
        raise SceneError(f"{where}.side: is needed to press on a single cell with a pressure")
    offset = None
    # In solids a force at a point acts in the middle of its cell's face.
    plane = filling.lattice.boxes and filling.lattice.dimension == 2
    if load.point is not None and load.force is not None and plane:
        # A point on a line between cells is in the middle of those that share its force.
        place = np.asarray(load.point) / filling.lattice.cell_size
        between = np.abs(place - np.rint(place)) <= 2.0 * _NUDGE
        offset = np.where(between, 0.0, place - cells - 0.5)
    return Selection(cells, direction, offset=offset)


def _entering(filling: Filling, cell: Ints, force: Floats) -> int:
    """Return the face whose outward normal is most opposed to a force.

    Of two equally opposed faces the one on the surface counts; if that does not settle it,
    the force enters in the middle (-1), so that a mirrored scene stays mirrored.
    """
    lattice = filling.lattice
    arms = np.array(lattice.arms[int(lattice.form(cell[None])[0])])
    along = lattice.normals[arms] @ (force / np.abs(force).max())
    faces = arms[along <= along.min() + 1e-9]
    if len(faces) > 1:
        beyond = [lattice.neighbours(cell[None], int(face)) for face in faces]
        exposed = faces[filling.kinds(np.concatenate(beyond)) < 0]
        faces = exposed if len(exposed) else faces
    return int(faces[0]) if len(faces) == 1 else -1


PUSH: Final = 1
PULL: Final = -1
BY_SIDE: Final = 0
BY_SURFACE: Final = 2


class Uneven(NamedTuple):
    """How forces lie on faces that they cover in part, or not evenly.

    The traction at x in the part is force / (size of the part) + growth · (x - its middle), by
    the whole face, x in cells.
    """

    row: Ints
    """Which of the forces, shape (m,)."""
    part: Floats
    """Lower and upper corner of what each covers, from 0 to 1, shape (m, 2, dimension)."""
    growth: Floats
    """Of each component of the force, along each axis, shape (m, dimension, dimension)."""

    def within(self, some: NDArray[np.bool_]) -> Uneven:
        """Return what is left of it if only some of the forces are kept."""
        kept = some[self.row]
        return Uneven((np.cumsum(some) - 1)[self.row[kept]], self.part[kept], self.growth[kept])


@dataclass(frozen=True, eq=False)
class AppliedLoads:
    """Forces on cells."""

    cells: Cells
    """The cells that take the forces, shape (n, dimension); a cell may occur more than once."""
    direction: Ints
    """Index of the face by which the force enters, -1 for the cell's middle, shape (n,)."""
    force: Floats
    """The forces (N), shape (n, dimension)."""
    sense: NDArray[np.int8] | None = None
    """What the scene says of the force: `PUSH`, `PULL`, or nothing. Then its side decides
    (`BY_SIDE`), or, where the scene names none, the surface (`BY_SURFACE`)."""
    uneven: Uneven | None = None
    """Which of the forces do not lie evenly on whole faces."""


def at_stage(
    contents: Contents,
    loads: Sequence[LoadTable],
    selections: Sequence[Selection],
    stage: int,
    thickness: float,
    gravity: tuple[float, ...] | None,
) -> AppliedLoads:
    """Return all forces at a stage of loading; gravity acts in full from the first stage."""
    lattice = contents.filling.lattice
    parts, uneven, count = [_nothing(lattice.dimension)], [], 0
    for load, chosen in zip(loads, selections, strict=True):
        factor = min(1.0, stage / load.steps)
        force = chosen.forces(load, lattice, thickness)
        if lattice.boxes:
            found = chosen.uneven(load, force, lattice, thickness)
            uneven.append(Uneven(found.row + count, found.part, factor * found.growth))
        count += len(force)
        sense = np.full(len(force), _said(load), dtype=np.int8)
        parts.append(AppliedLoads(chosen.cells, chosen.direction, factor * force, sense))
    if gravity is not None and any(gravity):
        parts.append(weight(contents, gravity, thickness))
    return AppliedLoads(
        np.concatenate([part.cells for part in parts]),
        np.concatenate([part.direction for part in parts]),
        np.concatenate([part.force for part in parts]),
        np.concatenate([_senses(part) for part in parts]),
        Uneven(*map(np.concatenate, zip(*uneven, strict=True))) if uneven else None,
    )


def _said(load: LoadTable) -> int:
    """Return what a load's description says of its sense."""
    if load.sense is not None:
        return PUSH if load.sense == "push" else PULL
    return BY_SURFACE if load.side is None and load.region is None else BY_SIDE


def _senses(part: AppliedLoads) -> NDArray[np.int8]:
    return np.full(len(part.force), BY_SIDE, dtype=np.int8) if part.sense is None else part.sense


def _nothing(dimension: int) -> AppliedLoads:
    no_cells = np.empty((0, dimension), dtype=np.int64)
    return AppliedLoads(no_cells, np.empty(0, dtype=np.int64), np.empty((0, dimension)))


def weight(contents: Contents, gravity: tuple[float, ...], thickness: float) -> AppliedLoads:
    """Return the weight of every cell of the body, in the cell's middle."""
    filling = contents.filling
    volume = filling.lattice.cell_volume(thickness)
    mass = np.array([(material.density or 0.0) * volume for material in contents.materials])
    cells, masses = [np.empty((0, filling.lattice.dimension), dtype=np.int64)], [np.empty(0)]
    for slab in slabs(filling.bounds()):
        found = filling.kinds(slab)
        body = found >= 0
        cells.append(slab[body])
        masses.append(mass[found[body]])
    all_cells = np.concatenate(cells)
    middle = np.full(len(all_cells), -1, dtype=np.int64)
    return AppliedLoads(all_cells, middle, np.outer(np.concatenate(masses), gravity))


def check_gravity(contents: Contents, gravity: tuple[float, ...] | None) -> None:
    """Refuse gravity on a body without density or on one too large to be weighed by cells."""
    if gravity is None:
        return
    dimension = contents.filling.lattice.dimension
    if len(gravity) != dimension:
        raise SceneError(
            f"body.gravity: {dimension} numbers are needed, one for each axis, got {list(gravity)}"
        )
    for material in contents.materials if any(gravity) else ():
        if material.density is None:
            raise SceneError(
                f"materials.{material.name}.density: is needed, for gravity acts (kg/m³)"
            )
    cells = count(contents.filling.bounds())
    if any(gravity) and cells > MOST_FACES:
        raise SceneError(
            f"body.gravity: would load each of up to {cells:.3g} cells, more than "
            f"{MOST_FACES:.0e}; take larger cells or leave gravity out"
        )
