"""Scenes that once crashed, never ended or were quietly wrong: right, noted, or refused by name."""

import numpy as np
import pytest
from plates import loaded, plate

from kaju import factors, solve
from kaju.errors import ConvergenceError, KajuError, OutOfMemoryError, SceneError

EVERY_WAY = [{}, {"tolerance": 0.05}, {"tolerance": 0.02}]


def material(youngs_modulus, ratio=0.3):
    return {"youngs_modulus": youngs_modulus, "poissons_ratio": ratio}


def block(youngs_modulus=1e9, ratio=0.3, load=None, **changes):
    changes |= {"material": "a", "materials": {"a": material(youngs_modulus, ratio)}}
    loads = [load or {"side": "top", "force": [0.0, -1.0]}]
    return plate([8, 8], None, size=[1.0, 1.0], loads=loads, **changes)


@pytest.mark.parametrize("how", EVERY_WAY)
@pytest.mark.parametrize("extreme", [
    {"youngs_modulus": 5e-324},
    {"youngs_modulus": 1e-300},
    {"thickness": 1e-300},
    {"load": {"side": "top", "force": [0.0, 1e300]}},
    {"load": {"side": "top", "force": [0.0, 1e140]}},  # its energy alone
])  # fmt: skip
def test_numbers_that_no_computer_holds_are_refused(extreme, how):
    with pytest.raises(SceneError, match=r"body, loads: .* 1e-?\d+"):
        solve(block(**extreme), **how)


@pytest.mark.parametrize(
    "end", [MemoryError(), SystemError("gstrf"), RuntimeError("SUPERLU_MALLOC fails for buf")]
)
def test_factors_that_do_not_fit_are_refused_by_name(monkeypatch, end):
    def full(*_, **__):
        raise end

    monkeypatch.setattr(factors, "splu", full)
    with pytest.raises(OutOfMemoryError, match="do not fit in memory; take fewer cells") as error:
        solve(block(), tolerance=0.1)
    assert isinstance(error.value, MemoryError)
    assert isinstance(error.value, KajuError)


@pytest.mark.parametrize("how", EVERY_WAY)
@pytest.mark.parametrize("force", [[1.0, 0.0], [0.0, 1.0]])
def test_a_force_on_a_held_face_goes_straight_into_the_ground(force, how):
    result = solve(block(load={"cell": [3, 0], "side": "bottom", "force": force}), **how)
    assert result.agents < 1000
    assert result.strain_energy == 0.0
    assert result.reactions["bottom"] == pytest.approx(-np.array(force), abs=1e-12)


BOTH_WAYS = [{}, {"tolerance": 0.05}]


@pytest.mark.parametrize("how", BOTH_WAYS)
@pytest.mark.parametrize(("bed", "noted"), [(1e6, False), (1e3, False), (1.0, True)])
def test_what_rounding_eats_of_a_soft_bed_is_said(bed, noted, how):
    result = solve(block(sides={"bottom": {"stiffness": bed}, "left": "roller"}), **how)
    assert result.reactions["bottom"][1] == pytest.approx(1.0, rel=1e-2)
    assert result.strain_energy == pytest.approx(0.5 / bed, rel=1e-2)
    # Agents of two minds prove the answer, however soft the bed.
    told = any("rounding leaves" in note for note in result.notes)
    assert told == (noted and "tolerance" not in how)


def test_a_bed_too_soft_for_the_digits_there_are_is_refused_or_missed():
    scene = block(sides={"bottom": {"stiffness": 1e-6}, "left": "roller"})
    with pytest.raises(SceneError, match=r"rounding leaves (about|all) .* unbalanced: stiffen"):
        solve(scene)
    missed = solve(scene, tolerance=0.05)
    assert missed.tolerance_kept == "missed"
    assert missed.energy_bounds[0] <= 0.5e6 <= missed.energy_bounds[1]


@pytest.mark.slow
def test_a_tolerance_out_of_reach_is_refused_before_it_takes_hours():
    load = {"side": "top", "force": [0.0, 0.0, -1.0]}
    scene = plate([4, 4, 4], None, size=[1.0, 1.0, 1.0], loads=[load])
    with pytest.raises(ConvergenceError, match=r"needs more than the [45]0+ allowed") as error:
        solve(scene, tolerance=1e-6)
    assert error.value.best.agents < 400_000
    assert error.value.best.error_estimate < 0.5


def test_a_bridge_that_hardly_resists_is_refused_or_missed_at_once():
    laws = {"stiff": material(1e12), "soft": material(1e-3)}
    of = {"legend": {"a": "stiff", "b": "soft"}, "materials": laws, "sides": {"left": "rigid"}}
    scene = loaded("\n".join(["aaabbbaaa"] * 6), {"side": "right", "force": [0.3, -1.0]}, **of)
    with pytest.raises(SceneError, match="bring the stiffnesses of materials"):
        solve(scene)
    assert solve(scene, tolerance=0.05).tolerance_kept == "missed"
