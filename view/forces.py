"""The applied forces as arrows that press on the body, or pull at it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaju.arrays import Floats, Ints

from .style import FORCE, add_polygons, arrow_polygons
from .units import counted, quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kaju.model.scene import AppliedLoads, Scene

    from .section import Section

MOST_ARROWS = 24
"""Of more loaded faces than this, so many evenly chosen ones get an arrow."""

WEIGHTS_ACROSS = 3
"""A weight is shown by so many arrows side by side along the body's longest way."""


class Arrows(NamedTuple):
    """Where forces act (m), and how large they are (N), each of shape (n, dimension).

    `pulls` tells which start where they act; all others end there.
    """

    place: Floats
    force: Floats
    pulls: np.ndarray


def force_arrows(
    scene: Scene, applied: AppliedLoads, rows: Ints, most: int = MOST_ARROWS
) -> Arrows:
    """Choose arrows for some of the applied forces: few enough to be seen one by one.

    A force in the middle of many cells, such as a weight, becomes a few arrows, each in a
    cell of the part of the body whose force it stands for.
    """
    rows = rows[np.abs(applied.force[rows]).max(axis=1, initial=0.0) > 0.0]
    weight = rows[applied.direction[rows] < 0]
    faces = rows[applied.direction[rows] >= 0]
    if len(weight) <= most:
        faces, weight = rows, rows[:0]
    chosen = faces[np.linspace(0, len(faces) - 1, min(len(faces), most)).astype(np.int64)]
    lattice = scene.lattice
    normal = lattice.normals[applied.direction[chosen]]
    normal = normal * (applied.direction[chosen] >= 0)[:, None]
    force = applied.force[chosen]
    place = lattice.face_middles(applied.cells[chosen], applied.direction[chosen])
    pulls = np.einsum("ij,ij->i", force, normal) > 0.0
    # Without a face a force ends in the cell's middle, or on its surface if that is bare.
    unit = force / np.linalg.norm(force, axis=1, keepdims=True)
    behind = scene.kinds(lattice.locate(place - lattice.cell_size * unit))
    bare = (applied.direction[chosen] < 0) & (behind < 0)
    place = place - np.where(bare[:, None], 0.56 * lattice.cell_size * unit, 0.0)
    if len(weight):
        some, sums = _gathered(lattice.centres(applied.cells[weight]), applied.force[weight])
        place, force = np.vstack([place, some]), np.vstack([force, sums])
        pulls = np.append(pulls, np.ones(len(some), dtype=np.bool_))
    return Arrows(place, force, pulls)


def _gathered(points: Floats, force: Floats) -> tuple[Floats, Floats]:
    """Gather forces in a few parts of a body: return a point that is in it, and their sum."""
    lower, span = points.min(axis=0), np.ptp(points, axis=0).max() or 1.0
    part = np.minimum((points - lower) * (WEIGHTS_ACROSS / span), WEIGHTS_ACROSS - 1)
    number = np.unique(part.astype(np.int64), axis=0, return_inverse=True)[1].ravel()
    places, sums = [], []
    for one in range(int(number.max()) + 1):
        inside = points[number == one]
        nearest = np.linalg.norm(inside - inside.mean(axis=0), axis=1).argmin()
        places.append(inside[nearest])
        sums.append(force[number == one].sum(axis=0))
    return np.array(places), np.array(sums)


def told(applied: AppliedLoads) -> list[str]:
    """Return in words how much is applied, if anything is."""
    total = float(np.linalg.norm(applied.force, axis=1).sum())
    if total == 0.0:
        return []
    faces = int((applied.direction >= 0).sum())
    inner = len(applied.direction) - faces
    places = [f"{counted(faces, 'face')}"] if faces else []
    places += [f"in {counted(inner, 'cell')}"] if inner else []
    where = f" on {' and '.join(places)}".replace("on in", "in") if faces + inner > 1 else ""
    return [f"applied: {quantity(total, 'N')}{where}"]


def draw_forces(
    ax: Axes, section: Section, stage: int | None = None, share: float = 1.0
) -> list[str]:
    """Draw the applied forces of a section; return notes that say how much they are.

    `share` shortens all arrows, for forces that have not grown to the full yet.
    """
    applied = section.scene.applied(stage)
    rows = np.flatnonzero(section.holds(applied.cells))
    arrows = force_arrows(section.scene, applied, rows)
    force, place = section.in_plane(arrows.force), section.in_plane(arrows.place)
    size = np.linalg.norm(force, axis=1)
    seen = size > 1e-9 * size.max(initial=0.0)
    if not seen.any():
        return told(applied)
    force, place, size, pulls = force[seen], place[seen], size[seen], arrows.pulls[seen]
    span = section.span
    along = (share * span * (0.06 + 0.07 * size / size.max()) / size)[:, None] * force
    head = np.where(pulls[:, None], place + along, place)
    width = np.full(len(head), min(0.011, 0.2 / len(head) + 0.004) * span)
    outlines = arrow_polygons(head - along, head, width)
    add_polygons(ax, outlines, "forces", fc=FORCE, ec="white", lw=0.4, zorder=8)
    return told(applied)
