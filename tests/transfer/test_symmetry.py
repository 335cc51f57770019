"""A rule that prefers no side: mirror, turn, and order of loads."""

import numpy as np
import pytest
from plates import loaded
from transfer_answers import ENGINES, of_cells

from kaju import LoadModel, PrescribedRule

RULE = PrescribedRule(threshold=1e-3)


def run(drawing, loads, sides, engine, rule=RULE):
    loads = [{"cell": cell, "force": force} for cell, force in loads]
    how = {"thickness": 0.01, "allow_floating": True}
    scene = loaded(drawing, *loads, sides=sides, rule=rule, **how)
    return LoadModel(scene, engine=engine).run()


def as_table(result):
    return of_cells(result, np.column_stack([result.last.taken, result.last.spawn_step]))


BODY = "######\n####.#\n#=####\n##..##\n######"


@ENGINES
@pytest.mark.parametrize("accumulate", [False, True])
def test_a_turned_scene_has_a_turned_result(engine, accumulate):
    alpha = (0.5, 0.4, 0.1)
    rule = PrescribedRule(alpha=alpha, threshold=1e-3, accumulate=accumulate)
    first = run(BODY, [((3, 4), (0.5, -2.0))], {"bottom": "rigid", "left": "roller"}, engine, rule)
    grid = np.array([list(line) for line in BODY.splitlines()])
    turned = "\n".join("".join(line) for line in np.rot90(grid))  # counter-clockwise
    rows = len(grid)
    load, sides = ((rows - 1 - 4, 3), (2.0, 0.5)), {"right": "rigid", "bottom": "roller"}
    second = run(turned, [load], sides, engine, rule)
    expected = {}
    for (column, row), (left, right, down, up, step) in as_table(first).items():
        expected[rows - 1 - row, column] = [up, down, left, right, step]
    found = as_table(second)
    assert found.keys() == expected.keys()
    for cell, values in expected.items():
        np.testing.assert_allclose(found[cell], values, rtol=1e-12, atol=1e-15)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    by_cell = of_cells(second, second.displacement)
    for (column, row), moved in of_cells(first, first.displacement).items():
        there = by_cell[rows - 1 - row, column]
        np.testing.assert_allclose(there, turn @ moved, rtol=1e-9, atol=1e-22)


def test_each_load_by_itself_is_superposition():
    """Judged one by one, two loads do exactly what they do alone, added up."""
    body = "\n".join(["#######"] * 4)
    left, right = ((1, 3), (0.0, -2.0)), ((4, 3), (0.5, -1.0))
    sides = {"bottom": "rigid"}
    both = as_table(run(body, [left, right], sides, "arrays"))
    alone = [as_table(run(body, [load], sides, "arrays")) for load in (left, right)]
    for cell, values in both.items():
        parts = [np.array(table[cell][:4]) for table in alone if cell in table]
        np.testing.assert_allclose(values[:4], sum(parts), rtol=1e-13)
