"""What the pictures show, told by the artists in them."""

import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from artists import axes_of, drawn, notes, part
from plates import plate as plate_of

from kaju import LoadModel, plot
from kaju.errors import ParameterError
from kaju.view import PICTURES
from kaju.view.plots import plot_all

CUBE = plate_of([10] * 3, [5, 5, 9], [0.0, 0.0, -2.0], size=[1.0] * 3)


def plate_scene(threshold=0.01, steps=1, force=(0.0, -2.0), **rule):
    own = {"rule": {"threshold": threshold, **rule}, "thickness": 0.002}
    return plate_of([20, 20], [10, 19], force, steps=steps, size=[0.2, 0.2], **own)


@cache
def plate(*args):
    return LoadModel(plate_scene(*args)).run()


@pytest.fixture(scope="module")
def cube():
    return LoadModel(CUBE).run()


def test_every_agent_is_one_tile_where_its_cell_is_in_the_colour_of_its_spawn_step():
    ax = axes_of(plate(), "agents")
    names = ("material agents", "free boundary agents", "material steel")
    assert [len(drawn(ax, name)) for name in names] == [34, 4, 400]
    assert sorted(part(ax, "material agents").get_array()) == sorted(plate().last.spawn_step)
    assert "34 material agents, 4 boundary agents after 8 generations" in notes(ax)
    entries = [text.get_text() for text in ax.get_legend().get_texts()]
    assert entries == ["steel", "rigid", "free boundary agent: air, gives loads back"]
    assert (ax.get_xlabel(), ax.xaxis.get_major_formatter()(0.05, 0)) == ("x (mm)", "50")
    centres = np.array([tile[:4].mean(axis=0) for tile in drawn(ax, "material agents")])
    expected = plate().scene.lattice.centres(plate().last.cells)
    order = [np.lexsort(points.round(9).T) for points in (centres, expected)]
    np.testing.assert_allclose(centres[order[0]], expected[order[1]], atol=1e-12)
    (arrow,) = drawn(ax, "forces")  # it ends on the face it presses
    np.testing.assert_allclose(arrow[0], [0.105, 0.2])
    assert (arrow[:, 1] >= 0.2).all()


def test_ground_is_hatched_and_kinds_of_boundary_differ_in_form():
    tall = plate(1e-7)
    ax = axes_of(tall, "agents")
    ax.figure.draw_without_rendering()
    assert ax.get_legend().get_window_extent().x1 < ax.figure.bbox.x1
    assert part(ax, "support rigid").get_hatch() == "////"
    rigid = drawn(ax, "rigid boundary agents")
    assert len(rigid) == (tall.last.boundary_kind == -2).sum() > 0
    assert len(rigid[0]) == 4  # a closed triangle
    assert len(drawn(ax, "free boundary agents")[0]) == 21


def test_the_deformed_grid_sinks_by_magnification_times_displacement():
    """The magnification is round, and stated."""
    result = plate()
    assert "×1\u202f234;" in notes(axes_of(result, "deformed", magnification=1234.0))
    ax = axes_of(result, "deformed")
    assert "deformation shown ×1\u202f000\u202f000;" in notes(ax)
    assert len(drawn(ax, "moved")) == 400
    lowest = min(tile[:, 1].min() for tile in drawn(ax, "moved"))
    assert lowest == 0.0
    top = max(drawn(ax, "moved"), key=lambda tile: tile[:4].mean(axis=0) @ [0.0, 1.0])
    assert top[:, 1].max() == pytest.approx(0.2, abs=1e-4)
    middles = np.linalg.norm(result.displacement, axis=1)
    assert part(ax, "moved").get_array().max() == pytest.approx(middles.max())
    assert f"largest displacement {1e9 * result.max_displacement:.4g} nm" in notes(ax)


def test_there_is_one_arrow_for_each_agent_and_direction_that_took_a_load():
    result = plate()
    arrows = drawn(axes_of(result, "loads"), "loads taken")
    assert len(arrows) == np.count_nonzero(result.last.taken)
    middles = np.array([arrow.min(axis=0) + arrow.max(axis=0) for arrow in arrows]) / 0.02
    assert np.isclose(middles % 1.0, 0.5).any(axis=1).all()  # in the middle of their cells


def test_maps_have_units_and_signed_ones_are_centred():
    figure = plot(plate(), "stress")
    field = part(figure.axes[0], "map")
    assert field.norm.vmin == -field.norm.vmax
    assert figure.axes[1].get_ylabel() == "stress σyy (kPa)"
    assert plot(plate(), "displacement").axes[1].get_ylabel() == "displacement (nm)"
    with pytest.raises(ParameterError, match=r"there is no 'yx'.*there is xx, xy, yy"):
        plot(plate(), "stress", component="yx")


def test_cubes_show_only_faces_that_nothing_hides(cube):
    ax, bar = plot(cube).axes
    agents = part(ax, "material agents")
    assert bar.get_ylabel() == "generation in which the cell woke"
    cells = {tuple(cell) for cell in cube.last.cells.tolist()}
    steps = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    bare = sum(tuple(np.add(cell, step)) not in cells for cell in cells for step in steps)
    assert len(agents.get_facecolor()) == bare


def test_a_cut_shows_one_layer_and_says_which(cube):
    ax = axes_of(cube, "agents", cut={"y": 0.55})
    assert len(drawn(ax, "material agents")) == (cube.last.cells[:, 1] == 5).sum()
    assert "cut at y = 550 mm" in notes(ax)
    assert ax.get_ylabel() == "z (m)"


@pytest.mark.parametrize("cut", [{"y": 1.01}, {"y": -0.1}, {"w": 1}, {"y": "a"}, {"x": 1, "y": 1}])
def test_a_cut_must_lie_in_a_body_of_cubes(cube, cut):
    with pytest.raises(ParameterError, match="cut"):
        plot(cube, "agents", cut=cut)
    with pytest.raises(ParameterError, match="only bodies of cubes"):
        plot(plate(), "agents", cut={"y": 1})


def test_a_giant_body_is_cropped_to_its_agents_and_says_so():
    fine = {"thickness": 0.002, "rule": {"threshold": 1e-3}}
    giant = LoadModel(plate_of([1_000_000] * 2, [500_000, 999_999], **fine)).run()
    ax = axes_of(giant, "agents")
    assert len(drawn(ax, "material agents")) == len(giant.last.cells)
    assert "of 1\u202f000\u202f000 × 1\u202f000\u202f000 cells" in notes(ax)
    assert ax.get_xlabel() == "x − 5 km (mm)"
    assert ax.xaxis.get_major_formatter()(5000.012, 0) == "12"
    assert len(drawn(axes_of(giant, "scene"), "material steel")) < 100_000


def test_an_unknown_picture_is_refused_with_a_suggestion():
    with pytest.raises(ParameterError, match=r"'agent' of TransferResult .did you mean 'agents'"):
        plot(plate(), "agent")
    with pytest.raises(ParameterError, match="there is scene"):
        plot(plate().scene, "agents")


@pytest.mark.parametrize(
    "scene", [plate_scene(steps=3), pytest.param(CUBE, marks=pytest.mark.slow)]
)
def test_plot_all_writes_well_named_pictures(tmp_path, monkeypatch, scene):
    monkeypatch.setattr("kaju.view.style.RESOLUTION", 40)
    result = LoadModel(scene).run()
    paths = plot_all(result, tmp_path)
    assert {p.name for p in paths} == {p.name for p in tmp_path.iterdir()} <= set(PICTURES)
    assert all(plot(result, name) for name in result.pictures)
    assert paths[0].name == "agents.png"
    assert all(path.read_bytes()[:4] == b"\x89PNG" for path in paths)
    assert ((tmp_path / "stages.png") in paths) == (len(result.stages) > 1)


def test_views_load_no_drawing_library_and_never_pyplot(tmp_path):
    code = (
        "import sys, kaju.view\n"
        "assert 'matplotlib' not in sys.modules\n"
        "import kaju.view.style; kaju.view.style.RESOLUTION = 40\n"
        "from kaju.view.plots import plot_all\n"
        "from kaju import LoadModel, Scene\n"
        f"scene = Scene.from_toml({plate_scene(0.1, 2).to_toml()!r})\n"
        f"plot_all(LoadModel(scene).run(), {str(tmp_path)!r})\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True)
