"""In the plane both stresses of a bound are of second order, and admissible all the same."""

from itertools import product

import numpy as np
import pytest
from exact.graded_elements import graded_elements
from spawning_bodies import STEEL, drawn

from kaju import Scene, solve
from kaju.model.elastic.bounds import admissible_displacement as admissible
from kaju.model.elastic.bounds.bound_cells import corner_ends
from kaju.model.elastic.bounds.energy_bounds import _at_supports, stress_of
from kaju.model.elastic.bounds.macroelement import _simplices
from kaju.model.elastic.moduli import moduli_at, strain_of

SOFT = {"youngs_modulus": 2e9, "poissons_ratio": 0.45}
DRAG = {"region": {"box": [[0.0, 0.2], [0.1, 0.2]]}, "force": [20.0, -50.0]}
PART = {"region": {"box": [[0.013, 0.2], [0.087, 0.2]]}, "force": [7.0, -50.0]}
INNER = [
    {"cell": [1, 1], "side": "top", "force": [0.0, -30.0]},
    {"cell": [2, 1], "side": "right", "force": [7.0, 3.0]},
    {"region": {"box": [[0.0, 0.0], [0.2, 0.2]]}, "force": [1.0, 2.0]},
]
BODIES = {
    "a re-entrant corner": (["aa..", "aa..", "aaaa", "aaaa"], [DRAG], {"bottom": "rigid"}),
    "two materials, loads within": (["bb..", "ab..", "aabb", "aaaa"], INNER, {"bottom": "rigid"}),
    "a hole beside a roller": (
        ["aaaa", "a.aa", "aaaa", "bbbb"], [DRAG, PART], {"bottom": "rigid", "left": "roller"}
    ),
    "holes that touch": (
        ["aaaa", "a.aa", "aa.a", "bbbb"], [DRAG], {"bottom": "roller", "right": "rigid"}
    ),
    "a bed and a roller": (
        ["aaaa", "aaba", "aaaa", "aaaa"], [DRAG], {"bottom": {"stiffness": 1e11}, "left": "roller"}
    ),
    "moved sides": (
        ["aaa.", "aaba", "aaaa", "aaaa"],
        [INNER[2]],
        {"bottom": "rigid", "top": {"displacement": [1e-6, -1e-6]}},
    ),
    "a side moved across itself": (
        ["aaaa", "a.bb", "aabb", "aaaa"],
        [],
        {"bottom": "rigid", "top": {"displacement": ["free", -1e-6]}},
    ),
}  # fmt: skip


def bounded(name):
    """Return the bounds of a body with agents of many sizes."""
    rows, loads, sides = BODIES[name]
    scene = drawn(rows, [STEEL, SOFT], loads, sides=sides, plane="strain", cell_size=0.05)
    result = solve(scene, tolerance=0.03 if "bed" in name else 0.1, strategy="spawning")
    assert len(np.unique(result.size)) > 1
    return result.found.tree.bracket


def whole(boxes, values_at):
    """Integrate polynomials of degree 8 on the triangles of quarters of boxes."""
    root, weight = np.polynomial.legendre.leggauss(5)
    root, weight = 0.5 * (root + 1.0), 0.5 * weight
    everyone, total = np.arange(len(boxes.size)), 0.0
    for end, corners in product(corner_ends(2), np.array(_simplices(2))):
        first, second, apex = 0.5 * (corners + end)
        for (u, one), (v, other) in product(zip(root, weight, strict=True), repeat=2):
            place = apex + (1 - u) * ((1 - v) * (first - apex) + v * (second - apex))
            # Within, so that points are told to lie in one triangle.
            inside = np.tile(place, (len(everyone), 1))
            share = one * other * (1 - u) * 0.125
            values = values_at(everyone, inside)
            total += share * float(values @ boxes.size**2)
    return total


@pytest.mark.parametrize("name", BODIES)
def test_the_stress_does_the_work_of_loads_beds_and_walls_on_any_displacement(name):
    middle = bounded(name).middle
    stress, field = middle.balanced, middle.field
    boxes, mesh = stress.boxes, stress.boxes.mesh
    function = stress.function
    # Many sizes, and a function that is not zero.
    assert len(mesh.slave)
    assert np.abs(function.own).max() > 1e-3 * boxes.largest * boxes.size.min() ** 2
    rng, kept = np.random.default_rng(0), field.displacement

    for _ in range(2):
        field.displacement = rng.normal(size=kept.shape) * np.abs(kept).max()
        field.hold()

        def power(box, inside):
            strain = field.strain_at(box, inside)
            return np.einsum("nab,nab->n", stress.at(box, inside), strain)

        own = whole(boxes, power)
        outer = field.work() - field.work_of_rest() + _at_supports(stress)[1]
        outer += field.work_on_beds(stress.borne)
        size = np.abs(field.displacement).max() * boxes.largest * boxes.size.sum()
        assert own == pytest.approx(outer, abs=1e-9 * size)


@pytest.mark.parametrize("name", [name for name in BODIES if "bed" not in name])
def test_shares_are_the_squared_distance_of_the_two_stresses(name):
    found = bounded(name)
    middle, boxes = found.middle, found.middle.balanced.boxes
    # Half the distance, and what the boxes leave of the loads.
    radius = found.error * found.norm - boxes.data_error

    def square(box, inside):
        law = moduli_at(boxes.law, box)
        off = middle.balanced.at(box, inside) - stress_of(law, middle.field.strain_at(box, inside))
        return np.einsum("nab,nab->n", off, strain_of(off, law, slice(None)))

    integral = whole(boxes, square)
    assert found.shares.sum() == pytest.approx(integral, rel=1e-8)
    assert (2.0 * radius) ** 2 == pytest.approx(integral, rel=1e-6)


def smooth(n, load):
    """Return a square on rollers, which has no corner where stress is singular."""
    return Scene(
        body={"size": [0.2, 0.2], "cells": [n, n], "material": "steel", "plane": "strain"},
        sides={"left": "roller", "right": "roller", "bottom": "roller"},
        loads=[load],
    )


@pytest.mark.parametrize(
    "load",
    [
        {"side": "top", "pressure": 1e6, "pressure_slope": [1e7, 0.0]},
        {"region": {"box": [[0.0, 0.0], [0.1, 0.2]]}, "force": [3.0, -9.0]},
    ],
)
def test_bounds_of_a_smooth_stress_fall_almost_by_four_when_cells_are_halved(load, monkeypatch):
    """That is, with the square of their size: by iterations to the end, and by as many as usual."""

    def bounds():
        return [solve(smooth(n, load), strategy="uniform").error_bound for n in (4, 8, 16)]

    usual = np.array(bounds())
    monkeypatch.setattr(admissible, "WORTHWHILE", 0.0)
    monkeypatch.setattr(admissible, "MOST_STEPS", 600)
    least = np.array(bounds())
    assert (least[:-1] > 3.2 * least[1:]).all()
    assert (usual[:-1] > 1.9 * usual[1:]).all()
    assert (usual < 3.0 * least).all()


def random_body(seed):
    """Pixels of materials of any contrast with notches, on rollers or beds, dragged or pressed."""
    rng = np.random.default_rng([31, seed])
    codes = rng.integers(1, 4, (4, 4)) * (rng.random((4, 4)) < 0.8)
    codes[:, 0] = np.maximum(codes[:, 0], 1)
    contrast = 10.0 ** rng.uniform(0, rng.choice([1, 3, 6]))
    materials = [
        {"youngs_modulus": 1e9 * e, "poissons_ratio": float(rng.uniform(-0.3, 0.48))}
        for e in (1.0, contrast, contrast**0.5)
    ]
    loads = []
    for column in rng.choice(4, 2, replace=False).tolist():
        top = int(np.flatnonzero(codes[column]).max())
        force = [float(rng.normal()) * (seed % 2), float(rng.normal())]
        loads.append({"cell": [column, top], "side": "top", "force": force})
    under = {"stiffness": float(10.0 ** rng.uniform(10, 13))} if seed % 3 == 2 else "rigid"
    sides = {"bottom": under, "left": "roller" if seed % 2 or seed % 3 == 2 else "free"}
    return drawn(codes, materials, loads, sides=sides, plane=str(rng.choice(["stress", "strain"])))


@pytest.mark.parametrize("seed", range(1, 11))
def test_bounds_of_agents_of_many_sizes_hold_what_far_more_say(seed):
    scene = random_body(seed)
    coarse, fine = (solve(scene, strategy="spawning", tolerance=t) for t in (0.3, 0.05))
    (lower, upper), (below, above) = coarse.energy_bounds, fine.energy_bounds
    assert lower <= above * (1 + 1e-9)
    assert below <= upper * (1 + 1e-9)
    if seed % 3 != 2:
        truth = graded_elements(scene, order=3, levels=10).strain_energy
        for low, high in ((lower, upper), (below, above)):
            assert low <= truth * (1 + 1e-5)
            assert truth <= high * (1 + 1e-9)


def test_bounds_that_say_nothing_do_not_decide_the_energy():
    """The truth is 5.405 J by elements of order 3; the bounds are seven orders apart."""
    picture = "#o#o#\n#.o.o\n.##o#\n.##o#"
    soft = {"youngs_modulus": 2.369e9, "poissons_ratio": -0.048}
    stiff = {"youngs_modulus": 2.369e17, "poissons_ratio": -0.255}
    box = [[3.082, 0.0], [3.082, 1.2328]]
    scene = Scene.from_drawing(
        picture,
        legend={"#": "soft", "o": "stiff", ".": "air"},
        cell_size=0.6164,
        thickness=0.9734,
        plane="strain",
        materials={"soft": soft, "stiff": stiff},
        sides={
            "bottom": {"stiffness": 219257849.9},
            "left": {"displacement": [0.0, "free"]},
            "top": {"displacement": ["free", -0.0001471863899851217]},
        },
        loads=[{"region": {"box": box}, "force": [-12737.93617896872, -8070.593097436557]}],
    )
    assert solve(scene, tolerance=0.05).strain_energy == pytest.approx(5.405, rel=0.1)
