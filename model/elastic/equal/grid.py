"""The grid that a scene is solved on: its own cells, or as many smaller ones as it takes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.errors import ParameterError, SceneError, SupportError
from kaju.model.elastic.moduli import moduli_of
from kaju.model.elastic.scales import Scales
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, DISPLACED, RIGID
from kaju.model.scene.lattices import check_boxes

from .cell_loads import face_forces
from .problem import (
    SIDES,
    CellLoads,
    ElasticProblem,
    FaceFields,
    Side,
    face_zeros,
    rim_layer,
)
from .supports import check_supports, slender_cell

Origin = tuple[int, ...]


def problem_of_scene(
    scene: Scene, stage: int | None = None, stiffness: Floats | None = None
) -> tuple[ElasticProblem, Origin]:
    """Return the problem that a scene poses, cut to the box around its body.

    With it comes the scene's cell that is the problem's first. `stiffness` is what the materials'
    moduli are multiplied by, cell by cell: every cell of material is a kind of its own then,
    numbered row by row.
    """
    lattice = scene.lattice
    check_boxes(lattice)
    lower, upper = (np.asarray(corner, dtype=np.int64) for corner in scene.bounds())
    # All cells with what lies beyond the sides, and the sides that need a number.
    rim = np.pad(scene.rasterise().astype(np.int32), 1, constant_values=AIR)
    sides: dict[str, Side] = {}
    for index, name in enumerate(lattice.sides):
        condition = scene.side_condition(name)
        axis, upper_end = divmod(index, 2)
        layer = rim_layer(lattice.dimension, index)
        rim[layer] = RIGID if condition.code == DISPLACED else condition.code
        reached = upper[axis] == lattice.shape[axis] if upper_end else lower[axis] == 0
        if reached and condition.stiffness is not None:
            sides[name] = ("foundation", condition.stiffness)
        elif reached and condition.displacement is not None:
            sides[name] = ("displacement", condition.displacement)
    box = tuple(slice(int(a), int(b) + 2) for a, b in zip(lower, upper, strict=True))
    loads = CellLoads.of(scene.applied(stage), lower, upper)
    constants = np.array([(m.youngs_modulus, m.poissons_ratio) for m in scene.cell_materials])
    kinds = np.ascontiguousarray(rim[box])
    if stiffness is not None:
        body = kinds >= 0
        constants = constants[kinds[body]]
        constants[:, 0] *= np.pad(stiffness, 1)[box][body]
        kinds[body] = np.arange(len(constants))
    try:
        problem = problem_of(
            kinds,
            constants,
            lattice.cell_size,
            plane=scene.plane,
            thickness=scene.thickness,
            sides=sides,
            loads=loads,
        )
    except ParameterError as error:
        names = ", ".join(material.name for material in scene.cell_materials)
        raise ParameterError(f"materials ({names}): {error}") from error
    return problem, tuple(int(i) for i in lower)


def problem_of(
    rim: NDArray[np.int32],
    materials: Sequence[tuple[float, float]] | Floats,
    cell_size: float,
    *,
    plane: Literal["stress", "strain"] | None,
    thickness: float,
    sides: Mapping[str, Side],
    loads: CellLoads | None,
    scales: Scales | None = None,
) -> ElasticProblem:
    """Build a problem from an array of cells.

    `rim` has the index into `materials` (Young's modulus in Pa, Poisson's ratio) of each cell, or
    AIR, RIGID; with one layer more that says what lies beyond the sides. Cell size and thickness
    are in metres; the thickness counts in two dimensions only. `sides` name the number that what
    lies beyond needs. With `scales` given the cells may be a part of a body, even without material.
    """
    table = np.asarray(materials, dtype=np.float64).reshape(-1, 2)
    if scales is None:
        if not np.any(rim >= 0):
            raise SceneError("body: no cell is of a material, so there is nothing to solve")
        scales = _scales(rim, table, cell_size, thickness, sides, loads)
    fixed, spring = _side_fields(rim, sides, scales)
    problem = ElasticProblem(
        kinds=rim,
        moduli=moduli_of(table[:, 0] / scales.modulus, table[:, 1], plane),
        force=face_zeros(rim),
        fixed=fixed,
        spring=spring,
        surface_shear={},
        scales=scales,
        plane=plane,
        thickness=thickness if rim.ndim == 2 else 1.0,
    )
    if loads is not None and len(loads.force):
        face_forces(problem, loads)
    return problem


def _scales(
    rim: NDArray[np.int32],
    table: Floats,
    cell_size: float,
    thickness: float,
    sides: Mapping[str, Side],
    loads: CellLoads | None,
) -> Scales:
    """Return units in which the largest modulus and the largest force are one."""
    used = slice(None) if len(table) == 1 else np.unique(rim[rim >= 0])
    modulus = float(np.max(table[used, 0]))
    stiffness = modulus * (thickness if rim.ndim == 2 else cell_size)
    moved = [float(np.abs(side[1]).max()) for side in sides.values() if side[0] == "displacement"]
    peak = 0.0 if loads is None or not len(loads.force) else float(np.abs(loads.force).max())
    force = max([peak, *(stiffness * displacement for displacement in moved)])
    return Scales.of(modulus, force, cell_size, stiffness)


def _side_fields(
    rim: NDArray[np.int32], sides: Mapping[str, Side], scales: Scales
) -> tuple[FaceFields, FaceFields]:
    """Return the given displacements and the foundation's stiffness of all faces, scaled."""
    fixed, spring = face_zeros(rim), face_zeros(rim)
    for name, side in sides.items():
        index = SIDES[rim.ndim].index(name)
        value = np.asarray(side[1], dtype=np.float64)
        axis, (own, beyond) = index // 2, (-2, -1) if index % 2 else (1, 0)
        if side[0] == "foundation":
            layer = list(rim_layer(rim.ndim, index))
            layer[axis] = own
            spring[axis][tuple(layer)] = float(value) * scales.length / scales.modulus
            continue
        # Its faces, and the ghosts within it; rigid cells inside the array stay where they are.
        for component, moved in enumerate(value / scales.displacement):
            lines = np.moveaxis(fixed[component], axis, 0)
            if component == axis:
                lines[own][np.moveaxis(rim, axis, 0)[own] != RIGID] = moved
            else:
                lines[beyond] = moved
    return fixed, spring


class Grid(NamedTuple):
    """A scene on the cells on which it is solved."""

    scene: Scene  # The scene, refined
    problem: ElasticProblem  # Its arrays
    origin: Origin  # Cell of the scene at which the arrays start
    division: int  # Cells per cell of the scene that was asked about, along every axis
    notes: tuple[str, ...] = ()  # What was changed by itself, in words

    @property
    def narrow(self) -> str:
        """Where a member is one cell wide, "" if none is."""
        cell = slender_cell(self.problem)
        if cell is None:
            return ""
        return f"({', '.join(str(a + b) for a, b in zip(cell, self.origin, strict=True))})"


def grid_of(
    scene: Scene,
    stage: int | None,
    division: int = 1,
    known: ElasticProblem | None = None,
    stiffness: Floats | None = None,
) -> Grid:
    """Return the grid of a scene, with a relative stiffness of each of its cells if given.

    Its cells are halved where a member, or what holds the body against turning, is one cell wide:
    neither resists on this grid. A body that is supported like the `known` one needs no check.
    """

    def refined(times: int) -> Grid:
        fine = scene if times == 1 else scene.refine(times)
        return Grid(fine, *problem_of_scene(fine, stage, repeated(stiffness, times)), times)

    grid = refined(division)
    if known is not None and _held_alike(grid.problem, known):
        return grid
    narrow, loose = grid.narrow, None
    if not narrow:
        try:
            check_supports(grid.problem, grid.origin, division)
            return grid
        except SupportError as error:
            if "could turn" not in str(error):
                raise
            loose = error
    finer = refined(2 * division)
    if narrow and finer.narrow:
        raise SceneError(
            f"body: a member is one cell wide at cell {finer.narrow} of the grid refined by "
            f"{2 * division} and carries no shear; widen it, or give a larger resolution"
        )
    try:
        check_supports(finer.problem, finer.origin, 2 * division)
    except SupportError as error:
        raise loose or error from None
    reason = f"a member is one cell wide at {narrow}"
    if loose is not None:
        reason = "a single rigid cell holds no turn"
    return finer._replace(notes=(f"{reason}: the cells were halved",))


def _held_alike(ours: ElasticProblem, theirs: ElasticProblem) -> bool:
    """Tell whether two problems are of cells in the same places, alike supported."""
    one, other = (np.minimum(problem.kinds, 0) for problem in (ours, theirs))
    pairs = zip((one, *ours.spring), (other, *theirs.spring), strict=True)
    return all(np.array_equal(a, b) for a, b in pairs)


def repeated(stiffness: Floats | None, division: int) -> Floats | None:
    """Return a field of stiffness on cells so many times smaller."""
    if stiffness is not None:
        for axis in range(stiffness.ndim):
            stiffness = np.repeat(stiffness, division, axis)
    return stiffness
