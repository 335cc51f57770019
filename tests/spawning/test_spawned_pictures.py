"""Pictures of agents of many sizes."""

import numpy as np
import pytest
from PIL import Image
from spawning_bodies import under_a_patch

from kaju import animate, plot, solve
from kaju.errors import ParameterError

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
    figure = plot(flat, "agents", colour=colour)
    agents = drawn(figure, "agents")
    told = getattr(flat, "largest_" * (colour == "von_mises") + colour)
    np.testing.assert_array_equal(agents.get_array(), told)
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


def test_agents_too_small_to_be_seen_are_drawn_together(flat, monkeypatch):
    monkeypatch.setattr("kaju.view.layers.FINEST", 2.0)
    squares = drawn(plot(flat, "agents"), "agents").get_paths()
    edges = [np.ptp(path.vertices[:, 0]) for path in squares]
    assert flat.size.min() < 0.5 * np.ptp(flat.lower[:, 0]) < min(edges)


def test_plane_shows_the_agents_that_it_meets(solid):
    figure = plot(solid, "agents", cut={"z": 0.99})
    top = np.count_nonzero(solid.lower[:, 2] + solid.size > 0.99)
    assert len(drawn(figure, "agents").get_paths()) == top
    assert "cut at z = 990 mm" in words(figure)


@pytest.mark.parametrize(
    ("crop", "low", "seen"), [(False, 0.0, [2, 2, 1.5]), (True, 0.25, [1.5] * 3)]
)
def test_in_space_the_quarter_before_two_planes_is_cut_away(solid, crop, low, seen):
    """All faces that are left: their areas across each axis, and where they are."""
    figure = plot(solid, "agents", crop=crop)
    assert "cut away: x above 500 mm, y below 500 mm" in words(figure)
    assert figure.axes[0].get_zlim() == (low, 1.0)
    cubes = drawn(figure, "agents")  # Matplotlib 3.10.0 has corners alone
    faces = getattr(cubes, "_faces", None)
    faces = cubes._vec[:3].T.reshape(-1, 4, 3) if faces is None else np.array(faces)
    a, b, _, d = np.moveaxis(faces, 1, 0)
    np.testing.assert_allclose(np.abs(np.cross(b - a, d - a)).sum(axis=0), seen)
    edges = np.unique(np.ptp(faces, axis=1).max(axis=1).round(9))
    np.testing.assert_allclose(edges, np.unique(solid.size))
    x, y, _ = faces.mean(axis=1).T
    assert ((x <= 0.5) | (y >= 0.5)).all()


def test_fields_are_drawn_on_the_agents(flat):
    size = np.linalg.norm(flat.displacement, axis=1)
    found = drawn(plot(flat, "displacement"), "map").get_array()
    np.testing.assert_array_equal(found, size)
    for what, a, b in (("stress", 0, 1), ("strain", 1, 1)):
        found = drawn(plot(flat, what, component="xy"[a] + "xy"[b]), "map").get_array()
        np.testing.assert_array_equal(found, getattr(flat, what)[:, a, b])
    found = drawn(plot(flat, "von_mises"), "map").get_array()
    np.testing.assert_array_equal(found, flat.largest_von_mises)


def test_corners_of_the_deformed_agents_have_moved_as_the_body_there(flat):
    figure = plot(flat, "deformed", magnification=1e6)
    corner = [path.vertices[:4] for path in drawn(figure, "moved").get_paths()]
    rest = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * flat.size[:, None, None]
    rest = rest + flat.lower[:, None]
    moved = flat.displacement_at(rest.reshape(-1, 2)).reshape(rest.shape)
    np.testing.assert_allclose(np.array(corner), rest + 1e6 * moved, atol=1e-12)
    assert "×1\u202f000\u202f000" in words(figure)


def durations(path):
    with Image.open(path) as film:
        return film.n_frames


@pytest.mark.parametrize("name", [pytest.param("flat", marks=pytest.mark.slow), "solid"])
def test_films_have_a_frame_for_each_generation(name, request, tmp_path):
    result = request.getfixturevalue(name)
    count = len(result.generations)
    for what, options in (("generations", {"colour": "spawn_step"}), ("gaps", {"crop": True})):
        assert durations(animate(result, tmp_path / "film.gif", what, **options)) == count
    if name == "solid":
        path = animate(result, tmp_path / "film.gif", "generations", cut={"y": 0.4})
        assert durations(path) == count


@pytest.mark.parametrize(("options", "match"), [
    ({"colour": "levle"}, "did you mean 'level'"),
    ({"colour": "von_mises", "generation": 0}, "last generation only"),
    ({"generation": 99}, "generation: must lie between 0"),
    ({"cut": {"y": 0.1}}, "only bodies of cubes"),
])  # fmt: skip
def test_what_cannot_be_drawn_is_named(flat, options, match):
    with pytest.raises(ParameterError, match=match):
        plot(flat, "agents", **options)
