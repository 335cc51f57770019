"""Runs that are replayed as pictures: what is shown is what was computed."""

import re
from functools import cache

import numpy as np
import pytest
from plates import plate as pressed

import kaju
from kaju import ElasticModel, History, SpawningModel, ThreeElement, creep, solve
from kaju.model.network import NetworkModel, jittered, pulled, triangular
from kaju.view.fracture_plots import BREAKS, bearing
from kaju.view.page.data import motion_data

FARTHEST = "Math.max(...page.moved[page.g].map((_, i, at) => page.far(at, i / page.dimension | 0)))"
"""How far anything has moved in the present frame."""
THERE = "Array.from({ length: page.count }, (_, i) => page.there(i))"


def plate(force=(0.0, -2.0), **changes):
    return pressed([10, 10], [5, 9], force, size=[0.2, 0.2], thickness=0.002, **changes)


@cache
def elastic_agents():
    rule = {"kind": "elastic", "order": "wave", "threshold": 0.02}
    return ElasticModel(plate(rule=rule)).run()


def spawned():
    return SpawningModel(plate(), tolerance=0.02).run()


@cache
def network():
    return NetworkModel(triangular(5, force=0.2), 10, "euler").run()


@cache
def noodle():
    history = History().ramp(1.0, 1.0).hold(2.0).release().hold(20.0)
    law = ThreeElement(K_f=1.0, D_f=1.0, D_d=20.0)
    return creep(triangular(5), history, times=np.linspace(0.5, 23.0, 20), rheology=law)


@cache
def grown():
    return kaju.GrowthModel(plate((1.0, -2.0)), rule="stress", volume=0.4, most_steps=9).run()


def test_agents_of_every_generation_fill_the_plate():
    result = spawned()
    header, columns = motion_data(result)
    corners = columns["points"][columns["parts"].reshape(-1, 4)]
    area = (corners[:, 2] - corners[:, 0]).prod(axis=1)
    for frame, generation in enumerate(result.generations):
        there = (columns["born"] <= frame) & (frame < columns["gone"])
        assert there.sum() == generation.agents
        assert area[there].sum() == pytest.approx(0.04, rel=1e-6)
    assert header["curves"][0]["lines"]["agents"][-1] == result.agents
    told = np.array(header["curves"][1]["lines"]["error"])
    np.testing.assert_allclose(told[-1], 100.0 * result.error_bound, rtol=1e-5)
    assert told[-1] < 100.0 * result.tolerance < told[0]


def test_elastic_agents_move_as_they_yield(tmp_path):
    run = elastic_agents()
    own, axis = run.agents.level == 0, run.agents.axis[run.agents.level == 0]
    columns = motion_data(kaju.load_result(run.save(tmp_path / "run")))[1]
    moved = columns["moved"].reshape(-1, own.sum(), 2)
    assert not moved[0].any()
    along = moved[-1][np.arange(len(axis)), axis]
    np.testing.assert_allclose(along, run.agents.displacement[own], rtol=2e-5)
    # across its normal a face goes with the four faces round it, or with those that are there
    places = np.rint(run.agents.position[own] / 0.01).astype(int)  # half cells
    at = {(a, *p): d for a, p, d in zip(axis, places.tolist(), along, strict=True)}
    for a, b, (x, y), told in zip(axis, 1 - axis, places.tolist(), moved[-1], strict=True):
        round_it = [at.get((b, x + i, y + j)) for i in (-1, 1) for j in (-1, 1)]
        there = [one for one in round_it if one is not None]
        if a == 0:
            assert told[b] == pytest.approx(np.mean(there), rel=1e-4, abs=1e-14)


@cache
def cracked():
    sides = {"bottom": "rigid", "top": {"displacement": [0.0, 1e-5]}}
    scene = plate(sides=sides, loads=[]).with_region(box=[[0.0, 0.1], [0.04, 0.12]])
    return kaju.FractureModel(scene, strength=1e6, scatter=0.2, seed=1).run()


@cache
def torn():
    network = pulled(jittered(7, 7), displacement=0.1)
    return kaju.FractureModel(network, scatter=0.2, seed=1, most_breaks=9).run()


def plate_with_a_hole(**changes):
    """A plate with a round hole in its middle, of true outline, pulled to the right."""
    hole = {"disk": {"centre": [0.1, 0.1], "radius": 0.031}, "material": "air", "name": "bore"}
    pulled = {"sides": {"left": "rigid"}, "loads": [{"side": "right", "force": [1e3, 0.0]}]}
    return plate(regions=[hole | {"outline": "true"}], **pulled | changes)


@cache
def outlined():
    return solve(plate_with_a_hole(), tolerance=0.1)


KINDS = [elastic_agents, spawned, network, noodle, grown, cracked, torn, outlined]


@pytest.mark.parametrize("make", [*KINDS, lambda: solve(plate())])
def test_every_kind_plays_without_a_word_to_the_console(shown, make):
    page = shown(make(), title=make.__name__)
    assert page.text(".mode") == "a recorded run"
    last = page.js("page.run.generation")
    picture = "(page.draw(), page.canvas.toDataURL())"
    page.js("page.seek(0)")
    first = page.js(picture)
    page.tab.keyboard.press("End")
    assert page.js(f"page.g === {last} && {picture}") != first
    if page.js("page.there(0)"):
        page.tab.mouse.click(*page.spot("page.view.point(page.middle(0))"))
        assert page.told()[0] == page.js("page.value(0, page.colours[0])")


def test_a_rod_tells_how_far_its_middle_moves(shown):
    result = noodle()
    page = shown(result)
    page.js("page.goTo(8)")
    told = page.js("Array.from({ length: page.count }, (_, rod) => page.value(rod, 'move'))")
    ends = result.displacement[8][result.network.springs]
    np.testing.assert_allclose(told, np.linalg.norm(ends.mean(axis=1), axis=1), atol=1e-7)
    page.js("(page.picked = 3, page.fields.tension[8][3] = 1e-14)")  # what rounding leaves of 0
    assert page.js("page.read('tension')") == "0 mN"


def test_the_rod_that_is_drawn_is_the_one_that_was_clicked(shown):
    force = noodle().force[1]
    page = shown(noodle(), lesson={"questions": []})  # lessons draw it
    ends = "[...page.parts.story.querySelectorAll('circle')].map((end) => end.cx.baseVal.value)"
    for rod, grows in ((force.argmax(), True), (force.argmin(), False)):
        drawn = [f"(page.picked = {rod}, page.seek({g}), page.draw(), {ends})" for g in (0, 1)]
        rest, held = (np.ptp(page.js(each)) for each in drawn)
        assert (held > rest) == grows
        assert page.text(".cap").endswith(page.js("`${page.word('tension')} ${page.read()}`"))


def test_outlines_are_lines_that_the_agents_move():
    result = outlined()
    header, columns = motion_data(result)
    corners = columns["points"][columns["parts"].reshape(-1, 4)]
    stands = columns["gone"] == columns["gone"].max()
    sizes = np.sort((corners[:, 2] - corners[:, 0])[stands], axis=0)
    np.testing.assert_allclose(sizes, np.sort(result.size)[:, None] * [1, 1], 1e-5)
    box, hole = header["outlines"]
    line = columns["points"][-hole:].astype(float)
    assert line[0].tolist() == line[-1].tolist()
    assert np.ptp(columns["points"][-hole - box : -hole], axis=0) == pytest.approx([0.2, 0.2])
    away = np.hypot(*(line - 0.1).T)  # corners stand on the hole, lines between them within it
    assert away.max() == pytest.approx(0.031, rel=1e-5)
    assert away.min() > 0.994 * 0.031
    assert np.linalg.norm(np.diff(line, axis=0), axis=1).max() < 0.007
    moved = columns["moved"].reshape(len(result.generations), -1, 2)[-1]
    on, at = away > 0.03099, result.displacement_at(0.1 + 1.0001 * (line - 0.1)[away > 0.03099])
    np.testing.assert_allclose(moved[-hole:][on], at, atol=1e-9)
    *_, curve = header["curves"]
    assert re.fullmatch(r"0 = \(0.131, 0.10\d*\) m ↺", curve["place"])
    assert 0.15 < curve["at"][-1] < 2 * np.pi * 0.031  # once round, but for the last agent
    told, stress = curve["lines"]["hoop stress"], result.outline_stress("bore")[1]
    assert len(curve["at"]) == len(told) == len(stress)


def test_what_is_rigid_holds_all_round_its_outline():
    bolt = {"disk": {"centre": [0.05, 0.15], "radius": 0.01}, "outline": "true", "name": "bolt"}
    told = motion_data(solve(plate_with_a_hole().with_region("pinned", **bolt), 0.5))[0]
    # of what is glued to a bolt the hoop stress is not the largest
    titles, lines = [curve["title"] for curve in told["curves"][-2:]], told["ground"]
    assert titles == ["Hoop stress: bore", "Equivalent stress: bolt"]
    (middle,) = (line for line in lines if line["out"] == [0, 0])
    assert middle["from"] == middle["to"] == pytest.approx([0.05, 0.15])
    round_it = [line for line in lines if line["out"] not in ([-1.0, 0.0], [0, 0])]
    assert (len(round_it), len(lines)) == (24, 26)  # and the left side
    start, end, out = (np.array([line[k] for line in round_it]) for k in ("from", "to", "out"))
    inward = [0.05, 0.15] - 0.5 * (start + end)
    np.testing.assert_allclose(out, inward / np.linalg.norm(inward, axis=1, keepdims=True), 1e-9)


def test_an_answer_at_rest_is_told_once_and_shown_in_shares(shown):
    page = shown(solve(plate()))
    shares = page.js("page.at")
    assert shares == pytest.approx(np.linspace(0.0, 1.0, 21))
    stress, far = page.js(f"(page.goTo(20), [page.value(3), {FARTHEST}])")
    for frame in (0, 7):
        shown = page.js(f"(page.goTo({frame}), [page.value(3), {FARTHEST}])")
        assert shown == pytest.approx([shares[frame] * stress, shares[frame] * far])


def test_agents_cut_by_an_outline_spawn_one_generation_after_another(shown):
    result = solve(plate_with_a_hole(), tolerance=0.04)
    page = shown(result)
    assert len(result.generations) == page.js("page.at.length") > 1
    assert page.js("page.along") == "generation"
    assert "balance" not in page.text(".verdict")  # said of the prescribed rule alone
    for number, found in enumerate(result.generations):
        page.js(f"page.goTo({number})")
        there = np.flatnonzero(page.js(THERE)).tolist()
        assert len(there) == found.agents
        for name, known in (("fitted", found.fitted), ("gap", found.gap)):
            told = page.js(f"{there}.map((i) => page.value(i, '{name}'))")
            np.testing.assert_allclose(np.sort(told), np.sort(known), rtol=1e-6)
    stress = page.js(f"{there}.map((i) => page.value(i, 'von_mises'))")
    # of the smallest agents near a click that of the largest stress is picked
    page.tab.set_viewport_size({"width": 1000, "height": 260})
    page.js("page.draw()")
    places = np.array(page.js(f"{there}.map((i) => page.view.point(page.middle(i)))"))
    small = np.array(page.js(f"{there}.map((i) => page.value(i, 'level'))"))
    near = (small == small.max()) & (np.hypot(*(places - places[small.argmax()]).T) < 7.9)
    assert near.sum() > 1
    x, y = places[small.argmax()]
    page.js("page.canvas.setPointerCapture = () => {}")
    page.js(f"page.press({{ clientX: 0, clientY: 0, offsetX: {x}, offsetY: {y} }})")
    picked = page.js("page.picked")
    assert picked == there[np.where(near, stress, 0.0).argmax()] != there[near.argmax()]
    np.testing.assert_allclose(np.sort(stress), np.sort(result.largest_von_mises), rtol=1e-6)
    assert page.js(FARTHEST) == pytest.approx(result.max_displacement, rel=0.2)


def test_a_body_that_grew_is_told_step_by_step():
    result = grown()
    header, columns = motion_data(result)
    assert header["at"] == list(range(10))
    told = columns["value density"].reshape(10, 100)
    np.testing.assert_allclose(told, result.designs, atol=1.0 / 512.0 + 1e-7)
    pull = columns["value pull"].reshape(10, 100)
    np.testing.assert_array_equal(pull, np.where(result.pulled, told, -told))
    assert 0 < result.pulled.mean() < 1  # a beam that bends
    assert header["curves"][2]["lines"]["pulled"] == pytest.approx(100.0 * result.pulled_shares)
    assert header["curves"][0]["lines"]["compliance"] == result.compliances.tolist()
    assert header["curves"][1]["lines"]["volume"] == pytest.approx(100.0 * result.volumes)
    assert header["outcome"] == result.outcome
    assert [force["force"] for force in header["forces"]] == [[1.0, -2.0]]


@pytest.mark.parametrize(("broken", "name"), [(cracked, "stress"), (torn, "tension")])
def test_what_breaks_is_there_until_then(shown, broken, name):
    result = broken()
    header, columns = motion_data(result)
    frames = result.breaks + 1
    assert header["at"] == list(range(frames))
    borne = columns[f"value {name}"].reshape(frames, -1)
    states = zip(range(bearing(result, frames) + 1), result.replayed(range(frames)), strict=False)
    most = max(np.abs(result.factor_after(k) * body.borne()).max() for k, body in states)
    assert BREAKS.fixed(result, {})["largest"] == pytest.approx(most, rel=1e-12)
    for count in range(frames):  # the first picture is that of a body without a load
        left = next(result.replayed([max(count - 1, 0)]))
        largest = (result.factor_after(count) if count else 0.0) * left.borne()
        np.testing.assert_allclose(borne[count], largest, atol=1e-3 * most)
    used = columns["value used"].reshape(frames, -1)
    np.testing.assert_allclose(used[range(1, frames), result.broken], 100.0, atol=0.5)
    assert used.max() <= 100.5
    page = shown(result)
    far = {}
    for g in (0, 3, frames - 1):
        there = np.array(page.js(f"(page.goTo({g}), {THERE})"))
        assert np.flatnonzero(~there).tolist() == sorted(result.broken[: max(g - 1, 0)].tolist())
        far[g] = page.js("page.magnification()")
    assert far[frames - 1] == far[0]  # one magnification through the film, and a round one
    assert f"{far[0]:.15g}".strip("0") in "125"
    curve = {curve["title"]: curve for curve in header["curves"]}["Load over displacement"]
    assert curve["course"]
    assert curve["at"][1:] == result.displacement[: len(curve["at"]) - 1].tolist()
