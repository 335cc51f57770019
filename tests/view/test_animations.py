"""Animations of stored runs."""

from __future__ import annotations

import sys

import pytest
from PIL import Image, ImageSequence
from plates import plate

from kaju import History, PrescribedRule, ThreeElement, creep
from kaju.errors import MissingExtraError, ParameterError, ResultFileError
from kaju.model.network.spring_lattices import triangular
from kaju.model.scene import Scene
from kaju.model.study.solving import solve
from kaju.model.transfer.load_model import LoadModel
from kaju.model.transfer.transfer_result import TransferResult
from kaju.view import animate
from kaju.view.deformed import loading

BLOCK = plate(
    [6, 5], [3, 4], [0.0, -1.0], steps=3, material="oak", rule=PrescribedRule(threshold=0.1)
)

CUBE = plate(
    [4, 4, 4], [2, 2, 3], [0.0, 0.0, -1.0], material="oak", rule=PrescribedRule(threshold=0.1)
)


pytestmark = pytest.mark.usefixtures("coarse")


@pytest.fixture(scope="module")
def result() -> TransferResult:
    return LoadModel(BLOCK).run()


def durations(path) -> list[int]:
    with Image.open(path) as gif:
        return [frame.info["duration"] for frame in ImageSequence.Iterator(gif)]


def test_there_is_a_frame_before_and_one_for_each_generation(result, tmp_path) -> None:
    path = animate(result, tmp_path / "spawning.gif", fps=4.0, hold=2.0)
    shown = durations(path)
    assert len(shown) == result.last.generations + 1
    assert shown[:-1] == [250] * (len(shown) - 1)
    assert shown[-1] == 2250


def test_stages_have_a_frame_each(result, tmp_path) -> None:
    assert len(durations(animate(result, tmp_path / "stages.gif", "stages"))) == 4


def test_cubes_are_animated_in_space_and_in_sections(tmp_path) -> None:
    cube = LoadModel(CUBE).run()
    frames = cube.last.generations + 1
    assert len(durations(animate(cube, tmp_path / "space.gif"))) == frames
    assert len(durations(animate(cube, tmp_path / "cut.gif", cut={"x": 0.025}))) == frames


def test_networks_have_a_frame_for_each_increment(tmp_path) -> None:
    loaded = triangular(3).solve(5)
    assert len(durations(animate(loaded, tmp_path / "network.gif"))) == 6


def test_a_run_in_which_nothing_happens_is_one_frame(tmp_path) -> None:
    quiet = LoadModel(BLOCK.replace(rule=PrescribedRule(threshold=3.0))).run()
    assert len(durations(animate(quiet, tmp_path / "quiet.gif", hold=0.0))) == 1


def test_an_mp4_needs_ffmpeg(result, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match="ffmpeg"):
        animate(result, tmp_path / "film.mp4")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("film.avi", {}, "ends in .gif, .webp, .mp4, .glb, .pvd"),
        ("film.gif", {"fps": 0.0}, "fps"),
        ("film.gif", {"fps": float("nan")}, "fps"),
        ("film.gif", {"hold": -1.0}, "hold"),
        ("film.gif", {"what": "generation"}, "did you mean 'generations'"),
    ],
)
def test_what_cannot_be_is_refused(result, tmp_path, name, options, message) -> None:
    with pytest.raises(ParameterError, match=message):
        animate(result, tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


def test_a_missing_folder_is_told(result, tmp_path) -> None:
    with pytest.raises(ResultFileError, match="cannot be written"):
        animate(result, tmp_path / "nowhere" / "film.gif")


def elastic_block() -> Scene:
    return plate([4, 4], [1, 3], [0.0, -1.0])


def test_an_elastic_body_takes_its_load_evenly(tmp_path) -> None:
    path = animate(solve(elastic_block()), tmp_path / "loading.gif", fps=10.0, hold=0.0, bare=True)
    assert durations(path) == [100] * 25


def test_what_has_no_frames_is_refused(tmp_path) -> None:
    crept = creep(ThreeElement(1.0, 1.0, 1.0), History().hold(1.0))
    with pytest.raises(ParameterError, match="no such animation 'mesh' of a CreepResult"):
        animate(crept, tmp_path / "still.glb")


def test_a_quiet_first_stage_does_not_hide_the_others(tmp_path) -> None:
    """Below γ nothing moves; the magnification is that of the stages that do."""
    quiet = BLOCK.replace(rule=PrescribedRule(threshold=0.4))
    reel = loading(LoadModel(quiet).run())
    reel.show(3)
    assert "deformation shown" in reel.notes.get_text()
    assert "shown ×1;" not in f"{reel.notes.get_text()};"
