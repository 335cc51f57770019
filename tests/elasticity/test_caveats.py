"""What an elastic answer says of outlines, loads and corners that its error does not hold."""

import numpy as np
import pytest
from plates import loaded

from kaju import Reaction, Scene, Stress, solve
from kaju.errors import SingularPlaceError

ROLLERS = {"left": "roller", "bottom": "roller"}


def quarter_tube(cells):
    """A Lamé tube, inner radius 1 m and outer 2 m, under 1 MPa from within."""
    disk = {"centre": [0.0, 0.0], "radius": 2.0}
    bore = {"centre": [0.0, 0.0], "radius": 1.0}
    around = {"centre": [0.0, 0.0], "radius": 1.0 + 1.01 * 2.0 / cells}
    regions = [{"disk": disk, "material": "m"}, {"disk": bore, "material": "air"}]
    law = {"youngs_modulus": 1e9, "poissons_ratio": 1 / 3}
    of = {"size": [2.0, 2.0], "material": "air", "regions": regions, "materials": {"m": law}}
    return loaded([cells] * 2, {"region": {"disk": around}, "pressure": 1e6}, sides=ROLLERS, **of)


def test_steps_are_owned_up_to_and_the_largest_stress_there_is_called_an_artefact():
    result = solve(quarter_tube(32), tolerance=0.05)
    assert result.largest_stress.left_out
    (note,) = [note for note in result.summary()["notes"] if "outlines are steps" in note]
    for said in ("stepped body", "stress at the steps grows", 'outline = "true"'):
        assert said in note


def test_bodies_along_the_axes_have_no_such_note():
    along = {"polygon": [[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]], "material": "steel"}
    result = solve(plate([along], side="top", pressure=1e5))
    assert result.caveats == ()
    assert result.summary()["largest_stress_Pa_doubt"] is None
    assert not result.largest_stress.left_out
    assert result.largest_stress.value == pytest.approx(1e5)
    # Of a single cell between walls all is near to corners without a limit, and is told.
    held = plate(cells=1, sides={"left": "rigid", "right": "rigid"}, side="top", pressure=1e5)
    assert solve(held).largest_stress.value > 1e5
    asked = [[note for note in solve(plate(pressure=p, side="top")).notes if "newtons" in note]
             for p in (6e8, 1.02e9)]  # fmt: skip
    assert asked == [[], ["von Mises reaches 1.02 GPa, more than common 'steel' bears: are these "
                          "metres, newtons and pascals?"]]  # fmt: skip


@pytest.mark.parametrize(("depth", "tolerance"), [((), None), ((), 0.3), ((2,), None), ((2,), 0.4)])
def test_regions_of_support_cells_are_told_by_name(depth, tolerance):
    near, far = [0.0] * len(depth), [0.1] * len(depth)
    ends = ("A", 0.0, "rigid"), ("B", 0.9, "roller")
    blocks = [{"box": [[x, *near, 0.0], [x + 0.1, *far, 0.1]], "material": of, "name": name}
              for name, x, of in ends]  # fmt: skip
    load = {"side": "top", "force": [0.0, *near, -1e4]}
    beam = loaded([20, *depth, 4], load, size=[1.0, *far, 0.2], sides={}, regions=blocks)
    answer = solve(beam, tolerance=tolerance)
    assert {*answer.reactions} == {"A", "B"}
    turns = 0.5 * -1e4  # about the origin, to the left
    for name, x, _ in ends:
        force, couple = answer.value_of(Reaction(name)), answer.couples[name]
        couple = -couple[1] if depth else couple  # about y, which points away
        turns += couple + (x + 0.05) * force[-1] - 0.05 * force[0]
    assert turns == pytest.approx(0.0, abs=1.0)
    (told,) = [note for note in answer.notes if "every face that they touch" in note]
    for said in ("'A' bears a couple of", "the roller 'B' holds along x and"):
        assert said in told
    if not tolerance:
        bare = [{**block, "name": None} for block in blocks]
        for kept, names in (
            (bare, {"region 0", "region 1"}),
            ([blocks[0], bare[1]], {"A", "roller"}),
        ):
            of = Scene(body=dict(beam.body) | {"regions": kept}, loads=[load])
            assert {*solve(of).reactions} == names


def plate(regions=(), cells=20, sides=None, **load):
    of = {"size": [0.2, 0.2], "regions": regions, "sides": sides or ROLLERS}
    return loaded([cells] * 2, load, **of)


@pytest.mark.parametrize("kind", ["box", "polygon"])
def test_straight_sides_between_lines_of_cells_are_told(kind):
    """Cells of 10 mm: a body 97 mm high is one of 100 mm, but of 97 mm by a true outline."""
    for high, steps in ((0.097, 1), (0.1, 1), (0.105, 2)):
        corners = [[0.0, 0.0], [0.2, 0.0], [0.2, high], [0.0, high]]
        part = {kind: corners[::2] if kind == "box" else corners, "material": "air"}
        body = plate([part], sides={"top": "rigid"}, side="right", force=[100.0, 0.0])
        notes = str(solve(body, resolution=steps).notes)
        told = "regions.0 ends at y = 0.097 m, between cells of 0.01 m: the body that is solved"
        assert (f"{told} ends at 0.1 m there" in notes) == (high < 0.1)
        assert ("between cells" in notes) == (high < 0.1)
        true = body.with_overrides({"body.regions.0.outline": "true"})
        assert "between cells" not in str(true.notes)


def on(kind, *at, **load):
    """A load on a disk (x, y, radius) or the body's part in a box or a polygon."""
    shape = {"centre": at[:2], "radius": at[2]} if kind == "disk" else list(at)
    return {"region": {kind: shape}} | load


PUSH = [0.0, -2.0]
STRIP = [-1, 0.197], [1, 0.197], [1, 1], [-1, 1]


@pytest.mark.parametrize(("load", "said"), [
    (on("box", [0.095, 0.15], [0.1, 0.2], force=PUSH), "by up to 0.01"),
    (on("disk", 0.1, 0.1, 0.03, force=[1.0, 0.0]), "0.005"),
    (
        on("disk", 0.1, 0.2, 0.033, pressure=1e3),
        "takes whole faces or cells: the edge of its region moves by up to 0.005 m",
    ),
    ({"side": "top", "couple": 1.0}, ""),
    (on("polygon", *STRIP, pressure=1e3), "0.005"),
    (on("box", [0.095, 0.2], [0.105, 0.2], force=PUSH), ""),
    (on("box", [0.09, 0.2], [0.11, 0.2], force=PUSH), ""),
    ({"point": [0.098, 0.2], "force": PUSH}, "spread over the 0.01 m"),
    ({"side": "top", "pressure": 1e3, "pressure_slope": [1e4, 0.0]}, ""),
    (on("box", [0.1, 0.2], [0.2, 0.2], force=[2.0, 0.0]), "drags the surface"),
])  # fmt: skip
def test_loads_that_do_not_act_just_where_they_are_described_are_named(load, said):
    notes = [note for note in solve(plate(**load)).notes if note.startswith("loads.0 ")]
    assert len(notes) == bool(said)
    assert all(said in note for note in notes)


def test_a_coarse_answer_says_how_to_get_a_better_one():
    narrow = plate(cell=[10, 19], force=[0.0, -2.0])
    rough = solve(narrow)
    assert rough.error_estimate > 0.1
    assert any("tolerance=0.05" in note for note in rough.notes)
    bar = loaded([16, 2, 2], {"side": "right", "couple": [1.0, 0.0, 0.0]}, sides={"left": "rigid"})
    beam = loaded([16, 4], {"side": "right", "couple": 1.0}, sides={"left": "rigid"})
    soft = {"rubber": {"youngs_modulus": 1e5, "poissons_ratio": 0.3}}
    layer = [{"box": [[0.0, 0.5], [1.0, 1.0]], "material": "rubber"}]
    of = {"size": [4.0, 1.0], "regions": layer, "materials": soft, "sides": {"left": "rigid"}}
    layers = loaded([16, 4], {"side": "right", "couple": 1.0}, **of)
    rubber = {"materials.rubber.poissons_ratio": 0.4999, "body.plane": "strain"}
    rubber |= {"body.material": "rubber", "body.regions": []}  # of which they told 3.7
    for body in (
        bar,
        beam,
        layers,
        layers.with_overrides(rubber),
    ):  # cells twice as large twist alike: they tell of 0.06
        answer, truth = solve(body), solve(body, resolution=6).strain_energy
        off = np.sqrt(answer.strain_energy / truth - 1.0)
        assert 0.6 * off < answer.error_estimate < 1.2 * off
        assert any("deflections may be off by about" in note for note in answer.notes)
    assert not any("tolerance=" in note for note in solve(narrow, tolerance=0.05).notes)
    # Two parts that meet at a corner, one on a soft bed: they were told to be off by 2e8.
    sides, push = {"top": "rigid", "bottom": {"stiffness": 1e5}}, {"cell": [3, 0], "force": [0, -1]}
    assert solve(loaded("##..\n##..\n..##\n..##", push, sides=sides)).error_estimate < 1.0
    thin = layers.with_overrides({"body.regions.0.box": [[0.0, 0.25], [4.0, 1.0]]})
    told = "one cell wide at (0, 0) beside what is far softer, and yields too much"
    assert [told in solve(thin, resolution=k).notes[0] for k in (1, 2)] == [True, False]


def test_where_sides_that_meet_are_moved_apart_no_error_is_told():
    sides = {"left": "roller", "bottom": {"displacement": [1e-5, 2e-5]}}
    body = {"cells": [1, 4], "cell_size": 0.01, "material": "steel"}
    answer = solve(Scene(body=body, sides=sides))
    assert answer.error_estimate == np.inf
    assert any("moved apart" in note for note in answer.notes)


def test_beds_that_pull_and_loads_that_cancel_are_noted():
    bed = {"left": "roller", "bottom": {"stiffness": 5e8}}
    for sides, load, said in (
        (bed, {"force": [0.0, 500.0]}, "the bed at bottom pulls over about 100% of its length"),
        (bed, {"force": [0.0, -500.0]}, ""),
        (GROUND, [{"pressure": 1e5}, {"pressure": -1e5}], "the loads cancel each other"),
    ):
        of = [{"side": "top", **one} for one in (load if isinstance(load, list) else [load])]
        for tolerance in (None, 0.3):
            notes = solve(plate(sides=sides, cells=4, **of[0]).replace(loads=of), tolerance).notes
            assert [said in note for note in notes if "bed" in note or "cancel" in note] == (
                [True] * bool(said)
            )


def box(low, high, material="air"):
    return {"box": [low, high], "material": material}


GROUND = {"bottom": "rigid"}
NOTCHED = [box([0.1, 0.1], [0.2, 0.2]), box([0.0, 0.0], [0.05, 0.05], "copper")]
L_SHAPE = plate(NOTCHED, 4, GROUND, side="top", force=[1000.0, 0.0])
CUT_IN = [box([0.0, 0.1], [0.1, 0.11]), box([0.15, 0.15], [0.18, 0.18], "copper")]
SLIT = plate(CUT_IN, 20, GROUND, point=[0.155, 0.2], force=[0.0, -1.0])
OF_THE_SLIT = [
    *((0.1, 0.1), (0.1, 0.11), (0.0, 0.0), (0.2, 0.0), (0.155, 0.2)),
    *((0.15, 0.15), (0.18, 0.15), (0.15, 0.18), (0.18, 0.18)),
]
OF_THE_L = [(0.1, 0.1), (0.0, 0.0), (0.2, 0.0), (0.05, 0.05), (0.0, 0.05), (0.05, 0.0)]


@pytest.mark.parametrize(
    ("scene", "places"),
    [(SLIT, OF_THE_SLIT), (L_SHAPE, OF_THE_L), (quarter_tube(16), [(0.625, 0.875)])],
)
def test_at_singular_places_no_stress_is_given_as_a_number(scene, places):
    answer = solve(scene)
    for at in places:
        for component in ("xx", "von_mises"):
            with pytest.raises(SingularPlaceError, match="goal: "):
                solve(scene, tolerance=0.1, goal=Stress(at, component))
            with pytest.raises(SingularPlaceError, match="value_of: "):
                answer.value_of(Stress(at, component))


def test_a_corner_among_many_cells_is_no_goal():
    many = plate(NOTCHED[:1], 1200, GROUND, side="top", force=[1000.0, 0.0])
    with pytest.raises(SingularPlaceError, match="a re-entrant corner"):
        solve(many, tolerance=0.1, goal=Stress((0.1, 0.1), "xx"))


@pytest.mark.parametrize(
    "at", [(0.05, 0.02), (0.0, 0.2), (0.1, 0.2), (0.15, 0.1), (0.1, 0.0), (0.11, 0.04)]
)
def test_elsewhere_it_is_a_number(at):
    assert np.isfinite(solve(L_SHAPE).value_of(Stress(at, "xx")))


def test_a_ball_of_cubes_is_told_of_as_steps_in_space():
    ball = {"ball": {"centre": [0.5, 0.5, 0.5], "radius": 0.3}, "material": "air"}
    body = {"cell_size": 0.2, "cells": [5] * 3, "material": "steel", "regions": [ball]}
    scene = Scene(body=body, sides={"bottom": "rigid"}, loads=[{"side": "top", "pressure": 1.0}])
    assert any("outlines are steps" in note for note in solve(scene).summary()["notes"])


def test_edges_in_space_without_a_limit_are_told_with_their_reasons():
    body = {"cell_size": 0.2, "cells": [5, 2, 2], "material": "steel"}
    twist = {"side": "right", "couple": [1e3, 0.0, 0.0]}
    twisted = solve(Scene(body=body, sides={"left": "rigid"}, loads=[twist]), tolerance=0.2)
    told = "largest von Mises within 0.4 m of the couple of loads.0"
    assert told in twisted.caveats_in_brief
    notch = {"box": [[0.4, 0.0, 0.2], [0.6, 0.4, 0.4]], "material": "air"}
    rollers = dict.fromkeys(("left", "bottom", "front"), "roller")
    for more, sides, told in (
        ({}, {"left": "rigid"}, "along edges (a support ends)"),
        ({"regions": [notch]}, {"left": "rigid"}, "(a re-entrant corner; a support ends)"),
        ({}, rollers, ""),
    ):
        scene = Scene(body=body | more, sides=sides, loads=[{"side": "right", "pressure": 1.0}])
        notes = [note for note in solve(scene).notes if "no limit of stress" in note]
        assert len(notes) == bool(told)
        assert all(told in note for note in notes)
