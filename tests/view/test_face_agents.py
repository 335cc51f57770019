"""The elastic rule's agents, watched: moments on the way, pictures, films, and stored runs."""

import numpy as np
import pytest
from artists import axes_of, drawn, part
from PIL import Image
from plates import plate as pressed

from kaju import ElasticModel, ElasticRule, animate, load_result, plot


def plate(order, cells=(8, 8), **rule):
    return pressed(list(cells), [4, 7], thickness=0.002, rule=ElasticRule(order=order, **rule))


@pytest.fixture(scope="module", params=["wave", "largest first", "multilevel"])
def run(request):
    return ElasticModel(plate(request.param, threshold=0.02)).run()


def test_moments_lead_from_the_applied_load_to_what_is_left(run):
    moments, agents = run.moments, run.agents
    assert moments.step[0] == 0
    assert moments.step[-1] == len(run.history)
    assert np.abs(moments.left[0, agents.level == 0]).sum() == pytest.approx(2.0)
    finest = agents.level == 0
    np.testing.assert_allclose(moments.left[-1, finest], agents.left[finest], rtol=1e-6)
    np.testing.assert_allclose(moments.taken[-1], agents.taken, rtol=1e-6)
    assert np.all(np.diff(moments.taken, axis=0) >= 0.0)
    assert run.summary()["potential_energy"] == run.history[-1].energy < 0.0


def test_a_stored_run_is_the_same(run, tmp_path):
    stored = load_result(run.save(tmp_path / "run"))
    assert type(stored) is type(run)
    assert stored.summary() == run.summary()
    assert stored.history == run.history
    assert stored.ledger.imbalance == run.ledger.imbalance
    assert stored.certificate == run.certificate
    for name in ("level", "position", "left", "taken"):
        np.testing.assert_array_equal(getattr(stored.agents, name), getattr(run.agents, name))
    for name in ("left", "displacement"):
        np.testing.assert_array_equal(getattr(stored.moments, name), getattr(run.moments, name))
    points = np.array([[0.045, 0.075], [0.01, 0.02]])
    np.testing.assert_array_equal(stored.displacement_at(points), run.displacement_at(points))
    assert stored.to_dataframe().equals(run.to_dataframe())


def test_a_picture_shows_every_agent_of_a_level_as_a_diamond(run):
    agents = part(axes_of(run, "agents"), "face agents")
    finest = run.agents.level == 0
    assert len(agents.get_paths()) == finest.sum()
    middles = [path.vertices[:4].mean(axis=0) for path in agents.get_paths()]
    np.testing.assert_allclose(middles, run.agents.position[finest], atol=1e-12)
    np.testing.assert_array_equal(agents.get_array(), run.agents.spawn_step[finest])
    woken = finest & (run.agents.spawn_step <= run.moments.step[1])
    assert len(drawn(axes_of(run, "left", moment=1), "left")) == woken.sum()


def test_every_picture_and_the_film_can_be_drawn(run, tmp_path, monkeypatch):
    monkeypatch.setattr("kaju.view.animation.MOST_FRAMES", 3)
    monkeypatch.setattr("kaju.view.films.RESOLUTION", 30)
    for what in ("left", "curves", "deformed", "displacement", "stress", "scene"):
        assert plot(run, what).axes
    with Image.open(animate(run, tmp_path / "waves.gif", fps=20.0)) as film:
        assert film.n_frames == min(len(run.moments.step), 3)


def test_agents_in_space_are_shown_in_a_layer():
    body = {"cell_size": 0.1, "material": "rubber", "loads": [{"side": "top", "pressure": 100.0}]}
    rule = ElasticRule(order="multilevel", tolerance=1e-2)
    run = ElasticModel(pressed([4] * 3, None, rule=rule, **body)).run()
    agents = drawn(axes_of(run, "agents", cut={"y": 0.15}), "face agents")
    layer = np.isclose(run.agents.position[:, 1], 0.15) & (run.agents.axis != 1)
    assert len(agents) == np.sum(layer & (run.agents.level == 0)) > 0
