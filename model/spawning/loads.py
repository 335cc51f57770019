"""How forces on agents enter the faces; the twin on equal cells is `elasticity.loads`."""

from __future__ import annotations

import numpy as np

from kaju.model.elasticity.staggered import Pair
from kaju.model.scene.kinds import AIR, FOUNDATION, ROLLER

from .composite import Composite, Floats
from .edges import Edges
from .field import oriented
from .leaves import Flags, Index


def face_loads(grid: Composite) -> tuple[Floats, dict[Pair, Floats]]:
    """Return what the scene's loads put on the faces of agents; scaled.

    Returns
    -------
    load : array, shape (faces,)
        External force on every face.
    surface_shear : dict from pair of axes to array, shape (edges,)
        Shear stress that loads along the surface put on the edges.
    """
    entering = _Entering(grid)
    forces = grid.ground.forces(grid.leaves)
    leaf, way = forces.leaf, forces.direction
    for axis in range(grid.dimension):
        value = forces.force[:, axis]
        middle = (way < 0) & (value != 0)
        normal = (way >= 0) & (way // 2 == axis) & (value != 0)
        along = (value != 0) & ~middle & ~normal
        for end in (0, 1):
            entering.push(leaf[middle], 2 * axis + end, 0.5 * value[middle])
        entering.push(leaf[normal], way[normal], value[normal])
        for side in np.unique(way[along]):
            here = along & (way == side)
            entering.drag(axis, int(side), leaf[here], value[here])
    return entering.load, entering.surface_shear


class _Entering:
    """Forces on the sides of leaves and on faces, added up."""

    def __init__(self, grid: Composite) -> None:
        self.grid = grid
        self._share = np.zeros(len(grid.leaves) * 2 * grid.dimension)
        self._couple = np.zeros(grid.size)
        self.surface_shear = {p: np.zeros(len(e.modulus)) for p, e in grid.edges.items()}

    @property
    def load(self) -> Floats:
        """Force on every face."""
        return np.asarray(self.grid.mean.T @ self._share + self._couple)

    def push(self, leaf: Index, side: Index | int, value: Floats) -> None:
        """Enter forces normal to sides of leaves."""
        np.add.at(self._share, leaf * 2 * self.grid.dimension + side, value)

    def drag(self, axis: int, side: int, leaf: Index, value: Floats) -> None:
        """Enter forces along `axis` by the side `side`: a drag and, on a surface, a couple."""
        grid = self.grid
        normal, upper = divmod(side, 2)
        beyond = grid.beside[leaf, side]
        bare = beyond < 0
        kind = np.full(len(leaf), 0)
        kind[bare] = grid.ground.kinds_at(grid.beyond(side, leaf[bare]))
        surface = np.isin(kind, (AIR, ROLLER, FOUNDATION)) & bare
        for end in (0, 1):
            self.push(leaf, 2 * axis + end, np.where(bare, 0.5, 0.25) * value)
            self.push(beyond[~bare], 2 * axis + end, 0.25 * value[~bare])
        pair = (min(axis, normal), max(axis, normal))
        edges, taken = grid.edges[pair], leaf[surface]
        turned = oriented(edges, axis == pair[0])[1]
        outward = (2.0 * upper - 1.0) * value[surface]
        stress = 0.5 * outward / grid.length[taken] ** (grid.dimension - 1)
        np.add.at(self.surface_shear[pair], turned[taken, :, upper], stress[:, None])
        moment = 0.5 * grid.length[taken] * outward
        self._couple += _couple(edges, (axis == pair[0], upper), taken, moment)


def _couple(edges: Edges, place: tuple[bool, int], leaf: Index, moment: Floats) -> Floats:
    """Return the couples of tractions: the surface moves by more than the leaf's middle.

    By (h/2)·∂u_a/∂n outwards, which is −(h/2)·∂u_n/∂a beside a known shear strain. Where no
    surface lies beside, ∂u_a/∂n is taken from the inner edges.
    """
    first, upper = place
    (slope, tilt), turned = oriented(edges, first)  # of u_a along the normal, of u_n along a
    outer, inner = turned[leaf, :, upper], turned[leaf, :, 1 - upper]
    tilts: Flags = np.logical_and(tilt.valid[outer], tilt.wall[outer] < 0)
    slopes = slope.valid[inner] & (tilts.sum(axis=1) == 0)[:, None]
    total = np.zeros(slope.matrix.shape[1])
    for gradient, edge, some, sign in ((tilt, outer, tilts, -1.0), (slope, inner, slopes, 1.0)):
        share = some / np.maximum(some.sum(axis=1), 1)[:, None]
        weight = np.zeros(len(edges.modulus))
        np.add.at(weight, edge, sign * moment[:, None] * share)
        total += gradient.matrix.T @ weight
    return total
