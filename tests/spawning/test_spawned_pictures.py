"""Pictures of agents of many sizes."""

import numpy as np
import pytest
from PIL import Image
from spawning_bodies import under_a_patch

from kaju import Scene, animate, plot, solve
from kaju.errors import ParameterError
from kaju.model.results.result import Tiles
from kaju.view.layers import layer_of, merge_small, squares_of
from kaju.view.plots import plot_all, plot_scene
from kaju.view.quadtree import seen_faces, view_of

pytestmark = pytest.mark.usefixtures("coarse")


@pytest.fixture(scope="module")
def flat():
    return solve(under_a_patch(2), tolerance=0.01)


@pytest.fixture(scope="module")
def solid():
    return solve(under_a_patch(3), tolerance=0.25)


def drawn(figure, name):
    return next(c for c in figure.axes[0].collections if c.get_gid() == name)


def words(figure):
    notes = next(t for t in figure.axes[0].texts if t.get_gid() == "notes")
    return notes.get_text()


COLOURS = ["level", "spawn_step", "gap", "von_mises"]


@pytest.mark.parametrize("colour", COLOURS)
def test_every_agent_is_drawn_in_its_colour(flat, colour):
    figure = plot(flat, "agents", colour=colour, step=1)
    agents, born = drawn(figure, "agents"), drawn(figure, "spawned")
    np.testing.assert_array_equal(agents.get_array(), getattr(flat, colour))
    assert len(born.get_paths()) == np.count_nonzero(flat.spawn_step == 1)
    edges = [np.ptp(path.vertices[:, 0]) for path in agents.get_paths()]
    np.testing.assert_allclose(edges, flat.size)
    assert f"{flat.agents} agents" in words(figure)


def test_earlier_generations_can_be_drawn(flat):
    for step, generation in enumerate(flat.generations):
        for colour in ("gap", "fitted", "balanced"):
            figure = plot(flat, "agents", colour=colour, generation=step)
            values = getattr(generation, colour)
            np.testing.assert_array_equal(drawn(figure, "agents").get_array(), values)
        assert f"step {step} of spawning: {generation.agents} agents" in words(figure)


def test_plane_shows_the_agents_that_it_meets(solid):
    figure = plot(solid, "agents", cut={"z": 0.99})
    top = np.count_nonzero(solid.lower[:, 2] + solid.size > 0.99)
    assert len(drawn(figure, "agents").get_paths()) == top
    assert "cut at z = 990 mm" in words(figure)


def test_octree_is_cut_open_where_agents_are_small(solid):
    """What can be seen has the area of the block's three near sides, less the hole on top."""
    view = view_of(solid)
    assert all(0.25 <= place <= 0.5 for place in view.planes)
    x, y = 0.37, 0.41  # through the middle of agents
    view = view._replace(planes=(x, y))
    found = seen_faces(solid.grid, view, solid.lower, solid.lower + solid.size[:, None])
    faces, owner, light = found
    edges = np.linalg.norm(np.diff(faces, axis=1), axis=2)
    area, flat = edges[:, 0] * edges[:, 1], np.ptp(faces, axis=1) == 0.0
    np.testing.assert_allclose(
        [area[flat[:, a]].sum() for a in range(3)], [1.0, 1.0, 1.0 - (1.0 - x) * y]
    )
    assert area[light == 1.0].sum() == pytest.approx(y + (1.0 - x))
    inside = faces.mean(axis=1) - solid.lower[owner]
    assert np.all((inside > -1e-9) & (inside < solid.size[owner, None] + 1e-9))
    figure = plot(solid, "agents", colour="gap")
    assert len(drawn(figure, "agents").get_facecolor()) > 0
    assert "cut away" in words(figure)


def test_fields_are_drawn_on_the_agents(flat):
    size = np.linalg.norm(flat.displacement, axis=1)
    found = drawn(plot(flat, "displacement"), "map").get_array()
    np.testing.assert_array_equal(found, size)
    for what, a, b in (("stress", 0, 1), ("strain", 1, 1)):
        found = drawn(plot(flat, what, component="xy"[a] + "xy"[b]), "map").get_array()
        np.testing.assert_array_equal(found, getattr(flat, what)[:, a, b])
    found = drawn(plot(flat, "von_mises"), "map").get_array()
    np.testing.assert_array_equal(found, flat.von_mises)


@pytest.mark.parametrize("name", ["flat", "solid"])
def test_corners_of_the_deformed_agents_have_moved_as_the_body_there(name, request):
    result = request.getfixturevalue(name)
    figure = plot(result, "deformed", magnification=1e6)
    layer = layer_of(result)
    rows = layer.meets(result.lower, result.size)
    corner = [path.vertices[:4] for path in drawn(figure, "moved").get_paths()]
    rest = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * result.size[rows, None, None]
    rest = rest + result.lower[rows][:, None, layer.axes]
    moved = result.displacement_at(layer.in_body(rest.reshape(-1, 2)))
    np.testing.assert_allclose(
        np.array(corner), rest + 1e6 * layer.in_plane(moved).reshape(rest.shape), atol=1e-12
    )
    assert "×1\u202f000\u202f000" in words(figure)


def test_body_at_rest_is_drawn_at_rest():
    still = under_a_patch(2).replace(loads=[])
    figure = plot(solve(still, tolerance=0.1), "deformed")
    assert "largest displacement 0 m" in words(figure)


def test_agents_too_small_to_be_seen_are_drawn_together():
    lower = np.array([[0.0, 0.0], [1.0, 0.0], [1.5, 0.0], [1.0, 0.5], [1.5, 0.5]])
    size = np.array([1.0, 0.5, 0.5, 0.5, 0.5])
    value = np.array([1.0, 2.0, -7.0, 3.0, 4.0])
    for finest in (0.1, 0.5):
        assert len(merge_small(Tiles(lower, size, value), finest)[1]) == 5
    (place, edge, seen), row = merge_small(Tiles(lower, size, value), 0.6)
    np.testing.assert_array_equal(place, [[0.0, 0.0], [1.0, 0.0]])
    assert (edge.tolist(), seen.tolist(), row.tolist()) == ([1.0, 1.0], [1.0, -7.0], [0, 2])


def test_picture_of_a_large_body_has_few_squares():
    load = {"region": {"box": [[50.0, 100.0], [50.1, 100.0]]}, "force": [0.0, -1.0]}
    body = {"size": [100.0, 100.0], "cells": [4000, 4000], "material": "steel"}
    sides = {"bottom": "roller", "left": "roller"}  # whose ends need no small agents
    result = solve(Scene(body=body, sides=sides, loads=[load]), tolerance=0.01)
    whole = squares_of(layer_of(result, crop=False), result.tiles(result.von_mises))
    assert len(whole.size) < result.agents
    assert (whole.size**2).sum() == pytest.approx(1e4)
    assert whole.value.max() == result.von_mises.max()


def test_usual_pictures_are_written(solid, tmp_path):
    names = [path.stem for path in plot_all(solid, tmp_path)]
    assert names[0] == "deformed"
    fields = {"displacement", "strain", "stress", "von_mises", "cuts"}
    assert set(names[1:]) == {"agents", "agents_section", *fields}
    assert plot_scene(solid.scene) is not None


def durations(path):
    with Image.open(path) as film:
        return film.n_frames


@pytest.mark.parametrize("name", ["flat", "solid"])
def test_films_have_a_frame_for_each_generation(name, request, tmp_path):
    result = request.getfixturevalue(name)
    count = len(result.generations)
    for what, options in (("generations", {"colour": "spawn_step"}), ("gaps", {"crop": True})):
        assert durations(animate(result, tmp_path / "film.gif", what, **options)) == count
    if name == "solid":
        path = animate(result, tmp_path / "film.gif", "generations", cut={"y": 0.4})
        assert durations(path) == count


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"colour": "levle"}, "did you mean 'level'"),
        ({"colour": "von_mises", "generation": 0}, "last generation only"),
        ({"generation": 99}, "generation: must lie between 0"),
        ({"cut": {"y": 0.1}}, "only bodies of cubes"),
    ],
)
def test_what_cannot_be_drawn_is_named(flat, options, match):
    with pytest.raises(ParameterError, match=match):
        plot(flat, "agents", **options)


def test_agents_of_one_opinion_say_so(solid):
    with pytest.raises(ParameterError, match="one opinion"):
        plot(solid, "agents", colour="balanced")
    with pytest.raises(ParameterError, match="one opinion"):
        plot(solve(under_a_patch(2)), "agents", colour="gap")


def test_cuts_and_films_that_cannot_be_are_named(flat, solid, tmp_path):
    with pytest.raises(ParameterError, match="x runs from 0 to"):
        plot(solid, "agents", cut={"x": 3.0})
    with pytest.raises(ParameterError, match="one of the axes"):
        plot(solid, "von_mises", cut={"w": 3.0})
    with pytest.raises(ParameterError, match="component"):
        plot(flat, "stress", component="xz")
    with pytest.raises(ParameterError, match="magnification"):
        plot(flat, "deformed", magnification=0.0)
    with pytest.raises(ParameterError, match="last generation only"):
        animate(flat, tmp_path / "film.gif", "generations", colour="von_mises")
    with pytest.raises(ParameterError, match="did you mean 'generations'"):
        animate(flat, tmp_path / "film.gif", "generation")
