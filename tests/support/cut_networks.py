"""Triangular networks with a cut across their middle, pulled apart at top and bottom."""

import numpy as np

import kaju
from kaju.model.network.spring_lattices import triangular


def cut_network(width, rows, half, given=False):
    """Return a lattice of springs of 1 N/m, a cut of 2·half spacings, and its true half length."""
    whole = triangular(width, rows)
    positions = whole.positions
    height, middle = positions[:, 1], 0.5 * np.ptp(positions[:, 1]) + 1e-6
    ends = positions[whole.springs]
    crossing = (ends[:, 0, 1] < middle) != (ends[:, 1, 1] < middle)
    away = np.abs(ends[:, :, 0].mean(axis=1) - positions[:, 0].mean())
    cut = crossing & (away < half)
    top, bottom = height == height.max(), height == height.min()
    held = np.zeros_like(positions, dtype=bool)
    held[bottom, 1] = True
    held[np.flatnonzero(bottom)[0]] = True
    pull = np.zeros_like(positions)
    pull[top, 1] = 1.0
    if given:
        held[top, 1] = True
        load = {"displacements": pull}
    else:
        pull[np.flatnonzero(top)[[0, -1]], 1] = 0.5
        load = {"forces": pull}
    springs = whole.springs[~cut]
    network = kaju.SpringNetwork.build(positions, springs, 1.0, held=held, **load)
    return network, cut.sum() / 4.0


def bundle(count):
    """Return fibres side by side, each of 1 N/m, under 1 N."""
    return kaju.SpringNetwork.build(
        [[0.0, 0.0], [1.0, 0.0]],
        np.tile([[0, 1]], (count, 1)),
        held=[[True, True], [False, True]],
        forces=[[0.0, 0.0], [1.0, 0.0]],
    )
