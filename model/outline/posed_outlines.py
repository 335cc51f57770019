"""Scenes with true outlines posed: body, laws, supports and loads, or why there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, product
from math import gcd, inf
from typing import ClassVar

import numpy as np

from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SceneError, SingularPlaceError
from kaju.model.elastic.corners import sharp_places
from kaju.model.elastic.moduli import scene_moduli
from kaju.model.elastic.pair.leaves import LeafCells
from kaju.model.elastic.scales import Scales
from kaju.model.scene import Body, Scene
from kaju.model.scene.cell_types import HOLDING, INSIDE, PINNED
from kaju.model.scene.curves import Point, cross
from kaju.model.scene.regions import METRES, LoadRegion

from . import true_shapes
from .arc_triangles import CLOSE, ArcFrames, TouchError, keep_apart
from .true_shapes import AIR, KINK, RIGID, SLIGHT, TINY, UNIT, Law, TrueBody, TrueRegion, holding

SIDES = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1)}
"""Of each side of the array its axis, and whether it is the upper one."""
BESIDE = 1e-5  # edges of the first agents from the end of an outline: what is on both its sides


@dataclass(frozen=True, eq=False)
class EdgeLoad:
    """What acts on edges of the body: on a side, along an outline, or within a box.

    A force is spread `even` along them, over what faces it, even across its direction, or over
    `both` that and what it pulls at. Tractions on curves are s n, of one stress s and the outward
    normal n: the same stress in the band between both bodies is in balance and right on every
    curve. Straight edges, which an even force needs, have no band.
    """

    told: str  # that it meets no edge
    force: Floats
    bent: Floats  # a pressure, how it grows along its side, and a couple on that
    spread: str
    regions: Mapping[int, TrueRegion]  # whose outlines are loaded
    sides: Sequence[int] = ()  # numbers of the array's sides that are
    box: Floats = field(default_factory=lambda: np.array([[-inf, -inf], [inf, inf]]))

    def __post_init__(self) -> None:
        """Part arcs where they begin to face the force."""
        for region in self.regions.values() if self.force.any() else ():
            for line in region.lines:
                line.arcs = line.parted_along((float(self.force[0]), float(self.force[1])))

    def shares(self, at: Floats, outline: Ints, side: Ints) -> Floats:
        """Return the shares of straight pieces, (n, 2, 2), which have the body on their left."""
        run, middle = at[:, 1] - at[:, 0], at.mean(axis=1)
        there = np.isin(outline, [*self.regions]) | np.isin(side, self.sides)
        there &= true_shapes.inside(self.box, middle)
        for leg in self._legs():
            there &= ~true_shapes.inside(leg, middle)
        share, towards = np.hypot(*run.T), cross(self.force, run)
        if self.force.any() and self.spread != "even":
            faces = towards < -TINY * share * np.hypot(*self.force)
            share = np.where(faces, -towards, np.abs(towards) * (self.spread == "both"))
        return np.where(there, share, 0.0)

    def _legs(self) -> Floats:
        """Return tangents along a line of the box, as boxes, of arcs that go away beyond it."""
        if not self.regions or not np.isfinite(self.box).all():
            return np.empty((0, 2, 2))
        arcs = np.concatenate([region.arcs for region in self.regions.values()])
        ends = arcs[:, [0, -1], :2] / arcs[:, [0, -1], 2:]
        legs = _legs_of(arcs[~true_shapes.inside(self.box, ends.mean(axis=1), 0.0)])
        return legs[true_shapes.on_border(self.box, legs).all(axis=1)]


def _legs_of(arcs: Floats) -> Floats:
    """Return the tangents of curved arcs that run along an axis, as boxes, (n, 2, 2)."""
    frames = ArcFrames(arcs)
    both = [frames.start, frames.tip], [frames.tip, frames.end]
    legs = np.concatenate([np.stack(ends, axis=1)[frames.turn != 0.0] for ends in both])
    return np.sort(legs[np.ptp(legs, axis=1).min(axis=1) < CLOSE], axis=1)


class UnlikeError(Exception):
    """The polygons do not have all of the body yet; what is to be said if they never do."""


@dataclass(eq=False)
class OutlinedBody:
    """A scene with true outlines, posed: what agents within outlines stand in.

    Lengths are in edges of the first agents, the first material's Young's modulus is 1. `true` is
    the body, of which `shape` first agents stand along x and y, `edge` (m) large; sides hold along
    the axes `held`; `loads` act on edges; `weight` is the force on a unit of area.
    """

    dimension: ClassVar[int] = 2
    smallest: ClassVar[int] = 1
    stage: ClassVar[None] = None
    resolution: ClassVar[None] = None
    asked: Scene

    def __post_init__(self) -> None:
        scene, lattice = self.asked, self.asked.lattice
        common = gcd(*lattice.shape)
        wide = [d for d in range(1, common + 1) if common % d == 0]
        # Eight or more along the longer side, if the number of cells has such a divisor.
        cells = max((d for d in wide if max(lattice.shape) // d >= 8), default=1)
        self.edge = lattice.cell_size * cells
        self.shape = lattice.shape[0] // cells, lattice.shape[1] // cells
        modulus = scene.cell_materials[0].youngs_modulus
        self.moduli = scene_moduli(scene, modulus)
        stretch, lateral, shear = self.moduli
        self.own_laws = [*map(Law, (0.5 * (stretch + lateral)).tolist(), shear.tolist())]
        """The law of every material."""
        names = [material.name for material in scene.cell_materials]
        laws = dict.fromkeys(HOLDING, RIGID) | dict(zip(names, self.own_laws, strict=True))
        self.true = _body(scene, self.edge, self.shape, laws)
        self.rigid = {
            k: region.name or f"region {k}"
            for k, region in enumerate(scene.body.regions)
            if region.material in HOLDING and self.true.regions[k].law == RIGID
        }
        """Of each rigid region the name of the support that it is."""
        self.pivots = np.full((len(self.true.regions) + 1, 2), np.nan)
        """The middle that each region turns about if it is pinned, else NaN; last for none."""
        for which in self.rigid:
            self._check_rigid(which)
            if scene.body.regions[which].material == PINNED:
                self.pivots[which] = self.true.regions[which].lines[0].middle
        array = np.array([[0.0, 0.0], self.shape])
        for region in self.true.regions:
            start = ArcFrames(region.arcs).start
            self.true.marks.extend(true_shapes.snapped(start[true_shapes.on_border(array, start)]))
        kinds = {name: scene.side_condition(name).kind for name in SIDES}
        self.held = {
            name: (0, 1) if kind == "rigid" else (SIDES[name][0],)
            for name, kind in kinds.items()
            if kind != "free"
        }
        self._load(modulus)

    def _check_rigid(self, which: int) -> None:
        """Refuse a rigid region that does not hold the body with all of its outline."""
        regions, material = self.true.regions, self.asked.body.regions[which].material
        what = f"body.regions.{which}.material: what is {material}"
        check_alone(regions, which, what, "support")
        at = regions[which].arcs[..., :2] / regions[which].arcs[..., 2:]
        below, lines = self._below(which, at[:, 0]), len(regions[which].lines)
        if (at <= 0.0).any() or (at >= self.shape).any():
            told = "reaches the side of the array; hold this by [sides], or draw it smaller"
        elif AIR in below or RIGID in below:
            told = "lies in the air, and holds nothing; let the body surround it"
        elif lines > 1 and material == PINNED:
            told = f"has {lines} outlines, which turn alone; give each a region of its own"
        elif any(regions[which].part_of(later) for later in regions[which + 1 :]):
            told = "lies below or around a later region; give the support last, around nothing"
        else:
            return
        raise SceneError(f"{what} {told}")

    def left_at(self, places: Floats) -> Flags:
        """Tell which places are on tangents of arcs that leave them, with air on one side."""
        found, inner = [], places + BESIDE * (0.5 * np.array(self.shape) - places)
        for which, region in enumerate(self.true.regions):
            for leg in _legs_of(region.arcs):
                on = np.flatnonzero(true_shapes.inside(leg, places))
                laws = zip(on, self._below(which, inner[on]), strict=True)
                found += [k for k, law in laws if (law == AIR) != (region.law == AIR)]
        return np.isin(np.arange(len(places)), found)

    def _below(self, which: int, points: Floats) -> list[Law]:
        """Return the laws that regions before one give points."""
        holds = holding([one.rings(True) for one in self.true.regions[:which]], points)
        laws = [self.true.law, *(one.law for one in self.true.regions[:which])]
        return [laws[max([0, *(np.flatnonzero(column) + 1)])] for column in holds.T]

    def _load(self, modulus: float) -> None:
        """Collect the loads: forces over edges, stresses as strains of the modulus."""
        scene, unit, rows = self.asked, modulus * self.asked.thickness * self.edge, []
        for load in scene.loads:
            axis, upper = SIDES.get(str(load.side), (0, 0))
            slope = np.array(load.pressure_slope or (0.0, 0.0)) / modulus
            there = (load.pressure or 0.0) / modulus
            there += slope[axis] * scene.lattice.extent[axis] * upper
            couple = float(np.sum(load.couple or 0.0)) / unit / self.edge
            bent = np.array([there, slope[1 - axis] * self.edge, couple])
            rows.append((np.array(load.force or (0.0, 0.0)) / unit, bent))
        weight = np.zeros(2)
        if scene.body.gravity is not None and any(scene.body.gravity):
            density = scene.cell_materials[0].density
            assert density is not None
            weight = density * self.edge / modulus * np.array(scene.body.gravity, dtype=np.float64)
        strain = float(np.abs(np.concatenate([weight, *chain(*rows)])).max()) or 1.0
        self.scales = Scales.of(modulus, strain * unit, self.edge, modulus * scene.thickness)
        strain = self.scales.displacement / self.edge
        self.loads = [self._edge_load(k, (f / strain, b / strain)) for k, (f, b) in enumerate(rows)]
        self.weight = weight / strain
        for side in SIDES:
            self.check_cusps(side)

    def check_cusps(self, side: str, goal: bool = False) -> None:
        """Refuse loads where an outline touches a free side from within: they bend a tip there.

        It gets as thin as the square of the distance, so the energy of a load there has no limit.
        The deflection of a side is the work of a load on it.
        """
        pushed = {which for one in self.loads for which in one.regions}
        goal_or_load = goal or any([*SIDES].index(side) in one.sides for one in self.loads)
        for number, region in enumerate(self.true.regions if side not in self.held else ()):
            for line, inward in zip(region.lines, region.inward, strict=True):
                # The body is round this line, and not within it.
                round_it = inward == region.solid and (goal_or_load or number in pushed)
                if round_it and line.touches(self.shape, *SIDES[side]):
                    name = self.asked.body.regions[number].name or f"regions.{number}"
                    acts = "a deflection of this side needs a load" if goal else "a load acts"
                    raise (SingularPlaceError if goal else SceneError)(
                        f"{'goal' if goal else 'loads'}: the outline of {name!r} touches the side "
                        f"{side!r}, where the body gets infinitely thin, and {acts} there, whose "
                        "energy has no limit; let the outline cross the side, or keep away from it"
                    )

    def _edge_load(self, number: int, acts: tuple[Floats, Floats]) -> EdgeLoad:
        """Return what a load does along edges; refuse an outline that cannot be loaded."""
        load, regions = self.asked.loads[number], self.true.regions
        if load.region is not None:
            return self._box_load(f"loads.{number}.region.box", load.region, acts)
        if load.side is not None:
            told = f"loads: there is no body at the side {load.side} to be loaded"
            return EdgeLoad(told, *acts, "even", {}, [[*SIDES].index(load.side)])
        where, name = f"loads.{number}.outline", str(load.outline)
        which = [region.name for region in self.asked.body.regions].index(name)
        check_alone(regions, which, f"{where}: {name!r}", "load")
        if regions[which].law == RIGID:
            raise SceneError(f"{where}: {name!r} holds the body; load another one")
        # the outline meets no other: what holds one point of it holds all
        if not self._ends_at(which)[0]:
            raise SceneError(
                f"{where}: {name!r} is not where the body ends; loads act neither between two "
                "materials nor in the air, nor below another region"
            )
        told = f"{where}: no part of {name!r} lies in the array{' and faces it' * bool(load.force)}"
        return EdgeLoad(told, *acts, "facing", {which: regions[which]})

    def _ends_at(self, which: int) -> Flags:
        """Tell along which arcs of a region the body ends, as far as others leave these."""
        frames = ArcFrames(self.true.regions[which].arcs)
        at = 0.5 * (frames.start + frames.end)
        above = holding([one.rings(True) for one in self.true.regions[which + 1 :]], at)
        air = np.array([law == AIR for law in self._below(which, at)])
        return np.asarray(~above.any(axis=0) & (air == self.true.regions[which].solid))

    def _box_load(self, where: str, region: LoadRegion, acts: tuple[Floats, Floats]) -> EdgeLoad:
        """Return what acts on edges within a box: a force even on all if they are straight."""
        region.flat_axis(self.asked.lattice, where)
        box = true_shapes.snapped(np.array(region.box) / self.edge)
        sides, regions, spread = [], {}, "even"
        for number, (axis, upper) in enumerate(SIDES.values()):
            ends = np.where(np.arange(2) == axis, float(upper * self.shape[axis]), box)
            self.true.marks.extend(ends)
            sides += [number] if box[0, axis] <= ends[0, axis] <= box[1, axis] else []
        for which, one in enumerate(self.true.regions):
            for line in one.lines:
                self.true.marks.extend(line.part(box))
            frames = ArcFrames(one.arcs)
            on = true_shapes.inside(box, 0.5 * (frames.start + frames.end))
            if on.any():
                check_alone(self.true.regions, which, f"{where}: in it an outline", "load", on)
                regions[which] = one
                bent = which not in self.rigid and frames.turn[on & self._ends_at(which)].any()
                spread = "facing" if bent else spread
        faces = " and faces the force" * bool(acts[0].any())
        far = f"; {METRES}" * bool(np.abs(box).max() > 20.0 * max(self.shape))
        told = f"{where}: no free edge of the body lies in it{faces}{far}"
        return EdgeLoad(told, *acts, spread, regions, sides, box)

    def pushed(self, place: str, force: Floats) -> OutlinedBody:
        """Return the body under nothing but a force on a side, or even on all of an outline."""
        found, told = copy(self), f"goal: no part of {place!r}"
        found.weight, acts = np.zeros(2), (force, np.zeros(3))
        if place in SIDES:
            self.check_cusps(place, goal=True)
            found.loads = [EdgeLoad(told, *acts, "even", {}, [[*SIDES].index(place)])]
        else:
            which = [region.name for region in self.asked.body.regions].index(place)
            found.loads = [EdgeLoad(told, *acts, "both", {which: self.true.regions[which]})]
        return found

    def bands(self, shares: Sequence[float]) -> tuple[Floats, Floats]:
        """Return what the loads' stresses store (twice) between the polygons of loaded outlines.

        By a unit of area, at most, of each outline, the last of none; and in all, within and beyond
        the body. `shares` are the sums of those of each load.
        """
        density, parts, root = np.zeros(len(self.true.regions) + 1), np.zeros(2), []
        for one, whole in zip(self.loads, shares, strict=True):
            tensor = one.bent[0] * np.eye(2) + np.outer(one.force, one.force) / whole
            stress = tensor[[0, 1, 0], [0, 1, 1]]
            root.append(np.sqrt(stress @ self.true.extreme(False).compliance @ stress))
        for which, region in enumerate(self.true.regions):
            for line, inward in zip(region.lines, region.inward, strict=True):
                # at a hole that bulges outwards the body begins at tangents
                ahead = 1 if region.solid != inward else -1
                frames, size = ArcFrames(line.arcs), (len(root), len(line.arcs))
                chords = np.stack([frames.start, frames.end][::ahead], axis=1)
                here = np.repeat([[which], [-1]], size[1], axis=1)
                on = [one.shares(chords, *here) > 0.0 for one in self.loads]
                # of the sum of two stresses the root is no more than the sum of both
                stored = (root @ np.array(on).reshape(size)) ** 2
                parts += (line.beside(self.shape) @ stored)[::ahead]
                density[which] = max(density[which], stored.max())
        return density, parts

    @property
    def rounding(self) -> float:
        """Share by which bounds are set wider for rounding."""
        softest, stiffest = self.true.extreme(False), self.true.extreme(True)
        contrast = max(stiff / soft for stiff, soft in zip(stiffest, softest, strict=True))
        law = np.linalg.eigvalsh(stiffest.stiffness).max()
        law /= np.linalg.eigvalsh(softest.stiffness).min()
        # a strip of the stiff material that lies on a line but for rounding counts as the soft one
        # Coordinates are rounded; so is the law, which next to ν = 1/2 leaves few digits.
        strip = true_shapes.NEAR * (contrast - 1.0)
        return float(1e-7 + strip + 1e3 * np.finfo(np.float64).eps * law)

    @property
    def no_bound(self) -> str:
        """Why agents in it prove nothing; empty if they do."""
        curved = any(ArcFrames(region.arcs).turn.any() for region in self.true.regions)
        some = "the weight of what lies between a curve and its polygons is left out"
        return some if self.weight.any() and curved else ""

    @cached_property
    def scene(self) -> Scene:
        """Cells of what lies in their middles, held as the body is, without loads."""
        asked = self.asked
        # By so many along the longer side pictures and comparisons know the body.
        many = -(-64 // max(asked.lattice.shape))
        shape = tuple(many * count for count in asked.lattice.shape)
        lattice = type(asked.lattice)(shape, asked.lattice.cell_size / many)
        codes = self.material_at(lattice.centres(np.indices(shape).reshape(2, -1).T), edges=False)
        kinds = [*[material.name for material in asked.cell_materials], INSIDE, "air"]
        body = Body(
            array=(codes % len(kinds)).astype(np.int16).reshape(shape),
            cell_size=lattice.cell_size,
            thickness=asked.body.thickness,
            plane=asked.body.plane,
            allow_floating=True,
        )
        legend = {str(number): name for number, name in enumerate(kinds)}
        return Scene(body=body, legend=legend, materials=asked.materials, sides=asked.sides)

    def material_at(self, points: Floats, edges: bool = True) -> Ints:
        """Return which material is at points (m); -1 for air, -2 for what is rigid.

        Edges of these are the body's, or nobody's without `edges`.
        """
        asked, body = self.asked, self.asked.body
        number = dict.fromkeys(HOLDING, -2)
        number |= {one.name: k for k, one in enumerate(asked.cell_materials)}
        found = np.full(len(points), number.get(str(body.material), -1))
        for k, region in enumerate(body.regions):
            shape, of = region.shape_in(asked.lattice, f"body.regions.{k}"), region.material
            inside = shape.contains(points)
            if edges and number.get(of, -1) < 0:
                step = TINY * float((shape.extent[1] - shape.extent[0]).max())
                for x, y in np.ndindex(3, 3):
                    inside &= shape.contains(points + step * np.array([x - 1, y - 1]))
            found[inside] = number.get(of, -1)
        return found

    @property
    def cell(self) -> float:
        """Edge of these cells, in units."""
        return float(self.scene.lattice.cell_size / self.edge / UNIT)

    @cached_property
    def sharp(self) -> Ints:
        """The units that hold corners of outlines, shape (n, 2)."""
        at, kink = self.true.corners()
        return np.asarray(np.floor(at[np.abs(kink) > KINK] / UNIT), dtype=np.int64)

    @property
    def without_limit(self) -> Floats:
        """Corners (m) at which stress grows without limit, and ends of supports, shape (n, 2)."""
        ends = np.array([*self.ends], dtype=np.float64).reshape(-1, 2)
        return self.edge * np.concatenate([self.true.without_limit(KINK, self.shape), ends])

    @cached_property
    def ends(self) -> dict[Point, dict[int, str]]:
        """Where on sides stress grows without limit: the outlines that end there, and the side."""
        shape, regions = np.array(self.shape), self.true.regions
        # Steps of cells are no corners of the body; corners of the array are.
        of_cells = sharp_places(self.scene)[0] / self.edge
        corners = of_cells[np.isclose(of_cells * (of_cells - shape), 0.0).all(axis=1)]
        found: dict[Point, dict[int, str]] = {(x, y): {} for x, y in np.rint(corners).tolist()}
        for (which, region), (side, (axis, upper)) in product(enumerate(regions), SIDES.items()):
            frame = np.eye(2)[[1 - axis, axis]] * [[1.0], [1.0 - 2.0 * upper]]  # along it, inward
            for at, way in region.crossing(axis, float(upper * shape[axis])):
                point, angle = (at[0].item(), at[1].item()), np.arctan2(*(frame @ way)[::-1])
                if point in found:
                    found[point] |= {which: side} if side in self.held else {}
                elif 0.0 < at[1 - axis] < shape[1 - axis] and SLIGHT < angle < np.pi - SLIGHT:
                    # The outline parts the half turn at this side into two wedges.
                    middles = 0.5 * np.array([angle, angle + np.pi])
                    beside = np.stack([np.cos(middles), np.sin(middles)], axis=1) @ frame
                    inside = self.material_at(self.edge * (at + BESIDE * beside), edges=False)
                    if self._grows(side, angle, *([*self.own_laws, RIGID, AIR][k] for k in inside)):
                        found[point] = {which: side}
        return found

    def _grows(self, side: str, angle: float, one: Law, other: Law) -> bool:
        """Tell whether stress has no limit where two wedges meet at a side, of the first's angle.

        A wedge between a free line and a rigid one has none from cos 2α = -G/K on (M. L. Williams,
        1952); at a roller, which is a mirror, from a right angle on.
        """
        held = len(self.held.get(side, ()))
        if one == other or (not held and AIR in (one, other)):
            return False
        if AIR not in (one, other):
            return held != 1 or abs(angle - 0.5 * np.pi) > SLIGHT
        law, wide = (other, np.pi - angle) if one == AIR else (one, angle)
        least = np.arccos(-min(law.shear / law.bulk, 1.0)) if held == 2 else np.pi
        return bool(wide > 0.5 * least + SLIGHT)

    def singular_on(self, which: int) -> tuple[list[Point], bool]:
        """Return where on an outline stress has no limit, and whether it has a peak elsewhere.

        If there is such a place, this is the largest stress of rounded parts, which must not end
        there.
        """
        places = [at for at, ending in self.ends.items() if which in ending]
        places += [(x, y) for x, y in self.true.without_limit(KINK, self.shape, which)]
        frames = ArcFrames(self.true.regions[which].arcs)
        round_parts = np.concatenate([frames.start, frames.end])[np.tile(frames.turn != 0.0, 2)]
        near = np.abs(round_parts[:, None] - np.array(places).reshape(-1, 2)).max(axis=2) < CLOSE
        return places, not places or (len(round_parts) > 0 and not near.any())

    def start(self) -> LeafCells:
        """Return the first agents."""
        return true_shapes.first_leaves(self.shape)

    def check_rounding(self, tolerance: float) -> None:
        """Refuse materials so unlike that rounding hides whether a tolerance is kept."""
        rounding = self.rounding
        left = 0.5 * (2.0 * rounding / (1.0 - rounding)) ** 0.5 if rounding < 1.0 else inf
        if len(self.true.laws) > 1 and left > tolerance:
            raise SceneError(
                "body.regions: the materials are so different that rounding alone makes an "
                f"error of {left:.2g}, above the tolerance of {tolerance:g}; take a larger "
                "tolerance, or a rigid side or air instead of the extreme material"
            )


def check_alone(
    regions: Sequence[TrueRegion], which: int, what: str, borne: str, some: Flags | None = None
) -> None:
    """Refuse what an outline, or some of its arcs, bears where they meet another one."""
    arcs = regions[which].arcs if some is None else regions[which].arcs[some]
    for other, beside in enumerate(regions):
        its = beside.arcs
        if some is not None and not ArcFrames(arcs).turn.any():
            its = its[ArcFrames(its).turn != 0.0]  # straight lines cross alike in both polygons
        if other != which and len(its) and not keep_apart(arcs, its):
            raise SceneError(
                f"{what} meets the outline of regions.{other}; a {borne} needs an outline "
                "that meets no other: keep them apart, or draw both as one path"
            )


def _body(scene: Scene, edge: float, shape: tuple[int, int], laws: dict[str, Law]) -> TrueBody:
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
                f"{where}: its outline crosses or touches itself, or touches a side of the array; "
                "split it in two, or move it a little"
            ) from None
    return TrueBody(laws.get(str(scene.body.material), AIR), tuple(reversed(regions)))
