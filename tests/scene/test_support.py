"""A body that nothing holds is refused, and so is a loose part of one."""

import pytest

from kaju import Scene
from kaju.errors import SceneError, SupportError

LEGEND = {"#": "steel", ".": "air", "=": "rigid"}


def drawn(drawing, sides=None, **body):
    return Scene.from_drawing(drawing, legend=LEGEND, cell_size=1.0, sides=sides or {}, **body)


@pytest.mark.parametrize("side", ["rigid", "roller", {"stiffness": 1.0}, {"displacement": [0, 0]}])
def test_whatever_holds_is_a_support(side):
    assert drawn("##\n##", {"left": side}).kinds([[0, 0]]).tolist() == [0]


def test_rigid_cells_are_a_support():
    assert drawn("##\n.=").stages == 1


def test_a_body_that_touches_no_support_is_refused():
    with pytest.raises(SupportError, match=r'nothing holds the body; .*bottom = "rigid"'):
        drawn("##\n##")
    with pytest.raises(SupportError, match=r"nothing holds the body"):
        drawn("##\n..", {"bottom": "rigid"})
    with pytest.raises(SupportError, match=r"nothing holds the body"):
        drawn("#.\n.=")


def test_a_loose_part_is_named_by_a_cell():
    with pytest.raises(SupportError, match=r"1 of its 2 parts .* the one with cell \[2, 2\]"):
        drawn("..#\n...\n##.", {"bottom": "rigid"})


def test_a_corner_does_not_hold():
    with pytest.raises(SupportError, match=r"the one with cell \[1, 1\]"):
        drawn(".#\n#.", {"bottom": "rigid"})


def test_floating_may_be_allowed():
    assert drawn("#.\n.#", allow_floating=True).stages == 1


def test_hexagons_hold_each_other_across_rows():
    # the right neighbour above an even row's first hexagon is the first of the odd row
    assert drawn("#.\n#.", {"bottom": "rigid"}, lattice="hexagon").stages == 1
    with pytest.raises(SupportError, match=r"the one with cell \[1, 1\]"):
        drawn(".#\n#.", {"bottom": "rigid"}, lattice="hexagon")
    assert drawn("#.\n.#\n#.", {"bottom": "rigid"}, lattice="square", allow_floating=True)
    # in an even row the neighbours above are the cell before and the cell itself
    assert drawn("#.\n.#", {"bottom": "rigid"}, lattice="hexagon").stages == 1


def test_a_ragged_side_of_hexagons_holds():
    assert drawn(".\n#\n.", {"left": "rigid"}, lattice="hexagon").stages == 1
    assert drawn(".\n#\n.", {"right": "rigid"}, lattice="hexagon").stages == 1


def test_loose_parts_in_space():
    body = {"cells": [3, 3, 3], "cell_size": 1.0, "material": "steel"}
    slot = {"box": [[0, 0, 1], [3, 3, 2]], "material": "air"}
    with pytest.raises(SupportError, match=r"the one with cell \[0, 0, 2\]"):
        Scene(body={**body, "regions": [slot]}, sides={"bottom": "rigid"})
    assert Scene(body={**body, "regions": [slot]}, sides={"left": "rigid"}).stages == 1


def test_an_empty_body_is_refused():
    with pytest.raises(SceneError, match=r"body: none of the 3 x 2 cells is body"):
        drawn("...\n...", {"bottom": "rigid"})
    with pytest.raises(SceneError, match=r"body: none of the 1000000 x 1000000 cells is body"):
        Scene(body={"cells": [10**6, 10**6], "cell_size": 1.0, "material": "air"})


GIANT = {"cells": [10**6, 10**6], "cell_size": 1.0, "material": "air"}


def test_a_giant_body_is_looked_at_in_samples():
    leg = {"box": [[777_777, 0], [777_779, 10]], "material": "steel"}
    assert Scene(body={**GIANT, "regions": [leg]}, sides={"bottom": "rigid"}).stages == 1
    with pytest.raises(SupportError, match=r"nothing holds the body"):
        Scene(body={**GIANT, "regions": [leg]})
    with pytest.raises(SupportError, match=r"nothing holds the body"):
        Scene(body={**GIANT, "regions": [leg]}, sides={"top": "rigid"})
    block = {"box": [[0, 0], [10, 10]], "material": "rigid"}
    assert Scene(body={**GIANT, "regions": [leg, block]}).stages == 1
