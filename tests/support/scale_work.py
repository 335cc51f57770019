"""What runs under mpirun: random scenes solved by PETSc and by kaju, and ways to fail.

`mpirun -n P python tests/support/scale_work.py compare 40` prints the largest differences.
"""

import json
import os
import signal
import sys
from pathlib import Path

import numpy as np
from plates import plate as pressed

import kaju
from kaju.model.elastic.solve import solve_cells as own_solve  # the equations' own tolerance


def plate(cells=(24, 20), **changes):
    """Return a plate pressed from above, of whatever is asked."""
    top = cells[1] * 0.01
    load = {"region": {"box": [[0.05, top], [0.12, top]]}, "force": [0.3, -2.0]}
    usual = {"thickness": 0.002, "loads": [load], "rule": {"kind": "elastic"}}
    return pressed(list(cells), None, **usual | changes)


def random_scene(seed):
    """Return a body with holes, inclusions, supports and loads drawn by chance."""
    rng = np.random.default_rng(seed)
    d = 3 if seed % 4 == 3 else 2
    cells = rng.integers(9, 15, d) if d == 3 else rng.integers(13, 60, d)
    h, extent = 0.01, 0.01 * cells
    contrast = 10.0 ** rng.uniform(-4, 4)
    materials = {
        "base": {"youngs_modulus": 1e9, "poissons_ratio": float(rng.uniform(0.0, 0.4))},
        "other": {"youngs_modulus": 1e9 * contrast, "poissons_ratio": float(rng.uniform(0, 0.4))},
    }
    regions = []
    for name in rng.choice(["air", "other", "other", "air"], size=rng.integers(0, 3)):
        centre = (rng.uniform(0.3, 0.7, d) * extent).tolist()
        radius = float(rng.uniform(0.12, 0.25) * extent.min())
        round_one = {"centre": centre, "radius": radius}
        regions.append({("ball" if d == 3 else "disk"): round_one, "material": str(name)})
    body = {"cells": cells.tolist(), "cell_size": h, "material": "base", "regions": regions}
    if d == 2:
        body |= {"thickness": 0.002, "plane": str(rng.choice(["stress", "strain"]))}
    move = (rng.uniform(-1, 1, d) * 1e-5).tolist()
    more = [None, "roller", {"stiffness": 1e11}, {"displacement": move}]
    side = more[rng.integers(len(more))]
    sides = {"bottom": "rigid"} | ({} if side is None else {"left": side})
    force = (rng.uniform(-1, 1, d) * 10.0).tolist()
    low, high = 0.3 * extent, 0.6 * extent
    low[-1] = high[-1] = extent[-1]
    loads = [{"region": {"box": [low.tolist(), high.tolist()]}, "force": force}]
    if rng.random() < 0.3:
        body["gravity"] = [0.0] * (d - 1) + [-9.81]
        for material in materials.values():
            material["density"] = 1000.0
    return kaju.Scene(
        body=body, materials=materials, sides=sides, loads=loads, rule={"kind": "elastic"}
    )


def displacement(result, comm):
    """Return the displacement of all cells on the first process, None elsewhere."""
    if comm.Get_size() == 1:
        return result.cells().displacement, result.cells().stress
    (piece,) = result.pieces
    pieces = comm.gather((piece.lower, piece.upper, piece.fields))
    if pieces is None:
        return None, None
    lower = np.min([low for low, _, _ in pieces], axis=0)
    shape = np.max([high for _, high, _ in pieces], axis=0) - lower
    d = len(shape)
    whole = [np.full((*shape, d), np.nan), np.full((*shape, d, d), np.nan)]
    for low, high, fields in pieces:
        box = tuple(slice(a, b) for a, b in zip(low - lower, high - lower, strict=True))
        whole[0][box], whole[1][box] = fields["displacement"], fields["stress"]
    return whole


def apart(ours, theirs):
    """Return the largest difference as a share of the largest value."""
    assert np.array_equal(np.isnan(ours), np.isnan(theirs))
    return float(np.nanmax(np.abs(ours - theirs)) / np.nanmax(np.abs(theirs)))


def compare(count):
    from kaju.model.scale.solve_petsc import communicator

    comm = communicator()
    for seed in range(count):
        scene = random_scene(seed)
        result = kaju.solve_petsc(scene)
        moved, stress = displacement(result, comm)
        if comm.Get_rank() == 0:
            own = own_solve(scene, tolerance=1e-12)
            default = own_solve(scene, tolerance=1e-11)
            report = {
                "scene": seed,
                "displacement": apart(moved, own.cells().displacement),
                "stress": apart(stress, own.cells().stress),
                "energy": abs(result.strain_energy / own.strain_energy - 1.0),
                "reaction": max(
                    float(np.abs(result.reactions[name] - force).max())
                    for name, force in own.reactions.items()
                )
                / max(float(np.abs(force).max()) for force in own.reactions.values()),
                "iterations": result.summary()["iterations"],
                "own_iterations": default.summary()["iterations"],
                "method": own.summary()["method"],
                "error_estimate": [result.summary()["error_estimate"], own.error_estimate],
            }
            print(json.dumps(report), flush=True)


def save(folder, seed=2):
    assert kaju.solve_petsc(random_scene(seed)).save(folder) == folder


def die(folder):
    """Be killed on the last process while pieces are written."""
    from kaju.model.scale import pieces, solve_petsc

    comm = solve_petsc.communicator()
    if comm.Get_rank() == comm.Get_size() - 1:
        pieces._to_file = lambda piece: os.kill(os.getpid(), signal.SIGKILL)
    kaju.solve_petsc(plate()).save(folder)


if __name__ == "__main__":
    what, *arguments = sys.argv[1:]
    globals()[what](*(int(a) if a.isdecimal() else Path(a) for a in arguments))
