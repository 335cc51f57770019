"""Films of stored runs: GIF, WebP, MP4, frames with alpha, GLB with morph targets, VTK series."""

import json
import sys
from pathlib import Path
from xml.etree import ElementTree

import meshlane
import numpy as np
import pytest
from PIL import Image, ImageSequence
from plates import plate

import kaju
from kaju.errors import MissingExtraError, ResultFileError
from kaju.model.network import solve as solve_network
from kaju.model.network import triangular
from kaju.view.films import frames
from kaju.view.style import caption

COMPONENT = {5121: np.uint8, 5125: np.uint32, 5126: np.float32}
WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


@pytest.fixture(scope="module")
def run() -> kaju.TransferResult:
    of = {"thickness": 0.002, "material": "oak", "rule": {"threshold": 0.1}}
    return kaju.LoadModel(plate([5, 4], [2, 3], [0.0, -3.0], steps=3, **of)).run()


@pytest.fixture(scope="module")
def cube() -> kaju.TransferResult:
    of = {"material": "oak", "rule": {"threshold": 0.05}}
    return kaju.LoadModel(plate([3] * 3, [1, 1, 2], [0.0, 0.0, -1.0], **of)).run()


def durations(path: Path) -> list[int]:
    with Image.open(path) as film:
        return [frame.info["duration"] for frame in ImageSequence.Iterator(film)]


def test_the_longest_notes_of_a_film_find_room(run) -> None:
    def draw(words: int):
        caption((figure := kaju.plot(run, "agents")).axes[0], "Agents", ["word " * words])
        return figure

    tops = [np.asarray(frame)[0] for frame in frames(draw, [1, 50, 120])]
    assert np.min(tops) == 255  # white: nothing reaches the edge


@pytest.mark.slow
def test_there_is_a_frame_before_and_one_for_each_moment(run, tmp_path, coarse) -> None:
    shown = durations(kaju.animate(run, tmp_path / "spawning.gif", fps=4.0, hold=2.0))
    assert shown == [250] * run.last.generations + [2250]
    assert len(durations(kaju.animate(run, tmp_path / "stages.gif", "stages"))) == 4
    loaded = solve_network(triangular(3), 5)
    assert len(durations(kaju.animate(loaded, tmp_path / "network.gif"))) == 6


class Glb:
    """A GLB read as strictly as its specification says."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        head = np.frombuffer(data[:20], dtype="<u4")
        assert data[:4] == b"glTF"
        assert head[1] == 2
        assert head[2] == len(data)
        assert data[16:20] == b"JSON"
        self.about = json.loads(data[20 : 20 + head[3]])
        rest = data[20 + head[3] :]
        assert rest[4:8] == b"BIN\0"
        self.binary = rest[8:]
        assert self.about["buffers"] == [{"byteLength": len(self.binary)}]
        for number in range(len(self.about["accessors"])):
            self.array(number)

    def array(self, number: int) -> np.ndarray:
        accessor = self.about["accessors"][number]
        view = self.about["bufferViews"][accessor["bufferView"]]
        kind, width = COMPONENT[accessor["componentType"]], WIDTH[accessor["type"]]
        assert view["byteOffset"] % 4 == 0
        part = self.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        found = np.frombuffer(part, dtype=kind).reshape(accessor["count"], width)
        assert np.isfinite(found).all()
        if "min" in accessor:
            assert found.min(axis=0).tolist() == accessor["min"]
            assert found.max(axis=0).tolist() == accessor["max"]
        return found

    @property
    def primitive(self) -> dict:
        return self.about["meshes"][0]["primitives"][0]

    def rest(self) -> np.ndarray:
        assert "min" in self.about["accessors"][self.primitive["attributes"]["POSITION"]]
        return self.array(self.primitive["attributes"]["POSITION"])

    def targets(self) -> list[np.ndarray]:
        return [self.array(target["POSITION"]) for target in self.primitive["targets"]]

    def corners(self) -> np.ndarray:
        index = self.array(self.primitive["indices"]).ravel()
        assert index.max() == len(self.rest()) - 1
        return index

    def keys(self) -> tuple[np.ndarray, np.ndarray]:
        sampler = self.about["animations"][0]["samplers"][0]
        times = self.array(sampler["input"]).ravel()
        return times, self.array(sampler["output"]).reshape(len(times), -1)


def test_the_last_target_is_the_magnified_displacement(run, tmp_path) -> None:
    """Of squares that are two triangles each."""
    glb = Glb(kaju.animate(run, tmp_path / "run.glb", magnification=5e4))
    assert glb.about["asset"]["extras"]["magnification"] == 5e4
    assert len(glb.rest()) == 6 * 5
    # Corners inside the body move as the mean of the cells round them; ends of lines do not.
    at = glb.rest()[:, :2].astype(np.float64)
    top = np.argmin(np.abs(at - [0.0, 0.04]).sum(axis=1))
    eps = 1e-9
    own = run.displacement_at(np.array([[eps, 0.04 - eps]]))[0]
    np.testing.assert_allclose(glb.targets()[-1][top, :2], 5e4 * own, rtol=1e-5, atol=1e-12)
    triangles = glb.rest()[glb.corners().reshape(-1, 3)][..., :2].astype(np.float64)
    a, b, c = triangles.transpose(1, 0, 2)
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    np.testing.assert_allclose(area, 0.5e-4, rtol=1e-4)
    assert len(area) == 2 * 20


def test_of_cubes_only_the_outside_is_kept(cube, tmp_path) -> None:
    glb = Glb(kaju.animate(cube, tmp_path / "cube.glb"))
    triangles = glb.rest()[glb.corners().reshape(-1, 3)].astype(np.float64)
    assert len(triangles) == 6 * 9 * 2
    assert len(glb.rest()) == 4**3 - 2**3
    a, b, c = triangles.transpose(1, 0, 2)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0  # outward faces only
    assert volume == pytest.approx(0.03**3, rel=1e-4)
    # The load comes from above, and glTF's up is y.
    least = glb.targets()[-1].min(axis=0)
    assert least[1] < 2.0 * min(least[0], least[2]) < 0.0


def test_springs_are_lines(tmp_path) -> None:
    result = solve_network(triangular(3), 4)
    glb = Glb(kaju.animate(result, tmp_path / "network.glb", magnification=1.0))
    assert glb.primitive["mode"] == 1
    assert len(glb.corners()) == 2 * len(result.network.springs)
    assert len(glb.targets()) == 4
    moved = np.pad(result.displacement[-1], [(0, 0), (0, 1)])
    np.testing.assert_allclose(glb.targets()[-1], moved, rtol=1e-6)


def test_a_series_holds_true_displacements(run, tmp_path) -> None:
    listed = kaju.animate(run, tmp_path / "a & b.pvd")
    entries = ElementTree.parse(listed).getroot().findall("./Collection/DataSet")
    times = [float(entry.attrib["timestep"]) for entry in entries]
    assert times == list(range(run.last.generations + 1))
    last = meshlane.read(tmp_path / entries[-1].attrib["file"])
    assert len(last.cells_dict["quad"]) == 20
    taken = last.cell_data["load_taken"][0]
    assert taken.sum() == pytest.approx(run.last.taken.sum(), rel=1e-12)
    first = meshlane.read(tmp_path / entries[0].attrib["file"])
    assert not first.point_data["displacement"].any()
    largest = np.abs(last.point_data["displacement"]).max()
    assert largest == pytest.approx(np.abs(run.displacement).max(), rel=0.5)


def test_a_folder_that_is_there_is_left_alone(run, tmp_path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine.txt").write_text("mine")
    for name in ("run", "run.pvd"):
        with pytest.raises(ResultFileError, match="is there already"):
            kaju.animate(run, tmp_path / name)
    assert [path.name for path in tmp_path.rglob("*")] == ["run", "mine.txt"]


def test_frames_have_no_background_and_one_size(run, tmp_path) -> None:
    folder = kaju.animate(run, tmp_path / "frames", bare=True)
    names = sorted(path.name for path in folder.iterdir())
    assert names == [f"{k:04d}.png" for k in range(run.last.generations + 1)]
    pictures = [np.asarray(Image.open(folder / name)) for name in names]
    assert {picture.shape for picture in pictures} == {pictures[0].shape}
    assert pictures[0].shape[2] == 4
    alpha = pictures[0][..., 3]
    assert alpha[0].max() == 0 or alpha[0].min() == 0
    assert (alpha[alpha.shape[0] // 2] > 240).mean() > 0.5  # the body
    # The camera stays: what no agent and no arrow has touched is the same in every frame.
    assert all(np.array_equal(picture[-8:], pictures[0][-8:]) for picture in pictures)


def test_an_mp4_needs_ffmpeg(run, tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match="ffmpeg"):
        kaju.animate(run, tmp_path / "film.mp4")
    assert not list(tmp_path.iterdir())
