"""Pictures that say what is there: weights in the body, hatching beside it, units, the ground."""

from pathlib import Path

import numpy as np
import pytest
from artists import axes_of, drawn
from PIL import Image

from kaju import LoadModel, Scene, load_scene, plot
from kaju.errors import SceneError

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


def test_ground_is_hatched_only_where_the_body_stands():
    reached = np.concatenate(drawn(axes_of(frame()), "support rigid"))[:, 0]
    assert not np.any((reached > 0.0151) & (reached < 0.0549))
    assert reached.min() < 0.001
    assert reached.max() > 0.069


def test_strain_has_a_unit():
    run = LoadModel(load_scene(EXAMPLES / "plate.toml")).run()
    assert "(10⁻" in plot(run, "strain").axes[1].get_ylabel()


@pytest.fixture
def smoothed(tmp_path):
    """A drawing of a step, blurred, and as a JPEG."""
    true = np.full((12, 16, 3), 255, dtype=np.uint8)
    true[4:, 4:12] = (140, 123, 107)
    true[10:] = 0
    image = Image.fromarray(true)
    big = image.resize((160, 120)).resize((16, 12), Image.Resampling.BICUBIC)
    big.save(tmp_path / "step.jpg", quality=60)
    return tmp_path / "step.jpg", true


LEGEND = {"white": "air", "#8c7b6b": "granite", "black": "rigid"}


def test_smoothed_images_take_the_nearest_colour(smoothed):
    path, true = smoothed
    with pytest.raises(SceneError, match="nearest_colour = true"):
        Scene.from_image(path, legend=LEGEND, cell_size=0.01)
    scene = Scene.from_image(path, legend=LEGEND, cell_size=0.01, nearest_colour=True)
    colours = np.array([[255, 255, 255], [140, 123, 107], [0, 0, 0]], dtype=float)
    pixels = np.asarray(Image.open(path).convert("RGB"), dtype=float)[::-1].transpose(1, 0, 2)
    nearest = np.linalg.norm(pixels[:, :, None] - colours, axis=3).argmin(axis=2)
    solid = scene.rasterise() >= 0
    np.testing.assert_array_equal(solid, nearest == 1)
    assert (solid == (true[::-1].transpose(1, 0, 2)[:, :, 0] == 140)).mean() > 0.9
    assert Scene.from_toml(scene.to_toml()) == scene
    assert (scene.refine(2).rasterise() >= 0).sum() == 4 * solid.sum()
