"""A result is stored, read again, and told as a table."""

import numpy as np
import pytest
from plates import loaded
from transfer_answers import assert_same

from kaju import ElasticResult, LoadModel, PrescribedRule, TransferResult
from kaju.errors import ResultFileError


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
    with pytest.raises(ResultFileError, match=r"holds a result of kind .*, not of 'elastic"):
        ElasticResult.load(path)


def test_a_data_frame_has_a_row_per_agent(result):
    frame = result.to_dataframe()
    assert len(frame) == len(result.last.cells) == 7
    assert set(frame["material"]) == {"steel", "rubber"}
    assert frame["taken_-y (N)"].sum() == pytest.approx(result.last.taken[:, 2].sum())
    assert frame.loc[0, ["cell_x", "cell_y", "spawn_step"]].tolist() == [1, 2, 1]
    np.testing.assert_array_equal(frame["stress_yy (Pa)"], result.stress[:, 1, 1])
    x, y = result.stress[:, [0, 1], [0, 1]].T  # without shear
    np.testing.assert_allclose(result.von_mises**2, x**2 - x * y + y**2)
