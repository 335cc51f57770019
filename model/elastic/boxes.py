"""What a bracket is made of: boxes side by side, with the stresses the staggered grid gives them.

Equal cells and agents of many sizes are both told like this; scaled, lengths in cells.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from .problem import Floats
from .staggered import Pair
from .tractions import Portions, data_error, softest

Index = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Law(NamedTuple):
    """C₁₁, C₁₂ and μ of boxes, each an array of as many entries."""

    stretch: Floats
    lateral: Floats
    shear: Floats


class Hanging(NamedTuple):
    """Sides with smaller boxes before them: box, side, and these, in the order of `corner_ends`."""

    box: Index
    side: Index
    fine: Index


class Loads(NamedTuple):
    """Forces that enter by sides: box, side, and vectors."""

    box: Index
    side: Index
    force: Floats


class Held(NamedTuple):
    """Sides of boxes at a wall: which, RIGID or ROLLER, and how it moves, shape (n, dimension)."""

    side: int
    box: Index
    kind: int
    value: Floats


class Bed(NamedTuple):
    """Sides of boxes on a bed: which, and its stiffness per area."""

    side: int
    box: Index
    stiffness: Floats


class Mesh(NamedTuple):
    """Where a displacement without gaps has its values.

    Attributes
    ----------
    corner : int array, shape (2^dimension, boxes)
        Nodes at the corners of the boxes.
    element : int array, shape (2^dimension, elements)
        The same for the elements: the boxes, or their parts where corners of smaller ones touch.
    owner : int array, shape (elements,)
    edge : array, shape (elements,)
    parts : int array, shape (2^dimension, boxes)
        The element at every corner of a box.
    slave, masters : int arrays, shape (n,) and (2^(dimension - 1), n)
        Nodes that lie in the middle of others on a side, or an edge, that stays straight.
    start : array, shape (nodes, dimension)
        Displacements to begin with.
    still : int array
        Nodes that stay where they begin: those of the `Others`.
    """

    corner: Index
    element: Index
    owner: Index
    edge: Floats
    parts: Index
    slave: Index
    masters: Index
    start: Floats
    still: Index = np.zeros(0, dtype=np.int64)


class Others(NamedTuple):
    """Boxes that are not told one by one, since nothing happens there, and stay as they begin.

    Attributes
    ----------
    complementary, whole, rest : float
        Energies of their stress and of the displacement of their corners; the work on that of what
        an iteration has left.
    tell : callable
        Return all boxes, with the displacement of all their nodes to begin with, by the
        displacement of the nodes of those told, and by what theirs has been multiplied.
    """

    complementary: float
    whole: float
    rest: float
    tell: Callable[[Floats, float], Boxes]


def whole_mesh(corner: Index, size: Floats, start: Floats) -> Mesh:
    """Return the nodes of boxes of which none is cut."""
    each, nothing = np.arange(len(size)), np.zeros((len(corner) // 2, 0), dtype=np.int64)
    parts = np.broadcast_to(each, corner.shape)
    return Mesh(corner, corner, each, size, parts, nothing[0], nothing, start)


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes of material.

    Attributes
    ----------
    size : array, shape (boxes,)
        Edges.
    law : Law
    sigma : array, shape (dimension, boxes)
        Normal stresses in the middles.
    shear : dict from pair of axes to array, shape (2, 2, boxes)
        Shear stresses at the ends along both axes.
    body : array, shape (dimension, boxes)
        Force per volume within.
    beside : int array, shape (2·dimension, boxes)
        A box on each side, -1 for none.
    kind : int array, shape (2·dimension, boxes)
        What lies beyond each side: a material (from 0), AIR, RIGID, ROLLER or FOUNDATION.
    uneven : bool array, shape (boxes,)
        Round which a corner is re-entrant, or smaller ones hang, or a load acts along a side.
    hanging : Hanging
    loads : Loads
    uneven_loads : Portions
        Those of them that lie unevenly on their sides.
    held : list of Held
    beds : list of Bed
    mesh : Mesh
    moved : array, shape (2·dimension, boxes)
        Mean displacement of every side across itself.
    rest : array, shape (2·dimension, boxes)
        Normal stress on sides that the iteration has not balanced yet.
    unsettled : float
        Relative error in the energy norm that this is, at most.
    others : Others, optional
    of : float
        Largest stress of the answers of which this one is the difference: rounding is by it.
    """

    size: Floats
    law: Law
    sigma: Floats
    shear: dict[Pair, Floats]
    body: Floats
    beside: Index
    kind: Index
    uneven: Flags
    hanging: Hanging
    loads: Loads
    held: list[Held]
    beds: list[Bed]
    mesh: Mesh
    moved: Floats
    uneven_loads: Portions
    rest: Floats | None = None
    unsettled: float = 0.0
    others: Others | None = None
    of: float = 0.0

    @property
    def largest(self) -> float:
        """The largest stress."""
        stresses = (self.sigma, *self.shear.values())
        return max(self.of, *(float(np.abs(s).max(initial=0.0)) for s in stresses))

    @property
    def data_error(self) -> float:
        """What loads cause that the boxes do not take, in the energy norm, at most."""
        return data_error(self.uneven_loads, self.size, softest(*self.law, self.dimension))

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.sigma)

    def side_nodes(self, box: Index, side: int) -> Index:
        """Return the nodes at the corners of the elements on a side of boxes.

        Shape (2^(dimension - 1), 2^(dimension - 1), n): by corner, and by part of the side.
        """
        on = corner_ends(self.dimension)[:, side // 2] == side % 2
        return np.asarray(self.mesh.element[on][:, self.mesh.parts[on][:, box]])


def corner_ends(dimension: int) -> Index:
    """Return the corners of a box by their ends along the axes, shape (2^dimension, dimension)."""
    return np.array(list(product((0, 1), repeat=dimension)))


@lru_cache(maxsize=2)
def bodies_at_point(dimension: int) -> Index:
    """Return the numbers of bodies round a point, by its filled octants (bits) and octant."""
    ends = corner_ends(dimension)
    beside = np.asarray(np.abs(ends[:, None] - ends).sum(axis=2) == 1)
    found = np.zeros((1 << len(ends), len(ends)), dtype=np.int64)
    for filled, row in enumerate(found):
        there = np.array([filled >> k & 1 for k in range(len(ends))], dtype=np.bool_)
        _, row[there] = connected_components(csr_array(beside[np.ix_(there, there)]))
    return found


def filled_by(nodes: list[Index], octants: list[int], count: int) -> Index:
    """Return the octants round every node that boxes fill, as bits: see `parted`."""
    filled = np.zeros(count, dtype=np.int64)
    for node, bits in zip(nodes, octants, strict=True):
        filled[node] |= bits
    return filled


def parted(nodes: list[Index], octants: list[int], filled: Index) -> tuple[list[Index], Index]:
    """Give bodies that touch at a corner, or an edge, only a node each.

    Points, and lines in solids, hold nothing together: the displacement may differ on both sides.

    Parameters
    ----------
    nodes : list of int arrays
        Nodes of boxes, none of them twice in one array.
    octants : list of int
        At which of its corners (bits, in the order of `corner_ends`) boxes have these nodes; at
        several where it is in the middle of an edge or a side.
    filled : int array
        The octants round every node that are body.

    Returns
    -------
    nodes : list of int arrays
        New nodes are numbered from the number of nodes on.
    double : int array
        For every new node the old one.
    """
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
        np.where(key % len(bodies) > 0, len(filled) + np.searchsorted(more, key), node)
        for key, node in zip(keys, nodes, strict=True)
    ]
    return found, more // len(bodies)
