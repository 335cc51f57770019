"""The stress that balances exactly: a polynomial in every box by the staggered equations.

The equations of the staggered grid *are* the balance of a simple stress field. In every box
let τ_ab be bilinear in a and b between its edges, and σ_aa vary along a only, so that it
balances them:

    σ_aa(X) = n − Σ_b (D_b X + D'_b X²/2) − f_a X

with n the traction on the lower face, D_b the difference of τ_ab along b there, D_b + D'_b that on
the upper face, and f the force in the box. The tractions are

    n_lower, n_upper = σ_aa(middle) ± (½Σ_b D_b at that face + f_a/2)

and a face's equation says that its two boxes agree on them. So no load is left over anywhere: the
field is statically admissible, and its complementary energy is never below the true energy.

Where this picture is too simple (smaller boxes on a side, a re-entrant corner, a load along the
surface) the tractions are those of `equilibration`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import combinations

import numpy as np

from kaju.arrays import Floats, Ints
from kaju.model.elastic.bounds.admissible_displacement import AdmissibleDisplacement
from kaju.model.elastic.bounds.bound_cells import BoundCells
from kaju.model.elastic.bounds.equilibration import (
    EquilibratedTractions,
    equilibrate,
    traction_data,
    uneven_modes,
)
from kaju.model.elastic.bounds.macroelement import Macroelement, products_of
from kaju.model.elastic.bounds.shape_functions import gauss_points
from kaju.model.elastic.bounds.stress_function import (
    UNKNOWNS,
    StressFunction,
    compliance,
    strains_of_nodes,
    stresses_of_unknowns,
)
from kaju.model.elastic.equal.fields import between_corners
from kaju.model.elastic.equal.staggered import Pair
from kaju.model.elastic.moduli import Moduli, moduli_at
from kaju.model.scene.cell_types import AIR, FOUNDATION, ROLLER

WRONG = 1e-7
"""Tractions on two sides of a face that differ by this share of the largest stress disagree."""
BALANCED = 1e-6
"""Share of the largest stress that an answer may leave on a face, to be called balanced."""
MOST_UNBALANCED = 30_000
"""If more boxes disagree the answer has not settled, and equilibration would not pay."""


@dataclass
class Polynomials:
    """Balanced stresses in boxes; the last axis of all arrays counts the boxes."""

    low: Floats  # Normal traction on the lower face along every axis; shape (d, n)
    # Difference of τ_ab along b, at the lower and the upper end of a; shape (2, n)
    rise: dict[Pair, Floats]
    shear: dict[Pair, Floats]  # τ_ab at the ends of a and b; shape (2, 2, n)
    body: Floats  # Force per volume within, times the edge; shape (d, n)

    def slopes(self, axis: int) -> tuple[Floats, Floats]:
        """Return B and C of σ_aa = n + B X + C X²."""
        rises = [rise for (a, _), rise in self.rise.items() if a == axis]
        start = -sum(rise[0] for rise in rises) - self.body[axis]
        return start, -0.5 * sum(rise[1] - rise[0] for rise in rises)

    def mean_normal(self) -> Floats:
        """Return the mean normal stresses, shape (d, n)."""
        parts = []
        for axis, low in enumerate(self.low):
            b, c = self.slopes(axis)
            parts.append(low + b / 2 + c / 3)
        return np.stack(parts)

    def at(self, box: Ints, inside: Floats) -> tuple[Floats, Floats]:
        """Return normal and shear stresses at a place in each of some boxes."""
        normal, shear = [], []
        for axis, low in enumerate(self.low):
            first, second = (slope[box] for slope in self.slopes(axis))
            x = inside[:, axis]
            normal.append(low[box] + (first + second * x) * x)
        for (a, b), t in sorted(self.shear.items()):
            shear.append(between_corners(t[..., box], inside[:, a], inside[:, b]))
        return np.stack(normal), np.stack(shear)

    def high(self, axis: int) -> Floats:
        """Return the normal traction on the upper faces along an axis."""
        b, c = self.slopes(axis)
        return np.asarray(self.low[axis] + b + c)

    def energy(self, law: Moduli) -> Floats:
        """Return the complementary energy of every box."""
        d = len(self.low)
        mean = self.mean_normal()
        squares = np.zeros_like(mean[0])
        for axis, a in enumerate(self.low):
            b, c = self.slopes(axis)
            squares += a * a + a * b + (b * b + 2 * a * c) / 3 + b * c / 2 + c * c / 5
        products = sum(mean[a] * mean[b] for a, b in combinations(range(d), 2))
        # s:C⁻¹:s for C₁₁ on the diagonal and C₁₂ off it.
        share = law.lateral / (law.stretch + (d - 1) * law.lateral)
        normal = (squares - share * (squares + 2 * products)) / (law.stretch - law.lateral)
        shear = sum(_square_mean(t) for t in self.shear.values()) / law.shear
        return np.asarray(0.5 * (normal + shear))


def _square_mean(t: Floats) -> Floats:
    """Return the mean square of functions that are bilinear between four corners."""
    (a, b), (c, e) = t
    own = a * a + b * b + c * c + e * e
    return np.asarray((own + a * b + c * e + a * c + b * e + 0.5 * (a * e + b * c)) / 9)


class AdmissibleStress:
    """The statically admissible stress field of an answer."""

    def __init__(self, boxes: BoundCells) -> None:
        self.boxes = boxes
        # That of all boxes but those in `irregular`.
        self.plain = plain = polynomials(boxes.sigma, boxes.shear, boxes.body * boxes.size)
        normal = np.stack([n for a, low in enumerate(plain.low) for n in (low, plain.high(a))])
        scale = boxes.largest
        # The normal stress of the loads on sides, with the residual of the iteration; and with that
        # of the springs of beds.
        self._pressed = np.zeros(normal.shape) if boxes.rest is None else boxes.rest.copy()
        box, side, force = boxes.loads
        across = force[np.arange(len(side)), side // 2] / boxes.size[box] ** (boxes.dimension - 1)
        np.add.at(self._pressed, (side, box), (2.0 * (side % 2) - 1.0) * across)
        self._springs = self._pressed.copy()
        for bed in boxes.beds:
            pull = (1.0 - 2.0 * (bed.side % 2)) * bed.stiffness * boxes.moved[bed.side, bed.box]
            self._springs[bed.side, bed.box] += pull
        gap = np.where(boxes.uneven, 0.0, self._gaps(normal))
        gap = gap / scale if scale > 0.0 else gap
        wrong = gap > WRONG
        if np.count_nonzero(wrong) > MOST_UNBALANCED and gap.max() > BALANCED:
            self.irregular = EquilibratedTractions.none(boxes.dimension)
            self.equilibrated = False
        else:
            self.equilibrated = True
            uneven = boxes.uneven | wrong
            uneven[boxes.uneven_loads.box] = True
            given = normal, self._pressed, self._springs
            self.irregular = equilibrate(boxes, *given, uneven, WRONG * scale)
        gap[self.irregular.box] = self.irregular.left / (scale or 1.0)
        self.normal = normal
        self.left = float(gap.max(initial=0.0))  # Unbalanced share of the largest stress
        self._forms = Macroelement.of_laws(boxes.dimension, boxes.law, self.irregular.box)
        self.function: StressFunction | None = None

    def improve(self, field: AdmissibleDisplacement, gap: float) -> None:
        """Add a stress function; `gap` is how far the energy may be above the least."""
        self.function = StressFunction(field, *self._products(field), gap)

    def _products(self, field: AdmissibleDisplacement) -> tuple[Floats, Floats]:
        """Return products with stress functions, by the law, and with strains of nodes."""
        # Shape (elements, 16) each, in unit elements.
        boxes, mesh = self.boxes, field.mesh
        felt, on_nodes = (np.zeros((len(mesh.owner), UNKNOWNS)) for _ in range(2))
        regular = np.ones(len(boxes.size), dtype=np.bool_)
        regular[self.irregular.box] = False
        box = np.flatnonzero(regular)
        like, unlike, shear = compliance(moduli_at(boxes.law, box))
        for inside, of_unknowns, of_nodes in zip(*_at_points(), strict=True):
            (x, y), (tau,) = self.plain.at(box, inside)
            strain = np.stack([like * x + unlike * y, like * y + unlike * x, shear * tau])
            felt[box] += strain.T @ of_unknowns
            on_nodes[box] += np.stack([x, y, tau]).T @ of_nodes
        for some, form in self._forms:
            law = compliance(moduli_at(boxes.law, some[:1]))[:, 0].tolist()
            cut = mesh.parts[0, some] != mesh.parts[1, some]
            data = self._data(some)
            for part, tables in enumerate(products_of(form, *law)):
                whole_felt, whole_nodes, felt_part, nodes_part = tables
                uncut = some[~cut]
                felt[uncut] += data[~cut] @ whole_felt
                on_nodes[uncut] += data[~cut] @ whole_nodes
                at = mesh.parts[part, some[cut]]
                felt[at], on_nodes[at] = data[cut] @ felt_part, data[cut] @ nodes_part
        return felt, on_nodes

    def _gaps(self, normal: Floats) -> Floats:
        """Return the largest jump of the normal traction on the sides of every box."""
        boxes = self.boxes
        gap = np.zeros(len(boxes.size))
        for side, own in enumerate(normal):
            other = boxes.beside[side]
            # A load on a face between two boxes parts their tractions.
            mine, theirs = own - self._pressed[side], normal[side ^ 1] - self._pressed[side ^ 1]
            free = np.flatnonzero((other < 0) & (boxes.kind[side] == AIR))
            gap[free] = np.maximum(gap[free], np.abs(mine[free]))
            # Beside the end of a drag the corner's shear is half of it, where no force is.
            slips = np.isin(boxes.kind[side], (AIR, ROLLER, FOUNDATION))
            slides = np.flatnonzero((other < 0) & slips)
            for pair, tau in boxes.shear.items():
                if side // 2 in pair:
                    ends = np.take(tau[..., slides], side % 2, axis=pair.index(side // 2))
                    gap[slides] = np.maximum(gap[slides], np.abs(ends).max(axis=0))
            if side % 2:
                alike = np.flatnonzero((other >= 0) & (boxes.size[other] == boxes.size))
                other = other[alike]
                off = np.abs(mine[alike] - theirs[other])
                gap[alike] = np.maximum(gap[alike], off)
                gap[other] = np.maximum(gap[other], off)
        for bed in boxes.beds:
            # A bed does not bear the couples of loads along the surface.
            off = np.abs(normal[bed.side, bed.box] - self._springs[bed.side, bed.box])
            gap[bed.box] = np.maximum(gap[bed.box], off)
        return gap

    def traction(self, side: int, box: Ints) -> Floats:
        """Return mean tractions on a side of boxes, as stress components: shape (d, n)."""
        axis, upper = divmod(side, 2)
        found = np.empty((self.boxes.dimension, len(box)))
        for component in range(len(found)):
            if component == axis:
                found[component] = self.normal[side, box]
                continue
            pair = (min(axis, component), max(axis, component))
            ends = self.plain.shear[pair][..., box]
            ends = ends[upper] if pair[0] == axis else ends[:, upper]
            found[component] = ends.mean(axis=0)
        if len(self.irregular.box):
            at = self.irregular.at(box)
            found[:, at >= 0] = self.irregular.traction[at[at >= 0], side, ..., 0].mean(axis=1).T
        return found if self.function is None else found + self.function.traction(side, box)

    def borne(self, side: int, box: Ints) -> Floats:
        """Return the stress that a bed bears on sides of boxes, their loads not among it."""
        # Shape (n, parts, d): by part of the side its mean and slopes (`EquilibratedTractions`).
        d, pressed = self.boxes.dimension, self._pressed[side, box, None]
        modes = np.zeros((len(box), 1 << (d - 1), d))
        modes[..., 0] = self.normal[side, box, None]
        if len(self.irregular.box):
            at = self.irregular.at(box)
            slopes = uneven_modes(self.boxes, self.irregular)[at[at >= 0], side]
            modes[at >= 0] = (self.irregular.traction[at[at >= 0], side] - slopes)[:, :, side // 2]
        modes[..., 0] -= pressed
        return modes

    @property
    def energies(self) -> Floats:
        """The complementary energy of every box, scaled."""
        own = self._energies_of_plain
        return own if self.function is None else own + self.function.energies

    @cached_property
    def _energies_of_plain(self) -> Floats:
        """The same without the stress function."""
        energy = self.plain.energy(self.boxes.law)
        for box, form in self._forms:
            energy[box] = form.energy(self._data(box))
        return np.asarray(energy * self.boxes.size**self.boxes.dimension)

    def means(self) -> Floats:
        """Return the mean stress tensors of the boxes, shape (boxes, d, d)."""
        normal = self.plain.mean_normal()
        shear = np.stack([self.plain.shear[p].mean(axis=(0, 1)) for p in sorted(self.plain.shear)])
        found = np.concatenate([normal, shear])
        for box, form in self._forms:
            found[:, box] = form.mean(self._data(box))
        if self.function is not None:
            found += self.function.means()
        return _tensors(found, self.boxes.dimension)

    def at(self, box: Ints, inside: Floats) -> Floats:
        """Return the stress tensors, shape (n, d, d), at places from 0 to 1 in n boxes."""
        found = np.concatenate(self.plain.at(box, inside))
        for some, form in self._forms:
            here = np.flatnonzero(np.isin(box, some))
            found[:, here] = form.at(self._data(box[here]), inside[here])
        if self.function is not None:
            found += self.function.at(*self.function.field.located(box, inside))
        return _tensors(found, self.boxes.dimension)

    def _data(self, box: Ints) -> Floats:
        return traction_data(self.boxes, self.irregular, self.irregular.at(box))


@lru_cache(maxsize=1)
def _at_points() -> tuple[Floats, Floats, Floats]:
    """Return points, and weighted stresses of unknowns and strains of nodes there."""
    points, weights = gauss_points(2, 3)
    own = stresses_of_unknowns(points) * weights, strains_of_nodes(points) * weights
    return points[:, None], np.moveaxis(own[0], 2, 0), np.moveaxis(own[1], 2, 0)


def _tensors(stress: Floats, d: int) -> Floats:
    """Return tensors, shape (n, d, d), by normal stresses, then shear stresses pair by pair."""
    found = np.empty((stress.shape[1], d, d))
    for axis in range(d):
        found[:, axis, axis] = stress[axis]
    for (a, b), tau in zip(combinations(range(d), 2), stress[d:], strict=True):
        found[:, a, b] = found[:, b, a] = tau
    return found


def polynomials(sigma: Floats, shear: dict[Pair, Floats], body: Floats) -> Polynomials:
    """Return the balanced stresses by those in the middles and at the edges of boxes."""
    rise = {}
    for (a, b), t in shear.items():
        rise[a, b] = t[:, 1] - t[:, 0]
        rise[b, a] = t[1] - t[0]
    low = sigma + 0.5 * body
    for (axis, _), difference in rise.items():
        low[axis] += 0.5 * difference[0]
    return Polynomials(low, rise, shear, body)
