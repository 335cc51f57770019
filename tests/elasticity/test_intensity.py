"""Stress intensity factors against the handbook: cracks, and the corner of an L under exact loads.

H. Tada, P. Paris, G. Irwin, *The Stress Analysis of Cracks Handbook*: the edge crack (2.11) and the
centre crack (2.1) of a strip under tension, both within 0.5 %.
"""

import numpy as np
import pytest

from kaju import Scene, solve
from kaju.errors import ParameterError
from kaju.model.elastic.intensity import _Mode

YOUNG, POISSON, PULL = 1e9, 0.3, 1e6
MATERIALS = {"m": {"youngs_modulus": YOUNG, "poissons_ratio": POISSON}}
SOFT = {"left": {"stiffness": 1e3}, "bottom": {"stiffness": 1e3}}
"""Holds a body whose loads are in balance, without bearing any."""


def strip(cells, start, end):
    """A strip 1 m wide and 2 m high, pulled, with a slit at half its height; its two ends."""
    h, rows = 1.0 / cells, 2 * cells + 1
    slit = {"box": [[start * h, cells * h], [end * h, (cells + 1) * h]], "material": "air"}
    pulls = [{"side": side, "pressure": -PULL} for side in ("top", "bottom")]
    body = {"cells": [cells, rows], "cell_size": h, "material": "m", "regions": [slit]}
    height = (cells + 0.5) * h
    tips = [(end * h, height), (start * h, height)]
    return Scene(body=body, materials=MATERIALS, sides=SOFT, loads=pulls), tips


@pytest.mark.parametrize(("cells", "slit"), [(80, 40), (120, 60)])
def test_the_edge_crack_of_the_handbook(cells, slit):
    scene, (tip, _) = strip(cells, 0, slit)
    found = solve(scene, tolerance=0.02).intensity(tip)
    part = slit / cells  # of the width
    shape = 1.122 - 0.231 * part + 10.55 * part**2 - 21.71 * part**3 + 30.382 * part**4
    truth = shape * PULL * np.sqrt(np.pi * part)
    assert found.exponents == (0.5, 0.5)
    assert abs(found.K_I - truth) < 0.02 * truth
    assert abs(found.K_I - truth) < found.error_estimate < 0.05 * truth
    assert abs(found.K_II) < 0.005 * truth


def test_both_ends_of_the_centre_crack_of_the_handbook():
    scene, tips = strip(120, 30, 90)
    answer = solve(scene, tolerance=0.05)
    for tip in tips:
        opening = answer.intensity(tip).K_I
        shape = (1.0 - 0.025 * 0.5**2 + 0.06 * 0.5**4) / np.sqrt(np.cos(0.25 * np.pi))
        assert opening == pytest.approx(shape * PULL * np.sqrt(0.25 * np.pi), rel=0.02)


def corner(cells, opens):
    """A square of 2 m without its upper right quarter, under the tractions of a field of K = 1."""
    mode, h, loads = _Mode(0.75 * np.pi, opens), 2.0 / cells, []
    nodes, weights = np.polynomial.legendre.leggauss(8)
    turned = np.exp(1.25j * np.pi)
    turn = np.array([[turned.real, -turned.imag], [turned.imag, turned.real]])
    for number, side in enumerate(("left", "right", "bottom", "top")):
        axis, upper = divmod(number, 2)
        for k in range(cells // 2 if upper else cells):
            cell = [k, k]
            cell[axis] = (cells - 1) * upper
            z = np.empty((8, 2))
            z[:, axis], z[:, 1 - axis] = 2.0 * upper - 1.0, (k + 0.5 + 0.5 * nodes) * h - 1.0
            z = (z[:, 0] + 1j * z[:, 1]) / turned
            stress = mode.fields(z, mode.exponent, 0.5 * YOUNG / (1 + POISSON), 0.0)[1]
            pull = np.einsum("ai,ijn,bj->nab", turn, stress, turn)[:, :, axis] * (2 * upper - 1)
            force = 0.5 * weights @ pull * h * PULL
            loads.append({"cell": cell, "side": side, "force": force.tolist()})
    quarter = {"box": [[1.0, 1.0], [2.0, 2.0]], "material": "air"}
    body = {"size": [2.0, 2.0], "cells": [cells, cells], "material": "m", "regions": [quarter]}
    return Scene(body=body, materials=MATERIALS, sides=SOFT, loads=loads)


@pytest.mark.parametrize("opens", [True, False])
@pytest.mark.parametrize("asked", [{"resolution": 2}, {"tolerance": 0.01}])
def test_the_corner_of_an_l_has_the_factor_that_its_loads_were_made_for(opens, asked):
    found = solve(corner(16, opens), **asked).intensity((1.0, 1.0))
    own, other = (found.K_I, found.K_II) if opens else (found.K_II, found.K_I)
    assert found.exponents == pytest.approx((0.544484, 0.908529), abs=1e-6)
    assert own == pytest.approx(PULL, rel=0.01)
    assert abs(other) < 1e-3 * PULL
    # The loads are means over cells, which makes for 0.1 %.
    most = 0.07 if "resolution" in asked else 0.05
    assert abs(own - PULL) < found.error_estimate + 2e-3 * PULL < most * PULL


@pytest.mark.parametrize("at", [(0.0, 0.0), (1.5, 1.0), (0.5, 0.5), (1.0, 1.0, 0.0), (1.0, 1.01)])
def test_places_without_a_factor_are_refused(at):
    with pytest.raises(ParameterError, match=r"^at: "):
        solve(corner(4, True)).intensity(at)


def test_a_slit_beside_edges_is_refused():
    scene, (tip, _) = strip(10, 0, 5)
    with pytest.raises(ParameterError, match=r"^at: other edges"):
        solve(scene).intensity(tip)
    with pytest.raises(ParameterError, match=r"corner of the end of a slit .* \[0.5, 1.05\] m"):
        solve(scene).intensity((tip[0], tip[1] + 0.05))
