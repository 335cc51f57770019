"""What is to be solved, as plain arrays in scaled units.

The solver works with numbers near one whatever the scene's units are: moduli are divided
by the largest Young's modulus, forces by the largest force, lengths by the cell's edge. In
two dimensions a force per displacement has the unit E·t (t: thickness), in three E·h, so
the scaled displacement is u·E·t/F and u·E·h/F. `Scales` turns the answers back into SI.

The arrays carry one layer of ghost cells around the body, which say what lies beyond each side:
air, rigid ground, a roller or an elastic foundation. So a side needs no rule of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from kaju.arrays import Floats
from kaju.model.elastic.moduli import Moduli, is_rubber, moduli_at
from kaju.model.elastic.scales import Scales
from kaju.model.scene.cell_types import DISPLACED, RIGID, ROLLER

FaceFields = tuple[Floats, ...]  # One array per axis: values on the faces normal to it

ABSENT, FIXED, ACTIVE = 0, 1, 2
"""States of a face: no body beside it; its displacement is given; it is free to move."""


@dataclass(frozen=True)
class ElasticProblem:
    """A body on the staggered grid with its supports and loads, in scaled units."""

    # Material's index, or AIR, RIGID, ROLLER, FOUNDATION; with ghost cells
    kinds: NDArray[np.int32]
    moduli: Moduli  # Scaled moduli, one entry per material
    # External force on every face, scaled; one more than `kinds` along the normal
    force: FaceFields
    fixed: FaceFields  # Displacement of the fixed faces, scaled (zero elsewhere)
    spring: FaceFields  # Stiffness of the foundation beneath each face, scaled
    # Shear stress that loads along the surface put on the edges, scaled
    surface_shear: dict[tuple[int, int], Floats]
    moved: Floats  # Displacement of the body's sides, scaled; shape (axis, end, component)
    scales: Scales  # What one scaled unit is in SI
    plane: Literal["stress", "strain"] | None  # None in three dimensions
    thickness: float = 1.0  # Thickness (m); 1 in three dimensions
    # Shear moduli of the edges by pairs of axes, scaled, where they are not by the cells round them
    edges: dict[tuple[int, int], Floats] | None = None

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return self.kinds.ndim

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of cells along each axis, without ghosts."""
        return tuple(n - 2 for n in self.kinds.shape)

    @property
    def inner(self) -> tuple[slice, ...]:
        """Index of the cells without ghosts."""
        return (slice(1, -1),) * self.dimension

    @cached_property
    def face_states(self) -> tuple[NDArray[np.int8], ...]:
        """Per axis which faces are ABSENT, FIXED or ACTIVE."""
        # By what is on either side of a face, as bits: body, roller, rigid.
        of_kind = np.pad(np.full(len(self.moduli.shear), 1, dtype=np.int8), (0, -DISPLACED))
        of_kind[[ROLLER, RIGID]] = 2, 4
        state_of = np.full(8, FIXED, dtype=np.int8)
        state_of[:3] = ABSENT, ACTIVE, ABSENT
        beside, states = of_kind.take(self.kinds, mode="wrap"), []
        for axis in range(self.dimension):
            state = np.full_like(self.spring[axis], ABSENT, dtype=np.int8)
            low, high, inner = (
                (slice(None),) * axis + (part,)
                for part in (slice(None, -1), slice(1, None), slice(1, -1))
            )
            state_of.take(beside[low] | beside[high], out=state[inner], mode="clip")
            states.append(state)
        return tuple(states)

    @property
    def needs_mixed_form(self) -> bool:
        """Whether a material is so nearly incompressible that pressure needs its own unknown."""
        if not is_rubber(self.moduli, self.plane):
            return False
        return is_rubber(moduli_at(self.moduli, self.kinds[self.kinds >= 0]), self.plane)


def without_pressure(moduli: Moduli) -> Moduli:
    """Return the moduli of what a pressure of its own leaves to the displacement."""
    pressed = moduli.lateral > moduli.shear  # The others stay as they are.
    return Moduli(
        np.where(pressed, moduli.stretch - moduli.lateral, moduli.stretch),
        np.where(pressed, 0.0, moduli.lateral),
        moduli.shear,
    )


def rim_layer(dimension: int, index: int) -> tuple[slice | int, ...]:
    """Return the index of the ghost cells beyond one side, without the corners."""
    layer: list[slice | int] = [slice(1, -1)] * dimension
    layer[index // 2] = -1 if index % 2 else 0
    return tuple(layer)


def face_zeros(rim: NDArray[np.int32]) -> FaceFields:
    """Return 0 on all faces of cells, ghosts included."""
    axes = range(rim.ndim)
    return tuple(np.zeros([n + (a == axis) for a, n in enumerate(rim.shape)]) for axis in axes)


def is_box(problem: ElasticProblem) -> bool:
    """Tell whether a body is a full box of one material, sides of one kind, to be coarsened."""
    # Edge moduli that are given do not follow from the cells, so coarse cells would lose them.
    # Fewer than 16 cells along an axis are not worth a coarse box.
    if problem.edges is not None or any(n % 2 or n < 16 for n in problem.shape):
        return False
    inside = problem.kinds[problem.inner]
    if inside.flat[0] < 0 or not np.all(inside == inside.flat[0]):
        return False
    layers = [problem.kinds[rim_layer(problem.dimension, s)] for s in range(2 * problem.dimension)]
    return all(bool(np.all(layer == layer.flat[0])) for layer in layers)


def ghost_weights_of(problem: ElasticProblem) -> Floats:
    """Return for every side the weights of the first two faces that extrapolate to its ghosts."""
    # Beyond a rigid side they mirror: so a coarse box obeys the law on its own cells. Of other
    # bodies the weights are not used.
    sides = range(2 * problem.dimension)
    ends = [problem.kinds[rim_layer(problem.dimension, side)].flat[0] for side in sides]
    return np.array([(-1.0, 0.0) if end == RIGID else (2.0, -1.0) for end in ends])


def coarse_box(problem: ElasticProblem) -> ElasticProblem:
    """Return a full box on cells twice as large."""
    d = problem.dimension

    def halved(values: NDArray[Any]) -> NDArray[Any]:
        # The ghost cells beyond both ends stay. Along the normal the last face is kept as well;
        # across it the last two have one coarse face.
        every = [np.array([0, *range(1, n - 1, 2), n - 1]) for n in values.shape]
        return np.ascontiguousarray(values[np.ix_(*every)])

    return replace(
        problem,
        kinds=halved(problem.kinds),
        moduli=Moduli(*(2.0 ** (d - 2) * values for values in problem.moduli)),
        spring=tuple(2.0 ** (d - 1) * halved(values) for values in problem.spring),
    )
