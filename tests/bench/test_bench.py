"""The benchmark: its problems, its peers, its bookkeeping. Nothing here is timed."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from peers import bilinear, quadratic
from peers.measure import Measurement, jobs, measure
from peers.methods import METHODS
from peers.problems import BLOCK, PIXELS, PLATE, PROBLEMS
from work_precision import QUOTED, environment, measured_on, quotations


def test_pictures_have_no_cells_that_touch_at_corners_only():
    p = PIXELS.picture
    a, b, c, d = p[:-1, :-1], p[1:, :-1], p[:-1, 1:], p[1:, 1:]
    assert not (a & d & ~b & ~c).any()
    assert not (b & c & ~a & ~d).any()


each_problem = pytest.mark.parametrize("problem", PROBLEMS.values(), ids=list(PROBLEMS))


@each_problem
def test_kaju_and_bilinear_elements_both_approach_the_truth(problem):
    """Two programs that share nothing come close to a third that shares nothing with them."""
    ours = [problem.error(METHODS["multigrid"].answer(problem, d)())[1] for d in (2, 4)]
    assert ours[1] < 0.6 * ours[0] < 0.05
    if problem.dimension == 2:
        theirs = [problem.error(bilinear.solve(problem, d, "superlu")())[1] for d in (2, 4)]
        assert theirs[1] < 0.6 * theirs[0] < 0.05


SMALL_BLOCK = replace(BLOCK, picture=np.ones((4, 4, 4), dtype=np.bool_), edge=0.25)


@pytest.mark.parametrize("problem", [PIXELS, SMALL_BLOCK], ids=["pixels", "block"])
def test_solvers_of_peers_agree(problem):
    direct, iterated = (bilinear.solve(problem, 2, by)() for by in ("superlu", "pyamg"))
    np.testing.assert_allclose(iterated, direct, atol=1e-5 * np.abs(direct).max())


@pytest.mark.parametrize("problem", [PLATE, PIXELS], ids=["plate", "pixels"])
def test_adaptive_quadratic_elements_approach_the_truth(problem):
    """From below in energy, and their estimate stays above the true error."""
    truth = problem.truth()
    answers = [a for a, _ in zip(quadratic.adaptive(problem, "superlu"), range(7), strict=False)]
    energies = [a.energy / truth.strain_energy for a in answers]
    assert energies == sorted(energies)
    assert 0.998 < energies[-1] < 1.0
    for answer, energy in zip(answers, energies, strict=True):
        assert answer.error_estimate**2 > 1.0 - energy
    first, last = (problem.error(a.at(problem.points))[0] for a in (answers[0], answers[-1]))
    assert last < 0.06 * first


def test_a_measurement_is_complete():
    found = measure("plate", "multigrid", 1)
    assert (found.problem, found.method, found.cells, found.runs) == ("plate", "multigrid", 400, 3)
    assert found.seconds > 0.0
    assert 0.0 < found.l2_error < found.max_error < 0.1


def test_documents_quote_the_record():
    root = Path(__file__).parents[2]
    table = pd.read_csv(root / "docs" / "work_precision.csv").astype(object)
    record = [Measurement(**m) for m in table.where(table.notna(), None).to_dict("records")]
    assert "cores " in measured_on(environment())
    assert {(m.problem, m.method, m.division) for m in record} <= set(jobs(False))
    measured = (root / "docs" / "work-precision.md").read_text(encoding="utf-8")
    processor = re.findall(r"Measured on: processor (.*?);", measured)[0]
    for (name, _), said in zip(QUOTED, quotations(record, processor), strict=True):
        assert said in (root / name).read_text(encoding="utf-8"), f"{name} quotes other figures"
