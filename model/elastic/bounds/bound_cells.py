"""What energy bounds are made of: boxes with the stresses that the staggered grid gives them.

Equal cells, agents of many sizes and agents in blocks all take this form; scaled, lengths in cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from kaju.arrays import Flags, Floats, Ints
from kaju.model.elastic.equal.staggered import Pair
from kaju.model.elastic.moduli import Moduli
from kaju.model.elastic.uneven_loads import Portions, data_error, softest


class Hanging(NamedTuple):
    """Sides with smaller boxes before them: box, side, and these, in the order of `corner_ends`."""

    box: Ints
    side: Ints
    fine: Ints


class Loads(NamedTuple):
    """Forces that enter by sides: box, side, and vectors."""

    box: Ints
    side: Ints
    force: Floats

    @property
    def dragged(self) -> Ints:
        """Boxes with forces along a side."""
        across = np.arange(self.force.shape[1]) == self.side[:, None] // 2
        return np.asarray(self.box[(self.force * ~across).any(axis=1)])


def entered(box: Ints, direction: Ints, force: Floats, boxes: int) -> tuple[Floats, Loads]:
    """Return the forces that act within boxes, shape (d, boxes), and those that enter by sides."""
    within, body = direction < 0, np.zeros((force.shape[1], boxes))
    np.add.at(body.T, box[within], force[within])
    return body, Loads(box[~within], direction[~within], force[~within])


class HeldSides(NamedTuple):
    """Sides of boxes at a wall, whose displacement is prescribed."""

    side: int
    box: Ints
    kind: int  # RIGID or ROLLER
    value: Floats  # How the wall moves; shape (n, dimension)


class Foundation(NamedTuple):
    """Sides of boxes on a bed: which, and its stiffness per area."""

    side: int
    box: Ints
    stiffness: Floats


class Mesh(NamedTuple):
    """Nodes of a displacement without gaps: corners of boxes, or of parts of cut boxes."""

    corner: Ints  # Nodes at the corners of the boxes; shape (2^dimension, boxes)
    # The same for the elements: the boxes, or their parts where corners of smaller ones touch;
    # shape (2^dimension, elements)
    element: Ints
    owner: Ints  # Box of every element; shape (elements,)
    edge: Floats  # Shape (elements,)
    parts: Ints  # The element at every corner of a box; shape (2^dimension, boxes)
    # Nodes in the middle of a side, or an edge, that stays straight, and those at its ends; shape
    # (n,) and (2^(dimension - 1), n)
    slave: Ints
    masters: Ints
    start: Floats  # Displacements to begin with; shape (nodes, dimension)


@dataclass(frozen=True, eq=False)
class BoundCells:
    """Boxes of material."""

    size: Floats  # Edges; shape (boxes,)
    law: Moduli  # C₁₁, C₁₂ and μ, an array each of as many entries
    sigma: Floats  # Normal stresses in the middles; shape (dimension, boxes)
    shear: dict[Pair, Floats]  # Shear stresses at the ends along both axes; shape (2, 2, boxes)
    body: Floats  # Force per volume within; shape (dimension, boxes)
    beside: Ints  # A box on each side, -1 for none; shape (2·dimension, boxes)
    # What lies beyond each side: a material (from 0), AIR, RIGID, ROLLER or FOUNDATION; shape
    # (2·dimension, boxes)
    kind: Ints
    # At a re-entrant corner, beside smaller ones, or with a load along a side; shape (boxes,)
    uneven: Flags
    hanging: Hanging
    loads: Loads
    held: list[HeldSides]
    beds: list[Foundation]
    mesh: Mesh
    moved: Floats  # Mean displacement of every side across itself; shape (2·dimension, boxes)
    uneven_loads: Portions  # Those of them that lie unevenly on their sides
    # Normal stress on sides that the iteration has not balanced yet; shape (2·dimension, boxes)
    rest: Floats | None = None
    unsettled: float = 0.0  # A bound of its relative error in the energy norm
    # Largest stress of the answers of which this one is the difference: the scale of rounding
    of: float = 0.0

    @property
    def largest(self) -> float:
        """The largest stress."""
        stresses = (self.sigma, *self.shear.values())
        return max(self.of, *(float(np.abs(s).max(initial=0.0)) for s in stresses))

    @property
    def data_error(self) -> float:
        """A bound in the energy norm of what the part of loads causes that boxes do not take."""
        return data_error(self.uneven_loads, self.size, softest(*self.law, self.dimension))

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.sigma)

    def side_nodes(self, box: Ints, side: int) -> Ints:
        """Return the nodes at the corners of the elements on a side of boxes."""
        # Shape (2^(dimension - 1), 2^(dimension - 1), n): by corner, and by part of the side.
        on = np.flatnonzero(corner_ends(self.dimension)[:, side // 2] == side % 2)[:, None]
        return np.asarray(self.mesh.element[on[:, :, None], self.mesh.parts[on, box]])


def corner_ends(dimension: int) -> Ints:
    """Return the corners of a box by their ends along the axes, shape (2^dimension, dimension)."""
    return np.array(list(product((0, 1), repeat=dimension)))


@lru_cache(maxsize=2)
def bodies_at_point(dimension: int) -> Ints:
    """Return the numbers of bodies round a point, by its filled octants (bits) and octant."""
    ends = corner_ends(dimension)
    beside = np.asarray(np.abs(ends[:, None] - ends).sum(axis=2) == 1)
    found = np.zeros((1 << len(ends), len(ends)), dtype=np.int64)
    for filled, row in enumerate(found):
        there = np.array([filled >> k & 1 for k in range(len(ends))], dtype=np.bool_)
        _, row[there] = connected_components(csr_array(beside[np.ix_(there, there)]))
    return found


def split_nodes(nodes: list[Ints], octants: list[int], count: int) -> tuple[list[Ints], Ints]:
    """Give bodies that touch at a corner, or an edge, only a node each."""
    # Points, and lines in solids, hold nothing together: the displacement may differ on both sides.
    # `nodes` are arrays over boxes, none of them twice in one; `octants` tell at which of its
    # corners (bits, in the order of `corner_ends`) boxes have these, at several in the middle of an
    # edge or a side. Returned are the nodes, new ones numbered from `count` on, and for every new
    # one the old one.
    filled = np.zeros(count, dtype=np.int64)  # octants round every node that are body
    for node, bits in zip(nodes, octants, strict=True):
        filled[node] |= bits
    many = max(octants).bit_length()
    bodies = bodies_at_point(2 if many <= 4 else 3)
    several = np.asarray(bodies.any(axis=1))
    if not several[filled].any():
        return nodes, np.zeros(0, dtype=np.int64)
    keys = [
        node * len(bodies) + bodies[filled[node], bits.bit_length() - 1]
        for node, bits in zip(nodes, octants, strict=True)
    ]
    more = np.unique(np.concatenate(keys))
    more = more[more % len(bodies) > 0]
    found = [
        np.where(key % len(bodies) > 0, count + np.searchsorted(more, key), node)
        for key, node in zip(keys, nodes, strict=True)
    ]
    return found, more // len(bodies)
