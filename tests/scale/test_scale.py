"""Bodies on PETSc: the answers of `solve`, on one process, two and four.

Without petsc4py, mpi4py, mpirun they are skipped, or fail if KAJU_NEEDS_PETSC is set, as in CI.
"""

import json
import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import scale_work

import kaju

WORK = Path(scale_work.__file__)
MISSING = [name for name in ("petsc4py", "mpi4py") if find_spec(name) is None]
MISSING += [] if shutil.which("mpirun") else ["mpirun"]


@pytest.fixture(autouse=True)
def _petsc():
    if MISSING:
        why = f"missing: {', '.join(MISSING)} (docs/scale.md)"
        if os.environ.get("KAJU_NEEDS_PETSC"):
            pytest.fail(why)
        pytest.skip(why)


def mpirun(processes, *arguments, check=True, timeout=560):
    environment = os.environ | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "OMPI_MCA_mpi_yield_when_idle": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    command = ["mpirun", "-n", str(processes), sys.executable, *map(str, arguments)]
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=timeout, check=False
    )
    if check:
        assert done.returncode == 0, done.stderr
    return done


@pytest.mark.parametrize("processes", [1, 2, 4])
def test_forty_random_scenes_are_answered_as_solve_does(processes):
    done = mpirun(processes, WORK, "compare", 40)
    reports = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    assert [report["scene"] for report in reports] == list(range(40))
    for report in reports:
        for what in ("displacement", "stress", "energy", "reaction"):
            assert report[what] < 1e-8, report
        if report["method"] != "direct":
            # `solve` sweeps more often by itself: its sweeps need not wait for other processes.
            assert report["iterations"] <= 2 * report["own_iterations"] + 2, report
        ours, own = report["error_estimate"]
        if report["method"] == "Galerkin multigrid":
            assert 0.65 * own < ours < 1.25 * own, report


def test_one_process_gives_an_ordinary_result():
    scene = scale_work.plate()
    result = kaju.solve_petsc(scene)
    own = scale_work.own_solve(scene, tolerance=1e-12)
    assert type(result) is type(own)
    points = np.array([[0.1, 0.15], [0.2, 0.05]])
    np.testing.assert_allclose(
        result.displacement_at(points), own.displacement_at(points), rtol=1e-8
    )
    assert result.summary()["method"] == "PETSc multigrid"


@pytest.mark.parametrize("seed", [2, 3])  # 3: in space
def test_written_in_parallel_and_read_in_pieces(tmp_path, seed):
    folder = tmp_path / "answer"
    mpirun(4, WORK, "save", folder, seed)
    fields = ("displacement", "kind", "nodes", "stress")
    names = {f"{field}-0000{rank}.npy" for field in fields for rank in range(4)}
    assert {path.name for path in folder.iterdir()} == names | {"result.xdmf", "scene.npz"}
    stored = kaju.load_result(folder)
    scene = scale_work.random_scene(seed)
    own = scale_work.own_solve(scene, tolerance=1e-12)
    assert stored.scene == scene
    assert len(stored.pieces) == 4
    assert stored.strain_energy == pytest.approx(own.strain_energy, rel=1e-9)
    rng = np.random.default_rng(1)
    cells = np.argwhere(own.cells().body)
    inside = cells[rng.integers(len(cells), size=200)] + rng.uniform(0, 1, (200, cells.shape[1]))
    points = (inside + np.array(own.found.origin)) * scene.lattice.cell_size
    scale = own.max_displacement
    difference = stored.displacement_at(points) - own.displacement_at(points)
    assert np.abs(difference).max() < 1e-8 * scale
    table = stored.to_dataframe()
    assert len(table) == own.summary()["agents"]
    assert table["u_x"].abs().sum() == pytest.approx(np.abs(own.displacement[:, 0]).sum(), rel=1e-8)
    assert kaju.load_result(folder / "result.xdmf").summary() == stored.summary()


def test_damaged_pieces_are_refused(tmp_path):
    folder = tmp_path / "answer"
    mpirun(2, WORK, "save", folder)
    piece = folder / "stress-00001.npy"
    whole = piece.read_bytes()
    for end in (40, len(whole) // 2):
        piece.write_bytes(whole[:end])
        with pytest.raises(kaju.KajuError, match="damaged"):
            kaju.load_result(folder)
    piece.unlink()
    with pytest.raises(kaju.KajuError, match="damaged"):
        kaju.load_result(folder)


def test_a_killed_process_ends_the_run_and_leaves_no_torn_file(tmp_path):
    folder = tmp_path / "answer"
    done = mpirun(2, WORK, "die", folder, check=False, timeout=60)
    assert done.returncode != 0
    assert "signal 9 (Killed)" in done.stderr
    assert not folder.exists()
    mpirun(2, WORK, "save", folder)  # what the killed one left is nobody's to remove
    assert {path.name[0] for path in tmp_path.iterdir() if path != folder} == {"."}
    assert folder.is_dir()


def test_what_petsc_cannot_do_is_refused():
    scene = scale_work.plate()
    with pytest.raises(ValueError, match="tolerance: must be"):
        kaju.solve_petsc(scene, tolerance=2.0)
