"""The grid that a scene is solved on: its own cells, or as many smaller ones as it takes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats, Ints
from kaju.errors import ParameterError, SceneError, SupportError
from kaju.model.elastic.moduli import constants_of, moduli_of
from kaju.model.elastic.scales import Scales
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, DISPLACED, RIGID
from kaju.model.scene.lattice import check_boxes
from kaju.model.scene.selection import AppliedLoads
from kaju.model.scene.sides import SideCondition

from .cell_loads import face_forces
from .problem import ElasticProblem, FaceFields, face_zeros, rim_layer
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
    # All cells with what lies beyond the sides.
    rim = np.pad(scene.rasterise().astype(np.int32), 1, constant_values=AIR)
    for index, name in enumerate(lattice.sides):
        code = scene.side_condition(name).code
        rim[rim_layer(lattice.dimension, index)] = RIGID if code == DISPLACED else code
    box = tuple(slice(int(a), int(b) + 2) for a, b in zip(lower, upper, strict=True))
    constants = constants_of(scene)
    kinds = np.ascontiguousarray(rim[box])
    body = kinds >= 0
    if not body.any():
        raise SceneError("body: no cell is of a material, so there is nothing to solve")
    if stiffness is not None:
        constants = constants[kinds[body]]
        constants[:, 0] *= np.pad(stiffness, 1)[box][body]
        kinds[body] = np.arange(len(constants))
    used = constants if len(constants) == 1 else constants[np.unique(kinds[body])]
    loads = scene.applied(stage).within(lower, upper)
    try:
        modulus, sides = float(used[:, 0].max()), sides_of(scene, lower, upper).values()
        scales = Scales.of_cells(scene, modulus, loads.force, sides)
        problem = problem_of(scene, kinds, constants, (lower, upper), loads, scales)
    except ParameterError as error:
        names = ", ".join(material.name for material in scene.cell_materials)
        raise ParameterError(f"materials ({names}): {error}") from error
    return problem, tuple(int(i) for i in lower)


def sides_of(scene: Scene, lower: Ints, upper: Ints) -> dict[int, SideCondition]:
    """Return the conditions of the sides that a box of cells reaches, by their number."""
    found = {}
    for index, name in enumerate(scene.lattice.sides):
        axis, high = divmod(index, 2)
        if upper[axis] == scene.lattice.shape[axis] if high else lower[axis] == 0:
            found[index] = scene.side_condition(name)
    return found


def problem_of(
    scene: Scene,
    rim: NDArray[np.int32],
    constants: Floats,
    box: tuple[Ints, Ints],
    loads: AppliedLoads,
    scales: Scales,
) -> ElasticProblem:
    """Return the problem of a box of a scene's cells."""
    # `rim` is what the cells are, by the row of `constants` (Young's modulus in Pa, Poisson's
    # ratio) or AIR, RIGID, with one layer more that says what lies beyond.
    d, moved = rim.ndim, np.zeros((rim.ndim, 2, rim.ndim))
    for index, side in sides_of(scene, *scene.bounds()).items():
        moved[divmod(index, 2)] = np.array(side.displacement or [0.0] * d) / scales.displacement
    fixed, spring = _side_fields(rim, sides_of(scene, *box), scales)
    problem = ElasticProblem(
        kinds=rim,
        moduli=moduli_of(constants[:, 0] / scales.modulus, constants[:, 1], scene.plane),
        force=face_zeros(rim),
        fixed=fixed,
        spring=spring,
        surface_shear={},
        moved=moved,
        scales=scales,
        plane=scene.plane,
        thickness=scene.thickness if rim.ndim == 2 else 1.0,
    )
    if len(loads.force):
        face_forces(problem, loads)
    return problem


def _side_fields(
    rim: NDArray[np.int32], sides: dict[int, SideCondition], scales: Scales
) -> tuple[FaceFields, FaceFields]:
    """Return the given displacements and the foundation's stiffness of all faces, scaled."""
    fixed, spring = face_zeros(rim), face_zeros(rim)
    for index, side in sides.items():
        axis, (own, beyond) = index // 2, (-2, -1) if index % 2 else (1, 0)
        if side.stiffness is not None:
            layer = list(rim_layer(rim.ndim, index))
            layer[axis] = own
            spring[axis][tuple(layer)] = side.stiffness * scales.length / scales.modulus
        # Its faces, and the ghosts within it; rigid cells inside the array stay where they are.
        for component, moved in enumerate(np.array(side.displacement or ()) / scales.displacement):
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
