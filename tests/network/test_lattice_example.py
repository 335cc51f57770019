"""The lattice example: it runs, and shows what its page says it shows."""

import json
from pathlib import Path

import pytest
from scripts import script

FOLDER = Path(__file__).parents[2] / "examples" / "lattice"
lattice = script(FOLDER / "lattice.py")
run = script(FOLDER / "run.py")


@pytest.mark.parametrize(
    ("width", "rows", "nodes", "tip"), [(5, 9, 41, 0.137), (9, 5, 43, 0.116), (17, 17, 281, 0.187)]
)
def test_the_posters_lattices(width, rows, nodes, tip):
    told = run.figures_of(lattice.pressed(width, rows))
    assert told["nodes"] == nodes
    assert told["tip"] == pytest.approx(tip, abs=5e-4)
    worst = told["largest_strain_between"]
    assert len(worst) == 4, "the lattice is the same on the left and right, above and below"
    tips = [node for ends in worst for node in ends if node == told["tip_node"]]
    assert len(tips) == 2, "strain is largest at the load"


@pytest.mark.slow
def test_it_writes_what_its_page_lists(tmp_path):
    assert lattice.free_motions(lattice.triangular(5)) == 3
    assert "nothing holds the nodes" in lattice.without_supports()
    summary = run.main(["--out", str(tmp_path)])
    page = (FOLDER / "MODEL.md").read_text()
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {name for name in names if f"`{name}`" in page}
    assert len(names) == 6
    assert json.loads((tmp_path / "summary.json").read_text()) == summary
