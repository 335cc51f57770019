"""A body of hexagons as a spring network: the bridge from scenes to networks.

Every cell of the body is a node in its middle, joined to the cells it shares a face with.
An even triangular lattice of springs K in a sheet of thickness t behaves, for small strains,
as an isotropic sheet with E t = 2K/√3 and ν = 1/3, so K = (√3/2) E t.

References
----------
M. Ostoja-Starzewski, "Lattice models in micromechanics", Applied Mechanics Reviews 55 (2002)
35-60.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kaju.agents.materials import Material
from kaju.arrays import Flags, Floats, Ints
from kaju.errors import SceneError
from kaju.model.scene import Scene, cell_types
from kaju.model.scene.lattice import Cells

from .springs import SpringNetwork


def hexagon_body(scene: Scene) -> SpringNetwork:
    """Return the spring network of a hexagon-celled body; its stages are the scene's.

    Two cells of different material meet over half a spring of each. Before a rigid or a displaced
    cell stands a held node in the middle of the face, at the end of half a spring. A roller holds
    the cells before it across its side. Nodes are named by their cells, held ones by the cell and
    the direction of the face.
    """
    if scene.lattice.kind != "hexagon":
        raise SceneError(
            f"body.lattice: a spring network stands for cells of hexagons, got "
            f'{scene.lattice.kind!r}; set lattice = "hexagon"'
        )
    cells, kind = _body_cells(scene)
    stiffness = np.array([_spring_stiffness(m, scene) for m in scene.cell_materials])[kind]
    inner, inner_stiffness = _springs_between(scene, cells, stiffness)
    contacts = _contacts(scene, cells)
    nodes = len(cells) + len(contacts.cell)
    middles = scene.lattice.centres(cells)
    faces = (
        middles[contacts.cell]
        + 0.5 * scene.lattice.cell_size * (scene.lattice.normals[contacts.arm])
    )
    outer = np.stack([contacts.cell, np.arange(len(cells), nodes)], axis=1)
    held = np.zeros((nodes, 2), dtype=bool)
    held[: len(cells)] = contacts.across
    held[len(cells) :] = True
    forces, displacements = _loads(scene, cells, contacts, nodes)
    names = [tuple(cell) for cell in cells.tolist()]
    faces_held = zip(contacts.cell.tolist(), contacts.arm.tolist(), strict=True)
    names += [(*names[cell], arm) for cell, arm in faces_held]
    return SpringNetwork.build(
        np.concatenate([middles, faces]),
        np.concatenate([inner, outer]),
        np.concatenate([inner_stiffness, 2.0 * stiffness[contacts.cell]]),
        held=held,
        forces=forces,
        displacements=displacements,
        names=names,
        notes=_notes(scene),
    )


class _Contacts(NamedTuple):
    """Where cells of the body meet what holds them."""

    cell: Ints  # row of the body's cell, one for every face that is held
    arm: Ints  # direction of the face
    given: Floats  # displacement of what lies beyond (m), shape (faces, 2)
    across: Flags  # which coordinates of the body's cells rollers hold, shape (cells, 2)


def _body_cells(scene: Scene) -> tuple[Cells, Ints]:
    lower, upper = scene.bounds()
    count = int(np.prod(upper - lower))
    if count > 20_000_000:
        raise SceneError(
            f"body.cells: {count} cells are too many for a spring network, which holds them all "
            f"at once; take up to 20000000"
        )
    columns, rows = np.meshgrid(*map(np.arange, lower, upper))
    cells = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.int64)
    kind = scene.kinds(cells)
    if not (kind >= 0).any():
        raise SceneError("body: has no cells")
    return cells[kind >= 0], kind[kind >= 0]


def _spring_stiffness(material: Material, scene: Scene) -> float:
    """K of a spring between two cells of a material (N/m)."""
    modulus = material.youngs_modulus
    if scene.plane == "strain":
        modulus /= 1.0 - material.poissons_ratio**2
    return float(np.sqrt(3.0) / 2.0 * modulus * scene.thickness)


def _springs_between(scene: Scene, cells: Cells, stiffness: Floats) -> tuple[Ints, Floats]:
    """Springs between cells that share a face, and their stiffness: two halves in series."""
    lattice = scene.lattice
    key = lattice.key(cells)
    order = np.argsort(key)
    pairs = []
    for arm in lattice.axes.tolist():
        beside = lattice.key(lattice.neighbours(cells, arm))
        place = np.minimum(np.searchsorted(key[order], beside), len(key) - 1)
        found = key[order][place] == beside
        pairs.append(np.stack([np.flatnonzero(found), order[place[found]]], axis=1))
    springs = np.concatenate(pairs)
    first, second = stiffness[springs.T]
    return springs, 2.0 * first * second / (first + second)


def _contacts(scene: Scene, cells: Cells) -> _Contacts:
    lattice = scene.lattice
    found, arms, given = [], [], []
    across = np.zeros(cells.shape, dtype=bool)
    conditions = [scene.side_condition(name) for name in lattice.sides]
    # Displacements of the sides (m), and of what is inside the array.
    shifts = np.array([c.displacement or (0.0, 0.0) for c in conditions] + [(0.0, 0.0)])
    for arm in range(lattice.directions):
        beyond = lattice.neighbours(cells, arm)
        kind, side = scene.kinds(beyond), lattice.side_beyond(beyond)
        bed = kind == cell_types.FOUNDATION
        if bed.any():
            raise SceneError(
                f"sides.{lattice.sides[int(side[bed][0])]}: a spring network "
                'has no elastic foundation; take "rigid" or "roller"'
            )
        rollers = np.flatnonzero(kind == cell_types.ROLLER)
        across[rollers, side[rollers] // 2] = True
        faces = np.flatnonzero((kind == cell_types.RIGID) | (kind == cell_types.DISPLACED))
        found.append(faces)
        arms.append(np.full(len(faces), arm, dtype=np.int64))
        by_side = (kind[faces] == cell_types.DISPLACED)[:, None]
        given.append(np.where(by_side, shifts[side[faces]], 0.0))
    return _Contacts(np.concatenate(found), np.concatenate(arms), np.concatenate(given), across)


def _loads(scene: Scene, cells: Cells, contacts: _Contacts, nodes: int) -> tuple[Floats, Floats]:
    """Return forces and given displacements at the end of every stage, (stages, nodes, 2)."""
    key = scene.lattice.key(cells)
    order = np.argsort(key)
    forces = np.zeros((scene.stages, nodes, 2))
    displacements = np.zeros_like(forces)
    for stage in range(1, scene.stages + 1):
        applied = scene.applied(stage)
        rows = order[np.searchsorted(key[order], scene.lattice.key(applied.cells))]
        np.add.at(forces[stage - 1], rows, applied.force)
        displacements[stage - 1, len(cells) :] = contacts.given * (stage / scene.stages)
    return forces, displacements


def _notes(scene: Scene) -> tuple[str, ...]:
    """Say where the network's Poisson's ratio differs from the material's."""
    own = 1.0 / 4.0 if scene.plane == "strain" else 1.0 / 3.0
    return tuple(
        f"{material.name} has Poisson's ratio {material.poissons_ratio:g}, a network of springs "
        f"in plane {scene.plane} behaves as if it were {own:.4g}"
        for material in scene.cell_materials
        if abs(material.poissons_ratio - own) > 0.01
    )
