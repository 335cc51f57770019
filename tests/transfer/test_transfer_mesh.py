"""Load transfer for ParaView: every cell of the body, with what its agent did."""

import meshlane
import numpy as np
import pytest
from plates import plate

from kaju import LoadModel
from kaju.errors import ResultError


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


def test_hexagons_are_refused(tmp_path):
    result = LoadModel(plate([4, 4], [2, 3], lattice="hexagon")).run()
    with pytest.raises(ResultError, match="to_vtk: writes squares and cubes"):
        result.to_vtk(tmp_path / "comb")
