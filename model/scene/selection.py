"""Where loads act: from a description to cells and faces, and to the forces on them by stages.

A selection is made of integer ranges and of the cells in them; the body is never
rasterised for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SceneError
from kaju.model.scene import cell_types
from kaju.model.scene.validation import check_axes

from .description import Description, LoadTable
from .lattice import Cells, Lattice
from .resolved_body import CellBox, ResolvedBody, count, grid, slabs
from .shapes import Box, Shape

MOST_FACES = 50_000_000
"""A load acts on at most this many faces or cells."""

_NEAR = 1e-6  # of a cell: a coordinate this near to a face lies on it
Corners = tuple[tuple[float, ...], tuple[float, ...]]

PUSH: Final = 1
PULL: Final = -1
BY_SIDE: Final = 0
BY_SURFACE: Final = 2


class Uneven(NamedTuple):
    """How forces lie on faces that they cover in part, or not evenly.

    The traction at x in the part is force / (size of the part) + growth · (x - its middle), by
    the whole face, x in cells.
    """

    row: Ints  # which of the forces, shape (m,)
    part: Floats  # lower and upper corner covered of each, 0 to 1, shape (m, 2, dimension)
    growth: Floats  # of each component of the force, along each axis, (m, dimension, dimension)

    def within(self, some: Flags) -> Uneven:
        """Return the rows of the forces that are kept, renumbered."""
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

    def within(self, lower: Ints, upper: Ints) -> AppliedLoads:
        """Return those that act in a box of cells, counted from its corner."""
        inside = np.all((self.cells >= lower) & (self.cells < upper), axis=1)
        kept = self.cells[inside] - lower, self.direction[inside], self.force[inside]
        return AppliedLoads(*kept, uneven=self.uneven and self.uneven.within(inside))


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
    """How far (in cells) a force at a point acts from the middle of those that share it, shape
    (n, dimension)."""

    def beyond(self, lattice: Lattice) -> Cells:
        """Return the cells that lie beyond the faces."""
        return np.asarray(self.cells + lattice.steps[lattice.form(self.cells), self.direction])

    @property
    def share(self) -> Floats:
        """Part of each face (or cell) that the load covers, up to 1."""
        if self.part is None:
            return np.ones(len(self.cells))
        return np.asarray((self.part[:, 1] - self.part[:, 0]).prod(axis=1))

    def uneven(self, load: LoadTable, force: Floats, lattice: Lattice, thickness: float) -> Uneven:
        """Return which faces the load covers in part, or not evenly, and how."""
        n, d = self.cells.shape
        whole = np.tile(np.array([[0.0], [1.0]]), (n, 1, d))
        part = whole if self.part is None else self.part
        direction, growth = self.direction, np.zeros((n, d, d))
        if load.pressure_slope is not None:
            change = np.asarray(load.pressure_slope) * lattice.cell_size
            area = lattice.face_area(thickness)
            growth = -area * lattice.normals[direction][:, :, None] * change
        if self.offset is not None:  # the linear pressure of the moment about the face's middle
            row, axis = np.arange(n), np.maximum(direction, 0) // 2
            lever = self.offset - 0.5 * lattice.normals[direction]
            across = lever[row, 1 - axis] * force[row, axis]
            growth[row, axis, 1 - axis] = 12.0 * (across - lever[row, axis] * force[row, 1 - axis])
        growth[np.arange(n), :, np.maximum(direction, 0) // 2] = 0.0  # none along the normal
        partly = (part != whole).any(axis=(1, 2))
        row = np.flatnonzero((growth.any(axis=(1, 2)) | partly) & (direction >= 0))
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
            pressure = pressure + self._middles(lattice) @ np.asarray(load.pressure_slope)
        return -(pressure * area)[:, None] * lattice.normals[self.direction]

    def _middles(self, lattice: Lattice) -> Floats:
        """Return the middles of what is covered of the faces, or cells (m)."""
        middle = lattice.face_middles(self.cells, self.direction)
        if self.part is None:
            return middle
        return np.asarray(middle + (self.part.mean(axis=1) - 0.5) * lattice.cell_size)

    def _couple(self, moment: Floats, lattice: Lattice) -> Floats:
        """Return forces a × r, r from their middle, without a sum, whose moment (N m) is given."""
        lever = self._middles(lattice)
        lever = lever - self.share @ lever / self.share.sum()
        lever = np.pad(lever, ((0, 0), (0, 3 - lever.shape[1])))
        square = np.einsum("n,ni,nj->ij", self.share, lever, lever)
        inertia = np.trace(square) * np.eye(3) - square
        wanted = np.pad(moment, (3 - len(moment), 0))
        turn = np.linalg.lstsq(inertia, wanted, rcond=1e-9)[0]
        if np.abs(inertia @ turn - wanted).max() > 1e-6 * np.abs(wanted).max():
            raise SceneError(
                "couple: needs faces at a distance from each other, and has one face, or faces "
                "on one line along it; take a larger side or region, or two cells across it"
            )
        forces: Floats = self.share[:, None] * np.cross(turn, lever)
        return forces[:, : lattice.dimension]


def select(body: ResolvedBody, load: LoadTable, where: str) -> Selection:
    """Return the faces and cells that a load acts on."""
    lattice = body.lattice
    if load.outline is not None:
        raise SceneError(
            f"{where}.outline: no region called {load.outline!r} has a true outline; give one "
            'outline = "true"'
        )
    load.check_in(lattice, where)
    if load.cell is not None or load.point is not None:
        return _entered(body, load, where)
    if load.region is None:
        assert load.side is not None
        return _faces_on_side(body, load.side, f"{where}.side")
    if load.region.box is not None:
        return _in_box(body, load, load.region.box, f"{where}.region.box")
    shape = load.region.shape_in(lattice, f"{where}.region")
    inside = _faces_in_shape if load.force is None else _cells_in_shape
    return inside(body, shape, f"{where}.region")


def _in_box(body: ResolvedBody, load: LoadTable, corners: Corners, where: str) -> Selection:
    """Return the surface in a box without thickness, or the cells in one with it."""
    lattice = body.lattice
    assert load.region is not None
    if (flat := load.region.flat_axis(lattice, where)) is not None:
        return _faces_on_plane(body, corners, flat, where)
    if load.force is None:
        what = "couple" if load.pressure is None else "pressure"
        raise SceneError(
            f"{where}: a {what} acts on a surface; give the box no thickness along one axis, or "
            "take another shape"
        )
    if not lattice.boxes:
        return _cells_in_shape(body, Box(*corners), where)
    cells = _body_cells(body, _covered(lattice, corners), where)
    if len(cells) == 0:
        raise SceneError(f"{where}: there is no cell of the body in this box")
    return Selection(cells, np.full(len(cells), -1), _part(lattice, cells, corners))


def _cells_in_shape(body: ResolvedBody, shape: Shape, where: str) -> Selection:
    """Return the body's cells whose middles lie in a shape."""
    cells = _body_cells(body, body.cells_of(shape), where)
    cells = cells[shape.contains(body.lattice.centres(cells))]
    if len(cells) == 0:
        raise SceneError(f"{where}: no cell of the body has its middle in this shape")
    return Selection(cells, np.full(len(cells), -1))


def _faces_in_shape(body: ResolvedBody, shape: Shape, where: str) -> Selection:
    """Return the body's free, unheld faces whose middles lie in a shape, as round a hole."""
    lattice = body.lattice
    lower, upper = body.cells_of(shape)
    box = np.maximum(lower - 1, 0), np.minimum(upper + 1, lattice.shape)
    faces = _surface(body, dict.fromkeys(range(lattice.directions), box), where)
    beyond = body.kinds(faces.beyond(lattice))
    inside = shape.contains(lattice.face_middles(faces.cells, faces.direction))
    chosen = (beyond == cell_types.AIR) & inside
    if not chosen.any():
        raise SceneError(
            f"{where}: no free face of the body has its middle in this shape; around a hole take "
            "a shape that is larger by a cell"
        )
    return Selection(faces.cells[chosen], faces.direction[chosen])


def _surface(body: ResolvedBody, boxes: Mapping[int, CellBox], where: str) -> Selection:
    """Return the surface of the body along directions, each within a box of cells."""
    cells, repeats = [], []
    for direction, box in boxes.items():
        inside = _body_cells(body, box, where)
        surface = inside[body.kinds(body.lattice.neighbours(inside, direction)) < 0]
        cells.append(surface)
        repeats.append(len(surface))
    return Selection(np.concatenate(cells), np.repeat(np.array([*boxes]), repeats))


def _faces_on_side(body: ResolvedBody, side: str, where: str) -> Selection:
    """Return all faces of the body that look out of the array on one of its sides."""
    lattice = body.lattice
    number = lattice.sides.index(side)
    layer = body.layer(body.bounds(), number)
    directions = [number] if lattice.boxes else range(lattice.directions)
    faces = _surface(body, dict.fromkeys(directions, layer), where)
    out = lattice.side_beyond(faces.beyond(lattice)) == number
    if not out.any():
        raise SceneError(
            f"{where}: no cell of the body lies at the {side} of the array; select the surface "
            "by a region = {box = [lower corner, upper corner]} without thickness"
        )
    chosen = Selection(faces.cells[out], faces.direction[out])
    _check_free(body, chosen, where)
    return chosen


def _faces_on_plane(body: ResolvedBody, corners: Corners, axis: int, where: str) -> Selection:
    """Return the surface in a box without thickness; faces covered in part take a part."""
    lattice = body.lattice
    if not lattice.boxes:
        raise SceneError(
            f"{where}: {lattice.kind}s have no faces in a plane; use side, cell, or a box with "
            "thickness"
        )
    plane = round(corners[0][axis] / lattice.cell_size)
    off = abs(corners[0][axis] / lattice.cell_size - plane)
    here = f"{'xyz'[axis]} = {corners[0][axis]:g} m"
    if off > _NEAR or not 0 <= plane <= lattice.shape[axis]:
        near = min(max(plane, 0), lattice.shape[axis]) * lattice.cell_size
        raise SceneError(f"{where}: no faces of cells lie at {here}; the nearest are at {near:g} m")
    lower, upper = _covered(lattice, corners)
    lower[axis], upper[axis] = plane, plane + 1
    if count((lower, upper)) == 0:
        raise SceneError(f"{where}: lies outside the array, which goes from 0 to {lattice.extent}")
    # Faces of the body below the plane look upwards, those of the body above it downwards.
    below = np.where(np.arange(len(lower)) == axis, 1, 0)
    boxes = {2 * axis + 1: (lower - below, upper - below), 2 * axis: (lower, upper)}
    chosen = _surface(body, boxes, where)
    if len(chosen.cells) == 0:
        covered = len(_body_cells(body, (lower, upper), where))
        inside = "inside the body" if covered else "in the air or on the ground"
        raise SceneError(
            f"{where}: no surface of the body lies in this box at {here}, {inside}; move the box"
        )
    _check_free(body, chosen, where)
    part = _part(lattice, chosen.cells, corners, skip=axis)
    return Selection(chosen.cells, chosen.direction, part)


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


def _body_cells(body: ResolvedBody, box: CellBox, where: str) -> Cells:
    """Return the cells of the body in a box."""
    lower, upper = box
    box = (lower, np.maximum(lower, upper))
    if count(box) > MOST_FACES:
        raise SceneError(
            f"{where}: selects up to {count(box):.3g} cells, more than {MOST_FACES:.0e}; load a "
            "smaller part or take larger cells"
        )
    found = [cells[body.kinds(cells) >= 0] for cells in slabs(box)]
    return np.concatenate([grid(lower, lower), *found])


def _check_free(body: ResolvedBody, chosen: Selection, where: str) -> None:
    """Refuse to press on faces whose displacement is given: the ground would take it all."""
    beyond = body.kinds(chosen.beyond(body.lattice))
    held = (beyond == cell_types.RIGID) | (beyond == cell_types.DISPLACED)
    if held.any():
        raise SceneError(
            f"{where}: {np.count_nonzero(held)} of its faces are held, first that of cell "
            f"{chosen.cells[held][0].tolist()}, where {cell_types.NAMES[int(beyond[held][0])]} "
            "lies beyond; load the free surface"
        )


def _single_cells(body: ResolvedBody, load: LoadTable, where: str) -> Cells:
    """Return the body's cell that is named, or those that a point lies in or on."""
    lattice = body.lattice
    if load.cell is not None:
        key, place = "cell", f"{list(load.cell)}"
        check_axes(load.cell, lattice.dimension, f"{where}.cell")
        cells = np.array([load.cell], dtype=np.int64)
    else:
        assert load.point is not None
        key, place = "point", f"{list(load.point)} m"
        check_axes(load.point, lattice.dimension, f"{where}.point")
        around = np.array(list(product((-1.0, 1.0), repeat=lattice.dimension)))
        if not lattice.boxes:
            around = np.concatenate([around, lattice.normals])
        nearby = np.array(load.point) + _NEAR * lattice.cell_size * around
        cells = np.unique(lattice.locate(nearby), axis=0)
    if not lattice.contains(cells).any():
        raise SceneError(
            f"{where}.{key}: {place} lies outside the array of "
            f"{' x '.join(map(str, lattice.shape))} cells, which goes from 0 to "
            f"{list(lattice.extent)} m"
        )
    found = body.kinds(cells)
    if not np.any(found >= 0):
        named = " and ".join(sorted({cell_types.NAMES[int(kind)] for kind in found}))
        raise SceneError(
            f"{where}.{key}: {place} is {named}, not body; choose a place in or on the body"
        )
    return cells[found >= 0]


def _entered(body: ResolvedBody, load: LoadTable, where: str) -> Selection:
    """Return the faces by which a load enters single cells."""
    lattice, cells = body.lattice, _single_cells(body, load, where)
    if load.side is not None:
        faces = [lattice.arms_of_side(load.side, form) for form in lattice.form(cells)]
        direction = np.array([face for some in faces for face in some], dtype=np.int64)
        cells = np.repeat(cells, [len(some) for some in faces], axis=0)
    elif load.force is not None:
        force = np.asarray(load.force)
        direction = np.array([_entry_face(body, cell, force) for cell in cells], dtype=np.int64)
    else:
        raise SceneError(f"{where}.side: is needed to press on a single cell with a pressure")
    offset = None
    # In solids a force at a point acts in the middle of its cell's face.
    if load.point is not None and load.force is not None and lattice.boxes and len(load.point) == 2:
        place = np.asarray(load.point) / lattice.cell_size
        offset = np.tile(place - (cells + 0.5).mean(axis=0), (len(cells), 1))
    return Selection(cells, direction, offset=offset)


def _entry_face(body: ResolvedBody, cell: Ints, force: Floats) -> int:
    """Return the face whose outward normal is most opposed to a force.

    Of two equally opposed faces the one on the surface counts; if that does not settle it,
    the force enters in the middle (-1), so that a mirrored scene stays mirrored.
    """
    lattice = body.lattice
    arms = np.array(lattice.arms[int(lattice.form(cell[None])[0])])
    along = lattice.normals[arms] @ (force / np.abs(force).max())
    faces = arms[along <= along.min() + 1e-9]
    if len(faces) > 1:
        beyond = [lattice.neighbours(cell[None], int(face)) for face in faces]
        exposed = faces[body.kinds(np.concatenate(beyond)) < 0]
        faces = exposed if len(exposed) else faces
    return int(faces[0]) if len(faces) == 1 else -1


def at_stage(
    scene: Description, body: ResolvedBody, selections: Sequence[Selection], stage: int
) -> AppliedLoads:
    """Return all forces at a stage of loading; gravity acts in full from the first stage."""
    lattice, gravity, thickness = body.lattice, scene.body.gravity, scene.body.thickness or 1.0
    no_cells = np.empty((0, lattice.dimension), dtype=np.int64)
    parts = [(no_cells, no_cells[:, 0], np.empty(no_cells.shape), BY_SIDE)]
    uneven, first = [], 0
    for load, chosen in zip(scene.loads, selections, strict=True):
        factor = min(1.0, stage / load.steps)
        force = chosen.forces(load, lattice, thickness)
        even = chosen.part is None and chosen.offset is None and load.pressure_slope is None
        if lattice.boxes and not even:
            found = chosen.uneven(load, force, lattice, thickness)
            uneven.append(Uneven(found.row + first, found.part, factor * found.growth))
        first += len(force)
        sense = BY_SURFACE if load.side is None and load.region is None else BY_SIDE
        if load.sense is not None:
            sense = PUSH if load.sense == "push" else PULL
        parts.append((chosen.cells, chosen.direction, factor * force, sense))
    if gravity is not None and any(gravity):
        cells = _body_cells(body, body.bounds(), "body.gravity")
        density = np.array([material.density or 0.0 for material in body.materials])
        mass = density[body.kinds(cells)] * lattice.cell_volume(thickness)
        parts.append((cells, np.full(len(cells), -1), np.outer(mass, gravity), BY_SIDE))
    places, directions, forces, senses = zip(*parts, strict=True)
    return AppliedLoads(
        np.concatenate(places),
        np.concatenate(directions),
        np.concatenate(forces),
        np.repeat(np.array(senses, dtype=np.int8), [*map(len, places)]),
        Uneven(*map(np.concatenate, zip(*uneven, strict=True))) if uneven else None,
    )


def check_gravity(body: ResolvedBody, gravity: tuple[float, ...] | None) -> None:
    """Refuse gravity on a body without density or on one too large to be weighed by cells."""
    if gravity is None:
        return
    check_axes(gravity, body.lattice.dimension, "body.gravity")
    for material in body.materials if any(gravity) else ():
        if material.density is None:
            raise SceneError(
                f"materials.{material.name}.density: is needed, for gravity acts (kg/m³)"
            )
    cells = count(body.bounds())
    if any(gravity) and cells > MOST_FACES:
        raise SceneError(
            f"body.gravity: would load each of up to {cells:.3g} cells, more than "
            f"{MOST_FACES:.0e}; take larger cells or leave gravity out"
        )
