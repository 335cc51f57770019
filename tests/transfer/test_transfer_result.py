"""A result is stored, read again, and written for ParaView."""

import meshlane
import numpy as np
import pytest
from plates import loaded, plate
from transfer_answers import assert_same

from kaju import LoadModel, PrescribedRule, TransferResult


@pytest.fixture(scope="module")
def result():
    load, rule = {"cell": [1, 2], "force": [0.5, -2.0], "steps": 3}, PrescribedRule(threshold=1e-3)
    return LoadModel(loaded("abba\naa.a\n====", load, sides={}, rule=rule)).run()


def test_a_result_survives_storing(result, tmp_path):
    path = result.save(tmp_path / "run")
    assert path == tmp_path / "run.npz"
    again = TransferResult.load(path)
    assert again.scene == result.scene
    assert again.summary() == result.summary()
    assert again.certificate == result.certificate
    np.testing.assert_array_equal(again.displacement, result.displacement)
    for one, other in zip(result.stages, again.stages, strict=True):
        assert_same(one, other)
    assert [file.name for file in tmp_path.iterdir()] == ["run.npz"], "nothing half-written"


def test_a_data_frame_has_a_row_per_agent(result):
    frame = result.to_dataframe()
    assert len(frame) == len(result.last.cells) == 7
    assert set(frame["material"]) == {"steel", "rubber"}
    assert frame["taken_-y"].sum() == pytest.approx(result.last.taken[:, 2].sum())
    assert frame.loc[0, ["cell_x", "cell_y", "spawn_step"]].tolist() == [1, 2, 1]
    np.testing.assert_array_equal(frame["stress_yy"], result.stress[:, 1, 1])


def run(dimension):
    cells = [6] * dimension
    force = [0.0] * (dimension - 1) + [-2.0]
    hole = {"material": "air", "box": [[0.0] * dimension, [0.021] * dimension]}
    return LoadModel(plate(cells, [3] * (dimension - 1) + [5], force, regions=[hole])).run()


@pytest.mark.parametrize("dimension", [2, 3])
def test_every_cell_is_there_and_agents_have_what_they_took(tmp_path, dimension):
    result = run(dimension)
    mesh = meshlane.read(result.to_vtk(tmp_path / "body"))
    (block,) = mesh.cells
    assert block.type == ("quad" if dimension == 2 else "hexahedron")
    assert len(block.data) == 6**dimension - 2**dimension
    taken = mesh.cell_data["load_taken"][0]
    assert taken.sum() == pytest.approx(result.last.ledger.taken)
    middles = mesh.points[block.data].mean(axis=1)[:, :dimension]
    agents = result.scene.lattice.locate(middles[taken > 0.0])
    assert {tuple(c) for c in agents.tolist()} == {tuple(c) for c in result.last.cells.tolist()}
    np.testing.assert_allclose(
        mesh.cell_data["displacement"][0][:, :dimension], result.displacement_at(middles)
    )
