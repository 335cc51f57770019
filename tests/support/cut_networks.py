"""Triangular networks with a cut across their middle, pulled apart at top and bottom."""

import numpy as np

import kaju
from kaju.model.network.spring_lattices import cut, pulled, triangular


def cut_network(width, rows, half, given=False):
    """Return a lattice of springs of 1 N/m, a cut of 2·half spacings, and its true half length."""
    whole = triangular(width, rows)
    middle, level = 0.5 * (width - 1), 0.5 * np.sqrt(3.0) * (rows // 2 + 0.5)
    slit = cut(whole, (middle - half, level), (middle + half, level))
    load = {"displacement": 1.0} if given else {"force": width - 1.0}
    return pulled(slit, **load), (len(whole.springs) - len(slit.springs)) / 4.0


def bundle(count):
    """Return fibres side by side, each of 1 N/m, under 1 N."""
    return kaju.SpringNetwork.build(
        [[0.0, 0.0], [1.0, 0.0]],
        np.tile([[0, 1]], (count, 1)),
        held=[[True, True], [False, True]],
        forces=[[0.0, 0.0], [1.0, 0.0]],
    )
