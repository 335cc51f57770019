"""Loads: which cells and faces they act on, and with how much force."""

import pytest
from plates import loaded

LEFT, RIGHT, BOTTOM, TOP, MIDDLE = 0, 1, 2, 3, -1


def plate(*loads, cells=(4, 3), **changes):
    thickness = {"thickness": 0.5} if len(cells) == 2 else {}
    return loaded(cells, *loads, cell_size=0.1, **thickness | changes)


def rows(put):
    """Cell, direction and force of every entry, in a fixed order."""
    parts = zip(put.cells.tolist(), put.direction.tolist(), put.force.tolist(), strict=True)
    return sorted((tuple(cell), d, tuple(round(f, 12) for f in force)) for cell, d, force in parts)


@pytest.mark.parametrize(("cell", "force", "side"), [
    # by the face it points into
    ((1, 1), (0, -1), TOP),
    ((1, 1), (0, 1), BOTTOM),
    ((1, 1), (1, 0), LEFT),
    ((1, 1), (-1, 0), RIGHT),
    ((1, 1), (-0.5, -1), TOP),
    # diagonal: by the surface or in the middle
    ((1, 2), (1, -1), TOP),
    ((1, 1), (1, -1), MIDDLE),
    ((0, 2), (1, -1), MIDDLE),
])  # fmt: skip
def test_where_a_force_enters_its_cell(cell, force, side):
    assert rows(plate({"cell": cell, "force": force}).applied()) == [(cell, side, force)]


OVER_TWO = {"box": [[0.1, 0.3], [0.3, 0.3]]}
OVER_PARTS = {"box": [[0.15, 0.3], [0.3, 0.3]]}
WITHIN = {"box": [[0.1, 0.1], [0.3, 0.2]]}


@pytest.mark.parametrize(("load", "expected"), [
    ({"cell": [1, 2], "side": "left", "force": [0, -1]}, [((1, 2), LEFT, (0, -1))]),
    ({"point": [0.13, 0.17], "force": [0, -1]}, [((1, 1), TOP, (0, -1))]),
    (  # on the surface between two cells
        {"point": [0.2, 0.3], "force": [0, -1]},
        [((1, 2), TOP, (0, -0.5)), ((2, 2), TOP, (0, -0.5))],
    ),
    ({"region": OVER_TWO, "force": [0, -1]}, [((i, 2), TOP, (0, -0.5)) for i in (1, 2)]),
    ({"region": OVER_PARTS, "force": [0, -3]}, [((i, 2), TOP, (0, -i)) for i in (1, 2)]),
    ({"region": OVER_PARTS, "pressure": 100.0}, [((i, 2), TOP, (0, -2.5 * i)) for i in (1, 2)]),
    ({"region": WITHIN, "force": [1, 0]}, [((i, 1), MIDDLE, (0.5, 0)) for i in (1, 2)]),
    # 0.1 m x 0.5 m x 100 Pa
    ({"side": "left", "pressure": 100.0}, [((0, j), LEFT, (5.0, 0)) for j in range(3)]),
])  # fmt: skip
def test_which_faces_and_cells_share_a_load(load, expected):
    assert rows(plate(load).applied()) == expected


def test_loads_grow_in_their_steps():
    scene = plate(
        {"cell": [1, 2], "force": [0, -4], "steps": 4}, {"cell": [2, 2], "force": [0, -1]}
    )
    assert scene.stages == 4
    assert scene.applied(1).force.tolist() == [[0, -1], [0, -1]]
    assert scene.applied(3).force.tolist() == [[0, -3], [0, -1]]
    assert scene.applied().force.tolist() == scene.applied(4).force.tolist() == [[0, -4], [0, -1]]
    for stage in (0, 5):
        with pytest.raises(ValueError, match=rf"stage: must lie between 1 and 4, got {stage}"):
            scene.applied(stage)


def test_a_side_means_the_body_only():
    loads = {"side": "top", "force": [0, -1]}, {"side": "left", "force": [1, 0]}
    assert rows(loaded("#.#\n###", *loads).applied()) == [
        ((0, 0), LEFT, (0.5, 0)),
        ((0, 1), LEFT, (0.5, 0)),
        ((0, 1), TOP, (0, -0.5)),
        ((2, 1), TOP, (0, -0.5)),
    ]


@pytest.mark.parametrize(
    ("height", "row", "face", "force"), [(0.1, 0, TOP, (0, -1)), (0.2, 2, BOTTOM, (0, 1))]
)
def test_the_walls_of_a_hole(height, row, face, force):
    wall = {"region": {"box": [[0.1, height], [0.3, height]]}, "pressure": 20.0}
    applied = plate(wall, regions=[WITHIN | {"material": "air"}]).applied()
    assert rows(applied) == [((i, row), face, force) for i in (1, 2)]


def test_gravity_pulls_every_cell_of_the_body():
    scene = plate(
        cells=(2, 2),
        gravity=[0.0, -10.0],
        regions=[
            {"box": [[0, 0.1], [0.1, 0.2]], "material": "air"},
            {"box": [[0.1, 0.1], [0.2, 0.2]], "material": "ice"},
        ],
    )
    # density x 0.1 m x 0.1 m x 0.5 m x 10 m/s²
    assert rows(scene.applied()) == [
        ((0, 0), MIDDLE, (0, -392.5)),
        ((1, 0), MIDDLE, (0, -392.5)),
        ((1, 1), MIDDLE, (0, -45.85)),
    ]
    assert scene.applied().force[:, 0].tolist() == [0, 0, 0]


def test_a_hexagon_side_has_two_faces():
    scene = plate({"side": "top", "force": [0, -1]}, cells=(2, 2), lattice="hexagon")
    assert rows(scene.applied()) == [((i, 1), arm, (0, -0.25)) for i in range(2) for arm in (1, 2)]


@pytest.mark.parametrize(("cell", "force", "to"), [((1, 2), (0, -1), MIDDLE), ((1, 1), (1, 0), 3)])
def test_a_force_straight_at_a_corner_of_a_hexagon_enters_in_the_middle(cell, force, to):
    scene = plate({"cell": cell, "force": force}, cells=(3, 3), lattice="hexagon")
    assert rows(scene.applied()) == [(cell, to, force)]


@pytest.mark.parametrize(("load", "told"), [
    ({"cell": [4, 0], "force": [0, 1]}, r"loads.0.cell: \[4, 0\] lies outside .* 4 x 3 cells"),
    ({"cell": [0, 2], "force": [0, 1]}, r"loads.0.cell: \[0, 2\] is air, not body"),
    ({"cell": [1, 1], "force": [0, 0]}, "loads.0.force: is zero"),
    ({"cell": [1, 1], "pressure": 1.0}, "loads.0.side: is needed to press on a single cell"),
    ({"cell": [1, 1], "side": "top", "pressure": 0.0}, "loads.0.pressure: is zero"),
    ({"cell": [1, 1], "side": "tip", "force": [0, 1]}, r"no side 'tip' \(did you mean 'top'"),
    ({"cell": [1, 1], "point": [0, 0], "force": [0, 1]}, "a load acts in one place"),
    ({"force": [0, 1]}, "loads.0.cell: a load acts in one place"),
    ({"cell": [1, 1]}, "loads.0.force: .* got none"),
    ({"cell": [1, 1], "force": [0, 1], "pressure": 1.0}, "one of force, .* got force, pressure"),
    ({"cell": [1, 1], "force": [0, 1], "steps": 1.5}, "loads.0.steps: must be a whole number"),
    ({"point": [0.5, 0.1], "force": [0, 1]}, "loads.0.point: .* lies outside the array"),
    ({"side": "bottom", "force": [0, 1]}, "loads.0.side: 4 of its faces are held, .*rigid"),
    ({"region": {"box": [[0, 0.25], [1, 0.25]]}, "force": [0, 1]}, "no faces .* y = 0.25 m"),
    ({"region": {"box": [[0, 0.1], [1, 0.1]]}, "force": [0, 1]}, ", inside the body"),
    ({"region": {"box": [[0.5, 0.3], [0.6, 0.3]]}, "force": [0, 1]}, "lies outside the array"),
    ({"region": {"box": [[0, 0], [1, 1]]}, "pressure": 1.0}, "a pressure acts on a surface"),
    ({"region": {"box": [[0, 0], [0, 0]]}, "force": [0, 1]}, "no thickness along x and y"),
    ({"region": {"box": [[0, 0.2], [0.1, 0.3]]}, "force": [0, 1]}, "no cell of the body in th"),
    ({"region": {"box": [[0, 0.2], [0.1, 0.3]]}, "side": "top", "force": [0, 1]}, "leave side"),
])  # fmt: skip
def test_a_load_that_cannot_be(load, told):
    regions = [
        {"box": [[0, 0.2], [0.1, 0.3]], "material": "air"},
        {"box": [[0.1, 0.2], [0.2, 0.3]], "material": "rigid"},
    ]
    with pytest.raises(ValueError, match=told):
        plate(load, regions=regions)


def test_too_many_faces():
    with pytest.raises(ValueError, match=r"loads.0.side: selects up to 1e\+10 cells, more than 5e"):
        plate({"side": "top", "force": [0, 0, -1]}, cells=(10**5, 10**5, 10))


@pytest.mark.parametrize(("body", "told"), [
    ({"gravity": [0, -9.81], "material": "mud"}, "materials.mud.density: is needed"),
    ({"gravity": [0, -9.81], "cells": [10**5, 10**5]}, r"body.gravity: .* 1e\+10 cells"),
])  # fmt: skip
def test_gravity_that_cannot_be(body, told):
    mud = {"mud": {"youngs_modulus": 1e3, "poissons_ratio": 0.4}}
    with pytest.raises(ValueError, match=told):
        loaded(**{"cells": [2, 2], "materials": mud} | body)
