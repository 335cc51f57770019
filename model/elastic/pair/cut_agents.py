"""Agents within outlines as an answer: what is read of both fields of their last generation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import ceil, floor, inf

import numpy as np

from kaju.arrays import Flags, Floats, Ints, nearest, points_in
from kaju.model.elastic.goals.quantities import Deflection, Stress
from kaju.model.outline.hoop_stress import HoopStress
from kaju.model.outline.posed_outlines import OutlinedBody
from kaju.model.outline.true_shapes import UNIT, leaf_at
from kaju.model.results.cuts import Carrying, Cuts, axis_of_cuts, cuts_through

from .answer import PairAgents
from .cut_mesh import Border
from .cut_pair import CutPair


@dataclass(eq=False)
class CutAgents(PairAgents):
    """Agents of a plane body within true outlines, whole or cut."""

    ground: OutlinedBody  # type: ignore[assignment]

    @cached_property
    def opinions(self) -> CutPair:
        """Both fields of the last generation; of a stored answer they are found again."""
        known: CutPair | None = self._last
        return known or CutPair(self.ground, self.leaves)

    @property
    def area(self) -> Floats:
        """What of each agent lies within the body at least, in cells of the grid."""
        return np.asarray(self.opinions.area[1] / (UNIT * self.ground.cell) ** 2)

    @property
    def material(self) -> Ints:
        """Index of the material that has most of each agent, which is that of its moduli."""
        return self.opinions.leaves.kind

    law = material

    @cached_property
    def farthest(self) -> float:
        """Largest displacement at corners of agents and pieces, and in the middles of edges."""
        fit = self.opinions.fitting
        corner, bulge = np.split(fit.value.reshape(-1, 2), [len(fit.mesh.place)])
        found = np.concatenate([corner, corner[fit.mesh.ends].mean(axis=1) + bulge])
        return float(np.linalg.norm(found, axis=1).max())

    @cached_property
    def middle(self) -> Floats:
        """Middles of what the agents hold of the body, in edges of the first agents."""
        total = np.zeros((self.count, 3))
        for field in (self.opinions.fitting, self.opinions.balancing):
            at = field.mesh.place[field.mesh.triangle].mean(axis=1)
            weighed = field.area[:, None] * np.insert(at, 2, 1.0, axis=1)
            np.add.at(total, field.mesh.leaf, weighed)
        return total[:, :2] / total[:, 2:]

    @cached_property
    def moved(self) -> Floats:
        """Displacement of these middles, beyond the body that of what is near."""
        return self.opinions.displacement_at(np.arange(self.count), self.middle)

    @property
    def border(self) -> Border:
        """The border of the stress that balances, with the loads on it."""
        return self.opinions.borders[1]

    def applied(self, stage: int | None = None) -> Floats:
        """Return the forces (N) on the body, shape (n, 2): along its border, and its weight."""
        weight = self.ground.weight * self.opinions.area[1].sum()
        return np.asarray(self.scales.force * np.vstack([self.border.given, weight[None]]))

    def cuts(self, axis: str | None) -> Cuts:
        """Return the forces through cuts: see `Cuts`. Layers are as thick as the first agents."""
        number, edge = axis_of_cuts(self.grid.lattice, axis, self.applied()), self.ground.edge
        first, last = self.leaves.lower.min(axis=0), self.leaves.upper.max(axis=0)
        ends = edge * np.arange(floor(first[number] * UNIT), ceil(last[number] * UNIT) + 1.0)
        volume = self.opinions.area[1] * edge**2 * self.ground.asked.thickness
        size = self.grid.lattice.cell_size * self.size
        middle = edge * UNIT * self.leaves.middle
        parts = Carrying(middle, size, volume, self.scales.stress * self.balanced)
        # Along edges loads are linear, so two places stand for each; weight acts in the middles.
        border, fields = self.border, self.opinions.balancing
        between, off = border.at.mean(axis=1), border.run / 12**0.5
        places = [
            between - off,
            between + off,
            fields.mesh.place[fields.mesh.triangle].mean(axis=1),
        ]
        even, tilt = 0.5 * border.given, border.tilted / 12**0.5
        loads = self.scales.force * np.vstack(
            [even - tilt, even + tilt, fields.area[:, None] * self.ground.weight]
        )
        held = [edge * border.at[border.held[:, k], :, number] for k in (0, 1)]
        far = np.stack([one.max(initial=-inf) > ends[:-1] for one in held], axis=1)
        near = np.stack([one.min(initial=inf) < ends[1:] for one in held], axis=1)
        at = edge * np.concatenate(places)[:, number]
        return cuts_through(number, ends, parts, (at, loads), (far, near))

    def cells_at(self, points: Floats) -> tuple[Ints, Flags]:
        """Return agents in or on which points (m) lie, and which lie in the body or on its edge."""
        leaf = self._leaf(points := points_in(points, 2))
        return leaf, np.asarray((leaf >= 0) & (self.ground.material_at(points) >= 0))

    def material_at(self, points: Floats) -> Ints:
        """Return which of the scene's materials is at points (m), -1 outside of the body."""
        points = points_in(points, 2)
        found = np.maximum(self.ground.material_at(points), -1)
        return np.where(self._leaf(points) >= 0, found, -1)

    def placed(self, points: Floats, cells: Ints | None = None) -> tuple[Ints, Floats]:
        """Return the agents in or on which points (m) lie, or those near, and places in edges."""
        leaf, places = self._leaf(points), points / self.ground.edge
        if (beyond := leaf < 0).any():
            leaf[beyond] = nearest(self.leaves.middle * UNIT, places[beyond])[1]
        return leaf, places

    def law_at(self, points: Floats, cells: Ints | None = None) -> Ints:
        """Return the index of the moduli at points (m) of the body."""
        return self.ground.material_at(points)

    def _leaf(self, points: Floats) -> Ints:
        """Return an agent that each point (m) lies in or on, -1 for none."""
        near = [UNIT * np.array(off) for off in product((1e-3, -1e-3), repeat=2)]
        found = np.stack([leaf_at(self.leaves, points / self.ground.edge + off) for off in near])
        return np.asarray(found[(found >= 0).argmax(axis=0), np.arange(len(points))])

    def pieces(self) -> tuple[Ints, list[Floats]]:
        """Return the triangles (m) that agents hold, and whose each is.

        Curves are drawn by tangents or chords as far apart as the agents are large.
        """
        mesh = self.opinions.fitting.mesh
        return mesh.leaf, [self.ground.edge * mesh.place[mesh.triangle]]

    def at_corners(self) -> tuple[Ints, Floats, tuple[Floats, ...]]:
        """Return whose corners of triangles these are, where (m), and both stresses there."""
        leaf, at, told = self.opinions.at_corners
        return leaf, self.ground.edge * at, told

    @cached_property
    def along(self) -> dict[str, HoopStress]:
        """The stresses along every named outline, scaled."""
        named = {k: one.name for k, one in enumerate(self.ground.asked.body.regions) if one.name}
        return {name: HoopStress.along(self.opinions, k) for k, name in named.items()}

    def remarks(self, asked: Sequence[Stress | Deflection]) -> list[str]:
        """Return notes on parts that hang on nothing, and on peaks that are not well known."""
        notes, rough, coarse, reach, pascal = [], [], [], [], self.scales.stress
        if loose := self.opinions.loose:
            notes.append(
                f"{loose} part{'s' * (loose > 1)} of the body without support and without load; "
                "if a support was meant, give it"
            )
        regions, border = self.ground.asked.body.regions, self.border
        loaded = [regions[k].name for one in self.ground.loads for k in one.regions]
        for number, one in enumerate(self.ground.loads):
            on = one.shares(border.at, border.outline, border.side) > 0.0
            least = 1e-9 * np.linalg.norm(border.run[on]) * np.linalg.norm(one.force)
            boxed = one.spread == "even" and np.isfinite(one.box).all()
            if boxed and np.abs(border.run[on] @ one.force).max() > least:
                where = "where it ends on a flat edge, stress grows without limit"
                notes.append(f"loads.{number} drags the surface: {where}")
        for name, every in self.along.items():
            along, sought = every.counted(), any(one.at == name for one in asked)
            if not every.counts.all() and not sought:
                parts = "that of its rounded parts" if len(along.hoop) else "not told"
                notes.append(
                    f"along {name!r} stress has no limit at a corner or where it meets a side: its "
                    f"largest hoop stress is {parts}"
                )
            if (at := along.largest) is None:
                coarse += [repr(name)] if len(along.hoop) else []
                continue
            peak, off = pascal * float(along.hoop[at]), pascal * along.apart(at)
            highest = int(along.von_mises.argmax())
            reached = pascal * float(along.von_mises[highest])
            size, unit = (1e9, "GPa") if reached >= 1e10 else (1e6, "MPa")
            x, y = self.ground.edge * along.place[highest]
            told = f"{reached / size:.4g} {unit} along {name!r}, at ({x:.4g}, {y:.4g}) m"
            if name in self.ground.rigid.values():
                reach.append(told)
                continue
            if name in loaded and reached > 1.01 * abs(peak):
                notes.append(
                    "where loads act on the edge the hoop stress is not the equivalent stress: "
                    f"von Mises reaches about {told}"
                )
            # A peak that is off both fields there by more is noted.
            if off > 0.04 * abs(peak) and not sought:
                may = f"may be off by about {off / size:.2g} {unit}"
                rough.append(f"{peak / size:.4g} {unit} at {name!r} {may}")
        if reach:
            notes.append(
                f"von Mises reaches about {'; '.join(reach)}: where the part is glued to its "
                "support, which stiffens what is near, too; a bolt only presses, and makes more "
                "there and near it: see *Bolts* in *Your first bracket*"
            )
        if coarse:
            notes.append(
                f"agents along {', '.join(coarse)} are too large to tell the largest stress there; "
                "solve with a smaller tolerance, or with the outline's name as goal"
            )
        if rough:
            notes.append(
                f"largest hoop stress, by amount: {'; '.join(rough)}. To limit its error, solve "
                "with the outline's name as goal"
            )
        return notes
