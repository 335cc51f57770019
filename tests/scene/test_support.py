"""A body that nothing holds is refused, and so is a loose part of one."""

import pytest
from plates import loaded

from kaju import solve
from kaju.errors import SceneError, SupportError

GROUND = {"bottom": "rigid"}


@pytest.mark.parametrize("side", ["rigid", "roller", {"stiffness": 1.0}, {"displacement": [0, 0]}])
def test_whatever_holds_is_a_support(side):
    assert loaded("##\n##", sides={"left": side}).kinds([[0, 0]]).tolist() == [0]


@pytest.mark.parametrize(("drawing", "sides", "told"), [
    ("##\n##", {}, r'nothing holds the body; .*bottom = "rigid"'),
    ("##\n..", GROUND, "nothing holds the body"),
    ("#.\n.=", {}, "nothing holds the body"),
    ("..#\n...\n##.", GROUND, r"1 of its 2 parts .* the one with cell \[2, 2\]"),
    (".#\n#.", GROUND, r"the one with cell \[1, 1\]"),  # a corner does not hold
    ("...\n...", GROUND, "body: none of its cells is body"),
])  # fmt: skip
def test_a_body_or_a_part_that_touches_no_support_is_refused(drawing, sides, told):
    with pytest.raises(SceneError, match=told) as refused:
        loaded(drawing, sides=sides)
    assert isinstance(refused.value, SupportError) == ("none of" not in told)


def test_what_may_slide_is_named_by_its_cell_in_the_scene():
    with pytest.raises(SupportError, match=r"cell \(1, 0\): it could move along x"):
        solve(loaded(".##\n.##", sides={"bottom": "roller"}))


def test_loose_parts_in_space():
    slot = {"box": [[0, 0, 0.01], [0.03, 0.03, 0.02]], "material": "air"}
    with pytest.raises(SupportError, match=r"the one with cell \[0, 0, 2\]"):
        loaded([3, 3, 3], regions=[slot])
    assert loaded([3, 3, 3], regions=[slot], sides={"left": "rigid"}).stages == 1


def test_a_giant_body_is_looked_at_in_samples():
    def giant(*regions, **sides):
        how = {"cell_size": 1.0, "material": "air", "regions": list(regions)}
        return loaded([10**6, 10**6], sides=sides, **how)

    leg = {"box": [[777_777, 0], [777_779, 10]], "material": "steel"}
    assert giant(leg, bottom="rigid").stages == 1
    for sides in ({}, {"top": "rigid"}):
        with pytest.raises(SupportError, match=r"nothing holds the body"):
            giant(leg, **sides)
    assert giant(leg, {"box": [[0, 0], [10, 10]], "material": "rigid"}).stages == 1
    with pytest.raises(SceneError, match=r"body: none of its cells is body"):
        giant()
