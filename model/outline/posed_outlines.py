"""Scenes with true outlines as problems: body, laws, supports and loads, or why there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from math import gcd, inf
from typing import ClassVar

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.errors import SceneError
from kaju.model.elastic.corners import sharp_corners
from kaju.model.elastic.moduli import Moduli, scene_moduli
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.scales import Scales
from kaju.model.scene import Body, Scene
from kaju.model.scene.cell_types import NOT_BODY

from .arc_triangles import ArcFrames, TouchError, keep_apart, touches
from .triangulation import NEAR
from .true_shapes import AIR, KINK, SMOOTH, UNIT, Law, TrueBody, TrueRegion, first_leaves

FINE = 64  # cells along the longer side, by which pictures and comparisons know the body
FIRST = 8  # first agents along the longer side, where the cells' number has such a divisor


SIDES = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)}
"""Of each side of the array its axis, and whether it is the upper one."""
ROUNDING = 1e-7  # share by which the bounds are set wider, for coordinates are rounded
OF_LAW = 1e3 * np.finfo(np.float64).eps
"""The same for the law, times its condition: next to ν = 1/2 it leaves few digits of an energy."""


@dataclass(frozen=True)
class LoadedOutline:
    """Tractions s n along the outline of a region, of one stress s and the outward normal n.

    The same stress in the band between both bodies is in balance and right on every curve.
    """

    name: str
    region: int
    stress: Floats  # shape (2, 2)
    facing: Floats | None = None  # a direction: traction acts where it points into the body

    @classmethod
    def pushed(
        cls, name: str, number: int, region: TrueRegion, force: Floats, extent: tuple[int, int]
    ) -> LoadedOutline:
        """Return a force, even across its direction, on all of the outline that faces it."""
        size = np.hypot(*force)
        direction = force / size
        for line in region.lines:
            line.part_along((float(direction[0]), float(direction[1])))
        facing = cls(name, number, np.zeros((2, 2)), direction)
        run = np.diff(along(region, extent), axis=1)[:, 0]
        outward = np.stack([run[:, 1], -run[:, 0]], axis=1) * (1.0 if region.solid else -1.0)
        towards = outward @ direction
        width = -towards[towards < -SMOOTH * np.hypot(*run.T)].sum()
        if not width > 0.0:
            return facing
        return replace(facing, stress=-size / width * np.outer(direction, direction))


def along(region: TrueRegion, extent: tuple[int, int]) -> Floats:
    """Return the chords or tangents of an outline within the array. Shape (n, 2, 2)."""
    rings = region.rings(not region.solid)
    return within_array(
        np.concatenate([np.stack([one, np.roll(one, -1, axis=0)], axis=1) for one in rings]), extent
    )


@dataclass(frozen=True)
class OutlineProblem:
    """A body; lengths in edges of the first agents, its first material's Young's modulus is 1."""

    body: TrueBody
    shape: tuple[int, int]  # first agents along x and y
    held: dict[str, tuple[int, ...]]  # axes along which sides hold
    forces: dict[str, Floats]  # total force on sides, shape (2,)
    tractions: dict[str, Floats]  # further forces on a unit of length of sides
    outlines: tuple[LoadedOutline, ...]
    weight: Floats  # force on a unit of area, shape (2,)
    scales: Scales

    @property
    def band(self) -> float:
        """Largest energy (twice) of a unit of area between both bodies, under a load's stress."""
        stresses = [one.stress[[0, 1, 0], [0, 1, 1]] for one in self.outlines]
        return max((float(s @ self.softest.compliance @ s) for s in stresses), default=0.0)

    @property
    def softest(self) -> Law:
        """The stiffest law that is no stiffer than any of the body's."""
        return reduce(lambda one, other: one.with_other(other, stiffer=False), self.body.laws)

    @property
    def stiffest(self) -> Law:
        """The softest law that is no softer than any of the body's."""
        return reduce(lambda one, other: one.with_other(other, stiffer=True), self.body.laws)

    @property
    def rounding(self) -> float:
        """Share by which bounds are set wider for rounding."""
        softest, stiffest = self.softest, self.stiffest
        contrast = max(stiff / soft for stiff, soft in zip(stiffest, softest, strict=True))
        law = np.linalg.eigvalsh(stiffest.stiffness).max()
        law /= np.linalg.eigvalsh(softest.stiffness).min()
        # a strip of the stiff material that lies on a line but for rounding counts as the soft one
        return float(ROUNDING + NEAR * (contrast - 1.0) + OF_LAW * law)

    @property
    def estimated(self) -> bool:
        """Whether nothing is proved: the weight between a curve and its polygons is left out."""
        curved = any(ArcFrames(region.arcs).turn.any() for region in self.body.regions)
        return bool(self.weight.any() and curved)


def rigid_sides_at(points: Floats, problem: OutlineProblem) -> list[str]:
    """Return the rigid sides on which some points lie, shape (..., 2)."""
    at = points[((points >= 0.0) & (points <= problem.shape)).all(axis=-1)]
    return [
        side
        for side, axes in problem.held.items()
        if len(axes) > 1
        and (at[:, SIDES[side][0]] == problem.shape[SIDES[side][0]] * SIDES[side][1]).any()
    ]


class UnlikeError(Exception):
    """The polygons do not have all of the body yet."""


def within_array(border: Floats, extent: tuple[int, int]) -> Floats:
    """Return the parts of straight lines within the array, shape (n, 2, 2)."""
    ends = border
    run = ends[:, 1] - ends[:, 0]
    low, high = np.zeros(len(ends)), np.ones(len(ends))
    for axis in (0, 1):
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (np.array([0.0, extent[axis]]) - ends[:, 0, axis, None]) / run[:, axis, None]
        level = run[:, axis] == 0.0
        outside = level & ((ends[:, 0, axis] < 0) | (ends[:, 0, axis] > extent[axis]))
        low = np.maximum(low, np.where(level, 0.0, t.min(axis=1)))
        high = np.where(outside, -1.0, np.minimum(high, np.where(level, 1.0, t.max(axis=1))))
    kept = high - low > 1e-12
    at = np.stack([low, high], axis=1)[kept]
    return ends[kept, :1] + at[:, :, None] * run[kept, None]


@dataclass(frozen=True, eq=False)
class OutlinedBody:
    """A scene with true outlines, posed: what agents within outlines stand in."""

    dimension: ClassVar[int] = 2
    smallest: ClassVar[int] = 1
    stage: ClassVar[None] = None
    resolution: ClassVar[None] = None
    asked: Scene

    @cached_property
    def _posed(self) -> tuple[OutlineProblem, float]:
        return problem_of(self.asked)

    @property
    def problem(self) -> OutlineProblem:
        """What is solved."""
        return self._posed[0]

    @property
    def edge(self) -> float:
        """Edge of the first agents (m)."""
        return self._posed[1]

    @cached_property
    def scene(self) -> Scene:
        """Cells of what lies in their middles, held as the body is."""
        return cells_within(self.asked)

    @property
    def cell(self) -> float:
        """Edge of these cells, in units."""
        return float(self.scene.lattice.cell_size / self.edge / UNIT)

    @property
    def scales(self) -> Scales:
        """Units of what is found."""
        return self.problem.scales

    @cached_property
    def moduli(self) -> Moduli:
        """Scaled moduli of every material."""
        return scene_moduli(self.asked, self.scales.modulus)

    @cached_property
    def own_laws(self) -> list[Law]:
        """The law of every material."""
        return list(laws_of(self.asked).values())

    @cached_property
    def sharp(self) -> Ints:
        """The units that hold corners of outlines, shape (n, 2)."""
        return np.floor(self.problem.body.kinks(KINK) / UNIT).astype(np.int64)

    @property
    def without_limit(self) -> Floats:
        """Corners (m) at which stress grows without limit, and ends of supports, shape (n, 2)."""
        shape = np.array(self.problem.shape)
        # Steps of cells are no corners of the body; corners of the array are.
        of_cells = sharp_corners(self.scene) / self.edge
        ends = of_cells[np.isclose(of_cells * (of_cells - shape), 0.0).all(axis=1)]
        own = self.problem.body.without_limit(KINK, self.problem.shape)
        return self.edge * np.concatenate([own, ends])

    def start(self) -> LeafCells:
        """Return the first agents."""
        return first_leaves(self.problem.shape)

    def check_rounding(self, tolerance: float) -> None:
        """Refuse materials so unlike that rounding hides whether a tolerance is kept."""
        rounding = self.problem.rounding
        left = 0.5 * (2.0 * rounding / (1.0 - rounding)) ** 0.5 if rounding < 1.0 else inf
        if len(self.problem.body.laws) > 1 and left > tolerance:
            raise SceneError(
                "body.regions: the materials are so different that rounding alone makes an "
                f"error of {left:.2g}, above the tolerance of {tolerance:g}; take a larger "
                "tolerance, or a rigid side or air instead of the extreme material"
            )


def cells_within(scene: Scene) -> Scene:
    """Return cells of what lies in their middles in a body with true outlines, without loads."""
    many = -(-FINE // max(scene.lattice.shape))
    shape = tuple(many * count for count in scene.lattice.shape)
    lattice = type(scene.lattice)(shape, scene.lattice.cell_size / many)
    centres = lattice.centres(np.indices(shape).reshape(2, -1).T)
    names = [material.name for material in scene.cell_materials]
    code = {name: names.index(name) if name in names else len(names) for name in (
        scene.body.material, *(region.material for region in scene.body.regions)
    )}  # fmt: skip
    codes = np.full(len(centres), code[scene.body.material], dtype=np.int16)
    for number, region in enumerate(scene.body.regions):
        shape_of = region.shape_in(scene.lattice, f"body.regions.{number}")
        codes[shape_of.contains(centres)] = code[region.material]
    body = Body(
        array=codes.reshape(shape),
        cell_size=lattice.cell_size,
        thickness=scene.body.thickness,
        plane=scene.body.plane,
        allow_floating=True,
    )
    legend = {str(number): name for number, name in enumerate([*names, "air"])}
    return Scene(body=body, legend=legend, materials=scene.materials, sides=scene.sides)


def problem_of(scene: Scene) -> tuple[OutlineProblem, float]:
    """Return what is solved, and the edge (m) of the first agents."""
    lattice = scene.lattice
    nx, ny = lattice.shape
    common = gcd(nx, ny)
    wide = [d for d in range(1, common + 1) if common % d == 0 and max(nx, ny) // d >= FIRST]
    cells = max(wide, default=1)
    edge = lattice.cell_size * cells
    shape = (nx // cells, ny // cells)
    body = _body(scene, edge, shape)
    modulus = scene.cell_materials[0].youngs_modulus
    held: dict[str, tuple[int, ...]] = {}
    for name in SIDES:
        kind = scene.side_condition(name).kind
        if kind != "free":
            held[name] = (0, 1) if kind == "rigid" else (SIDES[name][0],)
    # stresses as strains of the modulus, forces as such over edges
    unit = modulus * scene.thickness * edge
    forces = {str(load.side): np.zeros(2) for load in scene.loads if load.side is not None}
    tractions = {side: np.zeros(2) for side in forces}
    outlines: list[LoadedOutline] = []
    for number, load in enumerate(scene.loads):
        if load.outline is not None:
            outlines.append(_outline_load(scene, number, body, shape, unit))
            if any(one.name == load.outline for one in outlines[:-1]):
                raise SceneError(
                    f"loads.{number}.outline: {load.outline!r} is loaded already; give one load"
                )
        elif load.pressure is not None:
            axis, upper = SIDES[str(load.side)]
            tractions[str(load.side)][axis] -= load.pressure / modulus * (1 if upper else -1)
        else:
            forces[str(load.side)] += np.array(load.force) / unit
    weight = np.zeros(2)
    if scene.body.gravity is not None and any(scene.body.gravity):
        density = scene.cell_materials[0].density
        assert density is not None
        weight = density * edge / modulus * np.array(scene.body.gravity, dtype=np.float64)
    stresses = [one.stress for one in outlines]
    acting = [*forces.values(), *tractions.values(), *stresses, weight]
    strain = max(float(np.abs(one).max()) for one in acting)
    if strain == 0.0:
        raise SceneError(
            "loads: without a load or gravity, or with loads of sides that cancel, there is no "
            "energy to bound; give one of them"
        )
    scales = Scales.of(modulus, strain * unit, edge, modulus * scene.thickness)
    strain = scales.displacement / edge
    problem = OutlineProblem(
        body,
        shape,
        held,
        {side: force / strain for side, force in forces.items()},
        {side: traction / strain for side, traction in tractions.items()},
        tuple(replace(one, stress=one.stress / strain) for one in outlines),
        weight / strain,
        scales,
    )
    _check_cusps(scene, problem)
    return problem, edge


def _outline_load(
    scene: Scene, number: int, body: TrueBody, shape: tuple[int, int], unit: float
) -> LoadedOutline:
    """Return what a load does along an outline; refuse an outline that cannot be loaded."""
    load, where = scene.loads[number], f"loads.{number}.outline"
    name = str(load.outline)
    which = [region.name for region in scene.body.regions].index(name)
    check_alone(body.regions, which, f"{where}: {name!r}", "load")
    _check_body_ends(scene, which, where)
    region = body.regions[which]
    if load.pressure is not None:
        stress = -load.pressure / scene.cell_materials[0].youngs_modulus * np.eye(2)
        found = LoadedOutline(name, which, stress)
    else:
        total = np.array(load.force) / unit
        found = LoadedOutline.pushed(name, which, region, total, shape)
        if total.any() and not found.stress.any():
            raise SceneError(f"loads.{number}.force: nothing of {name!r} faces it")
    if not len(along(region, shape)):
        raise SceneError(f"{where}: nothing of {name!r} lies within the array")
    return found


def _check_cusps(scene: Scene, problem: OutlineProblem) -> None:
    """Refuse loads where an outline touches a side from within, both free: they bend a tip there.

    Between the two the body gets as thin as the square of the distance, a load on either bends it
    as that square too, and its energy, their square over the cube of thickness, has no limit.
    """
    pushed = {one.region for one in problem.outlines if one.stress.any()}
    for number, region in enumerate(problem.body.regions):
        for side, (axis, upper) in SIDES.items():
            acting = [one.get(side, np.zeros(2)) for one in (problem.forces, problem.tractions)]
            if side in problem.held or not (number in pushed or np.any(acting)):
                continue
            for line, inward in zip(region.lines, region.inward, strict=True):
                # The body is round this line, and not within it.
                if inward == region.solid and touches(line.arcs, problem.shape, axis, upper):
                    name = scene.body.regions[number].name or f"regions.{number}"
                    raise SceneError(
                        f"loads: the outline of {name!r} touches the side {side!r}, where the body "
                        "gets infinitely thin, and a load acts there, whose energy has no limit; "
                        "let the outline cross the side, or keep away from it"
                    )


def check_alone(regions: Sequence[TrueRegion], which: int, what: str, borne: str) -> None:
    """Refuse what an outline bears where it meets another one."""
    for other, beside in enumerate(regions):
        if other != which and not keep_apart(regions[which].arcs, beside.arcs):
            raise SceneError(
                f"{what} meets the outline of regions.{other}; a {borne} needs an outline "
                "that meets no other: keep them apart, or draw both as one path"
            )


def _check_body_ends(scene: Scene, which: int, where: str) -> None:
    """Refuse a load on an outline, which meets no other, that is not where the body ends."""
    body = scene.body
    shapes = [
        region.shape_in(scene.lattice, f"body.regions.{number}")
        for number, region in enumerate(body.regions)
    ]
    at = shapes[which].outline()[0][:1, 0]
    place, below, region = at[:, :2] / at[:, 2:], body.material, body.regions[which]
    for number, other in enumerate(body.regions):
        if number == which or not shapes[number].contains(place)[0]:
            continue
        if number > which:
            raise SceneError(f"{where}: {region.name!r} is covered by regions.{number}")
        below = other.material
    if (region.material in NOT_BODY) == (below in NOT_BODY):
        raise SceneError(
            f"{where}: {region.name!r} is {region.material} in {below}; loads act where the body "
            "ends, not between two materials, or in the air"
        )


def laws_of(scene: Scene) -> dict[str, Law]:
    """Return the law of each material by name; the first one's Young's modulus is 1."""
    names = [scene.body.material, *(region.material for region in scene.body.regions)]
    found = dict.fromkeys(name for name in names if name is not None and name not in NOT_BODY)
    unit = scene.cell_materials[0].youngs_modulus
    return {
        name: Law.of(
            material.youngs_modulus / unit, material.poissons_ratio, scene.plane or "stress"
        )
        for name, material in zip(found, scene.cell_materials, strict=True)
    }


def _body(scene: Scene, edge: float, shape: tuple[int, int]) -> TrueBody:
    laws = laws_of(scene)
    last: dict[tuple[bytes, ...], Law] = {}
    regions = []
    for number, region in reversed([*enumerate(scene.body.regions)]):
        where = f"body.regions.{number}"
        try:
            lines = region.shape_in(scene.lattice, where).outline()
            arcs = [np.asarray(arcs / [edge, edge, 1.0]) for arcs in lines]
            # Where a later region has the same outline, nothing is left of this one's material.
            law = last.setdefault(
                tuple(line.tobytes() for line in arcs), laws.get(region.material, AIR)
            )
            regions.append(TrueRegion.within(arcs, shape, law))
        except TouchError:
            raise SceneError(
                f"{where}: its outline crosses or touches itself; split it in two"
            ) from None
    return TrueBody(laws.get(str(scene.body.material), AIR), tuple(reversed(regions)))
