"""Bodies in time: elastic ones by correspondence or step by step, and agents by their own loads."""

from dataclasses import replace

import numpy as np
import pytest
from exact_creep import exactly_crept, exactly_relaxed
from plates import loaded

from kaju import History, Material, ThreeElement, creep

SOFT = ThreeElement(K_f=2e5, D_f=3e5, D_d=4e6)
TIMES = np.array([0.2, 3.0, 5.2, 6.0, 10.0])
BITE = History().ramp(1.0, 0.2).hold(5.0).release(0.1).hold(20.0)
DRAWN = "\n".join(["aaaaaaaaaaaa"] * 3 + ["aaabbbbbaaaa"] * 3 + ["aaaaaaaaaaaa"] * 2)
POINTS = np.array([[0.06, 0.08], [0.02, 0.03], [0.05, 0.035]])


def scene(a, b, top=None, modulus=2e5, kind="elastic", drawn=DRAWN, ratios=(0.3, 0.3), **more):
    """A soft block with an inclusion, pressed from above or squeezed by its top."""
    sides = {"bottom": "rigid"}
    if top is not None:
        sides["top"] = {"displacement": [0.0, top]}
    rows = drawn.split("\n")
    load = {"cell": [len(rows[0]) // 2, len(rows) - 1], "force": [0.0, -0.2]}
    return loaded(
        drawn,
        *([load] if top is None else []),
        legend={"a": "one", "b": "two", ".": "air"},
        thickness=0.002,
        materials={
            "one": Material("one", 2e5, ratios[0], rheology=a),
            "two": Material("two", modulus, ratios[1], rheology=b),
        },
        sides=sides | more.pop("sides", {}),
        rule={"kind": kind} | ({"threshold": 1e-3} if kind == "prescribed" else {}),
        **more,
    )


def nearly(law):
    """Return a law that differs by so little that only a body stepped in time feels it."""
    return replace(law, K_f=law.K_f * (1.0 + 1e-9))


@pytest.mark.parametrize("drawn", [DRAWN, "aaaa\nabba\naaaa"])
@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_stepping_and_correspondence_agree(drawn, plane):
    points = POINTS if drawn == DRAWN else np.array([[0.02, 0.03], [0.011, 0.012]])
    short = creep(scene(SOFT, SOFT, drawn=drawn, plane=plane), BITE, times=TIMES)
    stepped = creep(scene(SOFT, nearly(SOFT), drawn=drawn, plane=plane), BITE, times=TIMES)
    assert short.growth is not None
    assert stepped.growth is None
    for record in range(len(TIMES)):
        for query in (
            lambda course, at: course.displacement_at(points, at),
            lambda course, at: course.stress(at),
        ):
            scale = np.nanmax(np.abs(query(short, 1)))
            np.testing.assert_allclose(
                query(stepped, record), query(short, record), atol=2e-3 * scale
            )
    for name in ("work", "stored", "dissipated"):
        scale = short.work.max()
        np.testing.assert_allclose(getattr(stepped, name), getattr(short, name), atol=2e-3 * scale)


def test_two_layers_in_a_row_add_up_their_own_creep():
    other = ThreeElement(4e4, 0.0, 1e5)
    layers = "\n".join(["bbbb"] * 4 + ["aaaa"] * 4)
    body = scene(SOFT, other, modulus=4e4, drawn=layers, ratios=(0.0, 0.0))
    pressed = body.replace(loads=[{"side": "top", "force": [0.0, -1e-2]}])
    crept = creep(pressed, BITE, times=TIMES, tolerance=1e-6)
    stress = BITE.scaled(1e-2 / (0.04 * 0.002))
    strains = [exactly_crept(law, stress, TIMES) for law in (SOFT, other)]
    sunk = -0.04 * np.sum(strains, axis=0)
    top = np.array([[0.013, 0.08], [0.04, 0.08]])
    found = np.array([crept.displacement_at(top, record)[:, 1] for record in range(len(TIMES))])
    np.testing.assert_allclose(found, sunk[:, None] * np.ones(2), atol=1e-5 * np.abs(sunk).max())


def test_a_squeezed_block_relaxes():
    squeezed = creep(scene(SOFT, SOFT, top=-0.001), BITE, times=TIMES, tolerance=1e-4)
    # All materials are alike and the support leads: stresses fade as the element's force does.
    force = exactly_relaxed(SOFT, BITE, TIMES)
    static = squeezed.static.cells().stress
    for record, fade in enumerate(force / SOFT.K_f):
        np.testing.assert_allclose(
            squeezed.stress(record), fade * static, atol=5e-4 * np.nanmax(np.abs(static))
        )
    moved = squeezed.static.displacement_at(POINTS)
    np.testing.assert_allclose(squeezed.displacement_at(POINTS, 2), moved, atol=1e-6 * 0.001)


def test_a_body_in_space_is_stepped():
    laws = {"one": SOFT, "two": nearly(SOFT)}
    body = loaded(
        [3, 3, 4],
        {"side": "top", "force": [0.0, 0.0, -0.1]},
        material="one",
        regions=[{"material": "two", "box": [[0, 0, 0], [0.03, 0.03, 0.02]]}],
        materials={name: Material(name, 2e5, 0.3, rheology=law) for name, law in laws.items()},
        rule={"kind": "elastic"},
    )
    crept = creep(body, BITE, times=TIMES, tolerance=1e-4)
    growth = 2e5 * exactly_crept(SOFT, BITE, TIMES)
    middle = np.array([[0.015, 0.015, 0.04]])
    static = crept.static.displacement_at(middle)
    for record, grown in enumerate(growth):
        np.testing.assert_allclose(
            crept.displacement_at(middle, record), grown * static,
            atol=1e-4 * growth.max() * np.abs(static).max(),
        )  # fmt: skip


AGENTS = {"kind": "prescribed", "drawn": "aaaaaaaa\naaaaaaaa\nbbbbbbbb\nbbbbbbbb", "modulus": 1e6}


def test_every_material_of_agents_takes_its_own_time():
    result = creep(scene(SOFT, None, **AGENTS), BITE, times=[*TIMES, 25.3], tolerance=1e-5)
    of_soft = 2e5 * exactly_crept(SOFT, BITE, result.times)
    np.testing.assert_allclose(result.growth[:, 0], of_soft, atol=1e-5)
    np.testing.assert_allclose(result.growth[:, 1], BITE.at(result.times), atol=1e-12)
    lower = result.static.last.material == 1
    np.testing.assert_allclose(result.squeezed(-1).strains()[lower], 0.0, atol=1e-15)
    assert np.abs(result.squeezed(-1).strains()[~lower]).max() > 0.0
    np.testing.assert_allclose(result.stress(1), result.static.stress)


def test_elastic_agents_store_the_energy_of_their_own_squeeze():
    result = creep(scene(None, None, **AGENTS), History.step(), 1.0, times=[1.0])
    modulus = np.array([2e5, 1e6])[result.static.last.material]
    squared = np.einsum("nij,nij->n", result.static.stress, result.static.stress)
    expected = np.sum(0.5 * squared / modulus * 0.01**2 * 0.002)
    assert result.stored[0] == pytest.approx(expected, rel=1e-12)
