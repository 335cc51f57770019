"""`kaju sweep`."""

import pandas
import pytest
from plates import plate as plate_of
from typer.testing import CliRunner

from kaju.__main__ import app
from kaju.errors import KajuError

PLATE = plate_of([20, 20], [10, 19], size=[0.2, 0.2], thickness=0.002).to_toml()


@pytest.fixture
def plate(tmp_path):
    file = tmp_path / "plate.toml"
    file.write_text(PLATE)
    return str(file)


def kaju(*arguments):
    return CliRunner().invoke(app, ["sweep", *map(str, arguments)])


def test_a_sweep_from_the_command(plate, tmp_path):
    out = tmp_path / "sweep"
    command = (plate, "--vary", "rule.threshold=0.01,0.001", "--out", out, "--workers", 2)
    done = kaju(*command)
    assert done.exit_code == 0, done.output
    assert done.output.startswith("2 runs, 0 failed")
    table = pandas.read_parquet(out / "table.parquet")
    assert table["load_taken"].round(6).tolist() == [12.879375, 21.104766]
    assert sorted(path.name for path in out.iterdir()) == [
        ".lock.sqlite",
        "effects.png",
        "sweep.sqlite",
        "table.parquet",
    ]
    assert kaju(*command).output == done.output  # nothing is computed again


def test_a_map_of_stability(plate, tmp_path):
    done = kaju(
        *(plate, "--vary", "rule.alpha[1]=0.1:0.9", "--vary", "rule.alpha[2]=0.01:0.9:log"),
        *("--run", "stability", "--measure", "spectral_radius", "--method", "sobol"),
        *("--samples", 32, "--out", tmp_path / "map", "--workers", 1),
    )
    assert done.exit_code == 0, done.output
    assert "... and 12 more" in done.output
    table = pandas.read_parquet(tmp_path / "map" / "table.parquet")
    forward, beside = table["rule.alpha[1]"], table["rule.alpha[2]"]
    assert forward.between(0.1, 0.9).all()
    assert beside.between(0.01, 0.9).all()
    # α₂ + 2 α₃ + 2 (1 − β) ν α₁, a bound that the plate comes close to
    bound = forward + 2 * beside + 2 * 0.5 * 0.3 * 0.5
    assert (table["spectral_radius"] <= bound * (1 + 1e-9)).all()
    assert (tmp_path / "map" / "map.png").stat().st_size > 10_000


def test_words_are_values_too(plate, tmp_path):
    done = kaju(
        plate, "--vary", "sides.left=rigid,free", "--out", tmp_path / "s", "--no-pictures",
        "--workers", 1,
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    table = pandas.read_parquet(tmp_path / "s" / "table.parquet")
    assert table["sides.left"].tolist() == ["rigid", "free"]


def test_a_sweep_of_nothing_but_failures_fails(plate, tmp_path):
    done = kaju(plate, "--vary", "rule.alpha[1]=2,3", "--out", tmp_path / "s", "--workers", 1)
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
def test_what_is_misspelt_is_refused(plate, tmp_path, options, message):
    done = kaju(plate, *options, "--out", tmp_path / "s")
    assert isinstance(done.exception, KajuError)
    assert message in str(done.exception)
    assert not (tmp_path / "s").exists()
