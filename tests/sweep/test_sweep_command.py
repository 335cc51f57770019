"""`kaju sweep`."""

import pandas
import pytest
from plates import PLATE

from kaju import Scene
from kaju.errors import KajuError


@pytest.fixture
def swept(tmp_path, typed):
    """Sweep the worked plate into a folder; return the folder and what was told."""
    file, out = tmp_path / "plate.toml", tmp_path / "sweep"
    Scene(**PLATE).save(file)

    def run(*words):
        return out, typed("sweep", file, *words, "--out", out, "--workers", 1)

    return run


def table_of(out):
    return pandas.read_parquet(out / "table.parquet")


def test_a_sweep_from_the_command(swept):
    words = ("--vary", "rule.threshold=0.01,0.001", "--workers", 2)
    out, done = swept(*words)
    assert done.exit_code == 0, done.output
    assert done.output.startswith("2 runs, 0 failed")
    assert table_of(out)["load_taken"].round(6).tolist() == [12.879375, 21.104766]
    names = ["effects.png", "sweep.sqlite", "table.parquet"]
    assert sorted(path.name for path in out.iterdir()) == names
    assert swept(*words)[1].output == done.output  # nothing is computed again


def test_a_sweep_of_nothing_but_failures_fails(swept):
    _, done = swept("--vary", "rule.alpha[1]=2,3")
    assert done.exit_code == 1
    assert "2 runs, 2 failed" in done.output
    assert "StabilityError" in done.output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--vary", "rule.beta"], "KEY=VALUE,VALUE or KEY=LOW:HIGH"),
        (["--vary", "rule.beta=2:1"], "LOW below HIGH"),
        (["--vary", "rule.beta=0:1:log"], "above 0"),
        (["--vary", "rule.beta=0:1"], "method='sobol' or 'lhs'"),
        (["--vary", "rule.beta=0,1", "--run", "fem"], "--run: auto, agents, solve, stability"),
    ],
)
def test_what_is_misspelt_is_refused(swept, tmp_path, options, message):
    with pytest.raises(KajuError, match=message):
        swept(*options)
    assert not (tmp_path / "sweep").exists()
