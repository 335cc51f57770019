"""Forces that a body carries: through every cut across it, and into its supports.

A cut is one layer of cells thick. What it carries is ∫σn dV over the layer, divided by its
thickness: the resultant of the stress in its middle where agents fill the layer, the mean of the
resultants at all its heights where they are smaller. By the principle of virtual work (a
displacement that rises from 0 to 1 through the layer) it balances the loads beyond, those inside
counted by how far up the layer they act. An answer that keeps equilibrium does so in every layer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaju.arrays import Flags, Floats, Ints, first_largest, rigid_motions, without_rows
from kaju.errors import ResultError, require
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import DISPLACED, FOUNDATION, RIGID, ROLLER
from kaju.model.scene.lattice import Lattice

if TYPE_CHECKING:
    import pandas

_NEAR = 1e-6  # of a cell: places that are the same but for rounding


class Carrying(NamedTuple):
    """Parts of a body and the stress in each."""

    middle: Floats  # (m), shape (n, dimension)
    height: Floats  # extent along the axis across which the body is cut (m), shape (n,)
    volume: Floats  # (m³), shape (n,)
    stress: Floats  # tensors (Pa), shape (n, dimension, dimension)


@dataclass(frozen=True, eq=False)
class Cuts:
    """What an answer carries through every cut across one axis, and what it would have to carry."""

    axis: str  # across which the body is cut: "x", "y" or "z"
    at: Floats  # where the cuts lie along it (m), ascending; shape (n,)
    # Force (N) by which the part beyond each cut presses on the part before it, shape
    # (n, dimension). Of elasticity it is in equilibrium along the axis; its shear comes from the
    # means of cells, which smear it over two layers where a surface is dragged, and over agents
    # of different sizes.
    force: Floats
    # The force (N) that balances what acts on the part that no support holds; NaN where supports
    # hold both parts, for statics alone cannot divide it. Shape (n, dimension).
    needed: Floats
    load: float  # sum of the applied forces along the axis (N)
    sense: Floats  # 1 where the part beyond a cut is free, or bears more of the load; else -1
    __repr__ = without_rows

    @property
    def carried(self) -> Floats:
        """Force along the axis (N) handed to the held part, above 0 in the sense of the load."""
        return self._along(self.force)

    @property
    def balance(self) -> Floats:
        """What `carried` is in equilibrium (N); NaN where supports hold both parts."""
        return self._along(self.needed)

    @property
    def missing(self) -> Floats:
        """`balance` less `carried` (N)."""
        return self.balance - self.carried

    def _along(self, force: Floats) -> Floats:
        along = self.sense * force[:, "xyz".index(self.axis)]
        return (-along if self.load < 0.0 else along) + 0.0  # no zero has a sign

    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row a cut: where it is (m), what it carries, needs and misses (N)."""
        import pandas as pd

        columns = {f"{self.axis} (m)": self.at, "carried (N)": self.carried}
        return pd.DataFrame(columns | {"balance (N)": self.balance, "missing (N)": self.missing})


def axis_of_cuts(lattice: Lattice, axis: str | None, force: Floats) -> int:
    """Return the number of an axis to cut across, by default along which forces press most."""
    pressed = np.abs(force).sum(axis=0)
    names = "xyz"[: lattice.dimension]
    chosen = names[first_largest(pressed) if pressed.any() else -1] if axis is None else axis
    known = isinstance(chosen, str) and chosen in tuple(names)
    require(known, f"axis: one of {', '.join(names)} is needed, got {axis!r}")
    hexagons = lattice.kind == "hexagon"
    require(
        lattice.boxes or (hexagons and chosen == "y"),
        f"axis: {lattice.kind}s have layers across {'y only' if hexagons else 'no axis'}, got "
        f"{chosen!r}; squares and cubes have layers across every axis",
    )
    return names.index(chosen)


def cuts_of(scene: Scene, stage: int | None, axis: int, parts: Carrying) -> Cuts:
    """Return the cuts across an axis through a body whose parts carry so much."""
    lattice = scene.lattice
    pitch = float(lattice.pitch[axis, axis])
    # Layers are as thin as cells of the scene, but none crosses a part.
    first, last = (int(end[axis]) for end in scene.bounds())
    corner = np.zeros((1, lattice.dimension), dtype=np.int64)
    start = float(lattice.centres(corner)[0, axis]) - 0.5 * pitch
    ends: Floats = start + pitch * np.arange(first, last + 1, dtype=np.float64)
    low = parts.middle[:, axis] - 0.5 * parts.height
    thick = parts.height > (1.0 + _NEAR) * pitch
    spans = np.unique(np.rint(np.stack([low, parts.height], axis=1)[thick] / pitch), axis=0)
    crossed = np.zeros(len(ends), dtype=np.bool_)
    for begin, height in (spans - [first, 0.0]).astype(np.int64).tolist():
        crossed[max(begin + 1, 0) : begin + height] = True
    ends = ends[~crossed]
    applied = scene.applied(stage)
    places = lattice.face_middles(applied.cells, applied.direction)[:, axis]
    held = _held(scene, axis, ends, _NEAR * pitch)
    return cuts_through(axis, ends, parts, (places, applied.force), held)


def cuts_through(
    axis: int,
    ends: Floats,
    parts: Carrying,
    loads: tuple[Floats, Floats],
    held: tuple[Flags, Flags],
) -> Cuts:
    """Return the cuts through layers with such ends (m).

    Loads are places along the axis (m) and forces (N); of every layer and component it is known
    whether a support holds what lies beyond, or before.
    """
    (places, forces), lower, thick = loads, ends[:-1], np.diff(ends)
    layer = np.searchsorted(ends, parts.middle[:, axis], side="right") - 1
    force = np.zeros((len(lower), forces.shape[1]))
    np.add.at(force, layer, parts.stress[:, :, axis] * (parts.volume / thick[layer])[:, None])
    beyond = np.clip((places - lower[:, None]) / thick[:, None], 0.0, 1.0) @ forces
    total, (above, below) = forces.sum(axis=0), held
    needed = np.where(above, np.where(below, np.nan, beyond - total), beyond)
    loaded = 2.0 * np.abs(beyond[:, axis]) >= abs(total[axis])
    sense = np.where(~above[:, axis] | (below[:, axis] & loaded), 1.0, -1.0)
    return Cuts("xyz"[axis], lower + 0.5 * thick, force, needed, float(total[axis]), sense)


def _held(scene: Scene, axis: int, ends: Floats, near: float) -> tuple[Flags, Flags]:
    """Tell of every layer and component whether a support holds what lies beyond, or before."""
    lattice = scene.lattice
    if lattice.size > 5_000_000:  # larger ones are not looked through for what holds them
        raise ResultError(f"cuts: bodies of up to 5e6 cells are cut, got {lattice.size:.3g}")
    cells = np.argwhere(scene.rasterise() >= 0)
    highest = np.full(lattice.dimension, -np.inf)
    lowest = np.full(lattice.dimension, np.inf)
    for arm, normal in enumerate(lattice.normals):  # a support in a layer holds both
        beyond = scene.kinds(lattice.neighbours(cells, arm))
        for kinds, component in (
            ((RIGID, DISPLACED), np.ones(lattice.dimension, dtype=np.bool_)),
            ((ROLLER, FOUNDATION), np.abs(normal) > 1e-9),
        ):
            there = cells[np.isin(beyond, kinds)]
            if len(there):  # between two rows of cells, or beside a cell
                across = 0.5 * float(lattice.pitch[axis, axis]) * np.sign(np.round(normal[axis], 9))
                places = lattice.centres(there)[:, axis] + across
                highest[component] = np.maximum(highest[component], places.max())
                lowest[component] = np.minimum(lowest[component], places.min())
    return highest > ends[:-1, None] + near, lowest < ends[1:, None] - near


def resultants(
    names: Sequence[str] | Mapping[int, str],
    of: Ints,
    at: Floats,
    axis: Ints,
    force: Floats,
    spots: Floats | None = None,
) -> dict[str, Floats]:
    """Return what supports bear, by forces along an axis each: of each the force, then the couple.

    `of` numbers the support of each force. Couples are about the middle of its places (or `spots`):
    in the plane to the left, in space along each axis.
    """
    found, spots = {}, at if spots is None else spots
    for number in np.unique(of).tolist():
        here = of == number
        middle = 0.5 * (np.fmin.reduce(spots[here]) + np.fmax.reduce(spots[here]))
        borne = rigid_motions(at[here] - middle, axis[here]).T @ force[here]
        if len(borne) == 6:  # turns within xy, xz and yz are those about z, -y and x
            borne[3:] = borne[5], -borne[4], borne[3]
        found[names[number]] = borne
    return found
