"""Pictures that say what is there: weights, hatching, cuts, networks, elastic answers."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from artists import axes_of, drawn, notes, part
from PIL import Image
from plates import plate

from kaju import LoadModel, Scene, load_scene, plot, solve
from kaju.errors import ParameterError, SceneError
from kaju.model.network import solve as solve_network
from kaju.model.network import triangular

EXAMPLES = Path(__file__).parents[2] / "examples"
FRAME = "#######\n" + 5 * "#.....#\n"


def frame(**others):
    legend, ground = {"#": "steel", ".": "air"}, {"bottom": "rigid"}
    scene = Scene.from_drawing(FRAME, legend=legend, cell_size=0.01, sides=ground, **others)
    return scene.refine(4)


def test_a_weight_is_shown_inside_the_body():
    scene = frame(gravity=[0.0, -9.81])
    arrows = drawn(axes_of(scene), "forces")
    tails = np.array([arrow[:, 1].max() for arrow in arrows])
    middles = np.array([arrow[:, 0].mean() for arrow in arrows])
    points = np.stack([middles, tails - 1e-4], axis=1)
    assert len(points) > 3
    assert np.all(scene.kinds(scene.lattice.locate(points)) >= 0)
    sideways = np.sort(middles)
    np.testing.assert_allclose(sideways + sideways[::-1], 0.07, atol=0.003)


def test_loads_that_oppose_are_added_by_amount():
    pulls = {"left": -6.0, "right": 6.0}
    pulled = frame(loads=[{"side": side, "force": [f, 0.0]} for side, f in pulls.items()])
    assert "applied: 12 N on 48 faces, added by amount" in notes(axes_of(pulled))


def test_ground_is_hatched_only_where_the_body_stands():
    reached = np.concatenate(drawn(axes_of(frame()), "support rigid"))[:, 0]
    assert not np.any((reached > 0.0151) & (reached < 0.0549))
    assert reached.min() < 0.001
    assert reached.max() > 0.069


def test_strain_has_a_unit():
    run = LoadModel(load_scene(EXAMPLES / "plate.toml")).run()
    assert "(10⁻" in plot(run, "strain").axes[1].get_ylabel()


def test_smoothed_images_take_the_nearest_colour(tmp_path):
    """A drawing of a step, blurred, and as a JPEG."""
    path, true = tmp_path / "step.jpg", np.full((12, 16, 3), 255, dtype=np.uint8)
    true[4:, 4:12] = (140, 123, 107)
    true[10:] = 0
    big = Image.fromarray(true).resize((160, 120))
    big.resize((16, 12), Image.Resampling.BICUBIC).save(path, quality=60)
    asked = {"legend": {"white": "air", "#8c7b6b": "granite", "black": "rigid"}, "cell_size": 0.01}
    with pytest.raises(SceneError, match="nearest_colour = true"):
        Scene.from_image(path, **asked)
    scene = Scene.from_image(path, **asked, nearest_colour=True)
    colours = np.array([[255, 255, 255], [140, 123, 107], [0, 0, 0]], dtype=float)
    pixels = np.asarray(Image.open(path).convert("RGB"), dtype=float)[::-1].transpose(1, 0, 2)
    nearest = np.linalg.norm(pixels[:, :, None] - colours, axis=3).argmin(axis=2)
    solid = scene.rasterise() >= 0
    np.testing.assert_array_equal(solid, nearest == 1)
    assert (solid == (true[::-1].transpose(1, 0, 2)[:, :, 0] == 140)).mean() > 0.9
    assert Scene.from_toml(scene.to_toml()) == scene
    assert (scene.refine(2).rasterise() >= 0).sum() == 4 * solid.sum()


def test_an_elastic_result_is_drawn_on_the_cells_that_were_solved() -> None:
    """And as agents of one size."""
    result = solve(plate([8, 6], None, material="oak", loads=[{"side": "top", "pressure": 1e5}]))
    cells = np.count_nonzero(result.cells().body)
    assert len(drawn(axes_of(result, "deformed"), "moved")) == cells
    field = part(axes_of(result, "von_mises"), "map")
    assert field.get_array().max() == pytest.approx(result.largest_von_mises.max())
    agents = part(axes_of(result, "agents"), "agents")
    assert len(agents.get_paths()) == result.agents
    assert np.all(agents.get_array() == 0)
    with pytest.raises(ParameterError, match="there is deformed, displacement"):
        plot(result, "loads")


def test_the_springs_of_a_network_are_coloured_by_tension() -> None:
    result = solve_network(triangular(5), 4)
    springs = part(axes_of(result), "springs")
    assert len(springs.get_segments()) == len(result.network.springs)
    assert springs.get_array().tolist() == result.tension[-1].tolist()
    assert result.summary()["largest_compression_N"] == -springs.get_array().min() > 0.0
    assert springs.norm.vmin == -springs.norm.vmax
    assert "increment 4 of 4; largest force" in notes(axes_of(result))
    long = solve_network(triangular(12, 2), 1)  # it moves by 0.15 m, which 11 m hide
    assert "deformation shown ×5" in notes(axes_of(long))


@pytest.mark.parametrize("options", [{"record": 9}, {"record": -9}, {"magnification": 0.0}])
def test_what_a_network_does_not_know_is_refused(options) -> None:
    with pytest.raises(ParameterError, match=next(iter(options))):
        plot(solve_network(triangular(3), 2), **options)


PLATE = plate([20, 20], [10, 19], size=[0.2, 0.2], thickness=0.002)


@cache
def rule():
    return LoadModel(PLATE).run()


@cache
def elasticity():
    return solve(PLATE)


@pytest.mark.parametrize(
    ("answer", "said"), [(rule, "keeps no equilibrium"), (elasticity, "every cut carries")]
)
def test_bars_are_what_cuts_carry_and_stand_where_they_lie(answer, said):
    """And it says who keeps equilibrium."""
    result = answer()
    (ax,), cuts = plot(result, "cuts").axes, result.cuts()
    np.testing.assert_array_equal([bar.get_width() for bar in ax.patches], cuts.carried)
    middles = [bar.get_y() + 0.5 * bar.get_height() for bar in ax.patches]
    np.testing.assert_allclose(middles, cuts.at)
    (line,) = ax.lines
    np.testing.assert_array_equal(line.get_xdata(), cuts.balance)
    assert said in notes(ax)
    (ax,) = plot(result, "cuts", axis="x").axes  # upright
    assert ax.get_xlabel().startswith("x")
    assert ax.get_ylabel().startswith("force")
