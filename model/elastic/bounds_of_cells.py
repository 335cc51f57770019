"""What agents of two minds prove of the energy of equal cells: on the same body."""

from __future__ import annotations

import numpy as np

from kaju.arrays import Floats
from kaju.errors import KajuError
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.equal.grid import repeated
from kaju.model.elastic.pair.loop import PairLoop
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.scene import Scene
from kaju.model.scene.cell_types import AIR, RIGID, ROLLER
from kaju.stopping import interrupt_requested

CLOSEST = 1e-3
"""Bounds are no closer than those of this error: a second or two on a plate with a hole."""


def bounds_of_cells(cells: CellAgents) -> tuple[float, float] | None:
    """Return energies (J) below and above that of a plane body, None if there are none."""
    # As close as the estimated error of the cells: the energy of their answer is hardly closer.
    scene = cells.grid
    if cells.factor is not None:
        scene = of_as_many_materials(scene, np.asarray(repeated(cells.factor, cells.division)))
    try:
        body = PosedBody(scene, cells.stage)
        agents = PairLoop(body, max(cells.solution.error, CLOSEST))
        while not agents.finished and not (agents.last and interrupt_requested()):
            agents.step()
    except KajuError:
        return None
    assert agents.last is not None
    bounds, unit = agents.last.bounds, body.scales.energy
    return bounds.lower * unit, bounds.upper * unit


def of_as_many_materials(scene: Scene, stiffness: Floats) -> Scene:
    """Return a scene with a material for every stiffness that a field gives its cells."""
    kinds = scene.rasterise().astype(np.int64)
    body = kinds >= 0
    pairs = np.stack([kinds[body].astype(np.float64), stiffness[body]])
    laws, which = np.unique(pairs, axis=1, return_inverse=True)
    codes = kinds.copy()
    codes[body] = which.ravel()
    names = {code: f"material {code}" for code in range(laws.shape[1])}
    materials = {}
    for code, (kind, factor) in enumerate(laws.T):
        own = scene.cell_materials[int(kind)]
        materials[names[code]] = {
            "youngs_modulus": float(own.youngs_modulus * factor),
            "poissons_ratio": own.poissons_ratio,
            "density": own.density,
        }
    described = {
        "array": codes,
        "cell_size": scene.lattice.cell_size,
        "thickness": scene.thickness,
        "plane": scene.plane,
        "gravity": scene.body.gravity,
        "allow_floating": True,
    }
    beyond = {AIR: "air", RIGID: "rigid", ROLLER: "roller"}
    legend = names | {code: word for code, word in beyond.items() if (kinds == code).any()}
    return scene.replace(body=described, legend=legend, materials=materials)
