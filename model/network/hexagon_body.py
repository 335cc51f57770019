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

import numpy as np

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
    lattice = scene.lattice
    cells = np.argwhere(scene.rasterise() >= 0)
    cells = cells[np.lexsort(cells.T)]  # row by row
    # The number of each cell, -1 where there is no body, with a rim for what lies beyond the array.
    number = np.full(np.array(lattice.shape) + 2, -1)
    number[tuple((cells + 1).T)] = np.arange(len(cells))
    kind = scene.kinds(cells)
    strain, materials = scene.plane == "strain", scene.cell_materials
    moduli = [m.youngs_modulus / (1.0 - strain * m.poissons_ratio**2) for m in materials]
    # K of a spring between two cells of a material (N/m).
    stiffness = (np.sqrt(3.0) / 2.0 * np.array(moduli) * scene.thickness)[kind]
    near = [number[tuple((lattice.neighbours(cells, arm) + 1).T)] for arm in lattice.axes.tolist()]
    between = [np.stack([np.arange(len(cells)), one], axis=1)[one >= 0] for one in near]
    inner = np.concatenate(between)  # springs between cells that share a face
    first, second = stiffness[inner.T]
    beside, arm, given, across = _contacts(scene, cells)
    nodes = len(cells) + len(beside)
    middles = lattice.centres(cells)
    faces = middles[beside] + 0.5 * lattice.cell_size * lattice.normals[arm]
    outer = np.stack([beside, np.arange(len(cells), nodes)], axis=1)
    forces = np.zeros((scene.stages, nodes, 2))
    displacements = np.zeros_like(forces)
    for stage in range(scene.stages):
        applied = scene.applied(stage + 1)
        np.add.at(forces[stage], number[tuple((applied.cells + 1).T)], applied.force)
        displacements[stage, len(cells) :] = given * ((stage + 1) / scene.stages)
    names = [tuple(cell) for cell in cells.tolist()]
    names += [(*names[cell], way) for cell, way in zip(beside.tolist(), arm.tolist(), strict=True)]
    return SpringNetwork.build(
        np.concatenate([middles, faces]),
        np.concatenate([inner, outer]),
        np.concatenate([2.0 * first * second / (first + second), 2.0 * stiffness[beside]]),
        held=np.concatenate([across, np.ones(faces.shape, dtype=bool)]),
        forces=forces,
        displacements=displacements,
        names=names,
        notes=_notes(scene),
    )


def _contacts(scene: Scene, cells: Cells) -> tuple[Ints, Ints, Floats, Flags]:
    """Return where the body is held, a row for each face, and what rollers hold.

    The body's cell, the direction of the face, and the displacement of what lies beyond (m), shape
    (faces, 2); then which coordinates of the cells rollers hold, shape (cells, 2).
    """
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
    return np.concatenate(found), np.concatenate(arms), np.concatenate(given), across


def _notes(scene: Scene) -> tuple[str, ...]:
    """Say where the network's Poisson's ratio differs from the material's."""
    own = 1.0 / 4.0 if scene.plane == "strain" else 1.0 / 3.0
    return tuple(
        f"{material.name} has Poisson's ratio {material.poissons_ratio:g}, a network of springs "
        f"in plane {scene.plane} behaves as if it were {own:.4g}"
        for material in scene.cell_materials
        if abs(material.poissons_ratio - own) > 0.01
    )
