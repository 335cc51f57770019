"""Many runs: points, measures, rows, seeds, sensitivities."""

from functools import partial

import pytest
import sweep_work
from hypothesis import given
from hypothesis import strategies as st
from plates import PLATE
from scipy import stats

import kaju
from kaju import LoadModel, MaterialAgent, Scene, solve, sweep
from kaju.model.study.sweep import points_of

SCENE = Scene(**PLATE, rule={"kind": "prescribed", "threshold": 0.01})
ELASTIC = SCENE.replace(rule={"kind": "elastic"})


def alone(*arguments, **options):
    """Sweep on one process, quietly."""
    return sweep(*arguments, workers=1, progress=False, **options)


def test_a_row_is_the_run_that_it_stands_for():
    table = alone(
        SCENE,
        {"rule.threshold": [1e-2, 1e-3, 1e-4], "loads[0].force[1]": [-2.0, -1.0]},
        ["load_taken", "generations", "last.ledger.dropped"],
    )
    assert list(table) == [
        "run", "rule.threshold", "loads[0].force[1]", "outcome",
        "load_taken", "generations", "last.ledger.dropped", "error",
    ]  # fmt: skip
    two = table[table["loads[0].force[1]"] == -2.0]
    assert two["load_taken"].round(6).tolist() == [12.879375, 21.104766, 31.929009]
    assert two["generations"].tolist() == [8, 11, 15]
    for _, row in table.iterrows():
        force, threshold = row["loads[0].force[1]"], row["rule.threshold"]
        changed = {"rule.threshold": threshold, "loads.0.force.1": force}
        result = LoadModel(SCENE.with_overrides(changed)).run()
        assert row["load_taken"] == result.summary()["load_taken"]
        assert row["last.ledger.dropped"] == result.last.ledger.dropped


@pytest.mark.parametrize("measure", [
    None, "load_taken", lambda result: {"taken": result.last.ledger.taken},
])  # fmt: skip
def test_a_row_tells_that_a_run_has_not_ended_at_rest(measure):
    lost = type("Lost", (MaterialAgent,), {"take": lambda self, load: None})
    own = partial(LoadModel, material_agent=lost)
    with pytest.warns(UserWarning, match="1 of 1 runs did not end at rest .*, the first ended aft"):
        table = alone(SCENE, {"rule.threshold": [0.1]}, measure, run=own)
    assert "does not balance" in table["outcome"][0]
    assert table["error"].tolist() == [""]


def test_a_class_that_is_varied_stands_in_the_table_by_its_name():
    table = alone(SCENE, {"run.material_agent": [OnlyAhead]}, "generations", run=LoadModel)
    assert table["run.material_agent"].tolist() == ["OnlyAhead"]


class OnlyAhead(MaterialAgent):
    """Passes half of everything straight on."""

    tired = kaju.State(False, "hands on")

    def pass_on(self, load):
        if 0.5 * load.magnitude > self.model.threshold:
            ahead = load._replace(magnitude=0.5 * load.magnitude)
            self.model.hand_over(self, load.direction, ahead)


def test_every_model_and_agents_of_ones_own():
    forces = {"loads[0].force[1]": [-1.0, -2.0]}
    solved = alone(ELASTIC, forces, "strain_energy")["strain_energy"]
    assert solved[1] == pytest.approx(4.0 * solved[0], rel=1e-8)
    named = alone(SCENE, forces, "strain_energy", run=solve)["strain_energy"]
    assert named[1] == pytest.approx(solved[1], rel=1e-8)
    partly = partial(LoadModel, material_agent=OnlyAhead)
    own = alone(SCENE, forces, "material_agents", run=partly)
    assert own["material_agents"].tolist() == [7, 8]
    for name in ("tired", "states.tired"):
        with pytest.raises(kaju.KajuError, match=r'result\.states\["tired"\]\.values\(\)\.sum'):
            alone(SCENE, forces, ["generations", name], run=partly)
    own = alone(SCENE, forces, "material_agents", run=own_agents)
    assert own["material_agents"].tolist() == [7, 8]
    radius = alone(SCENE, {"rule.alpha[1]": [0.1, 0.5]}, "spectral_radius", run=kaju.stability)
    assert radius["spectral_radius"].round(6).tolist() == [0.75, 1.15]
    model = alone(SCENE, {"rule.threshold": [0.01]}, "load_taken", run=LoadModel)
    assert model["load_taken"].round(6).tolist() == [12.879375]


def own_agents(subject):
    return LoadModel(subject, material_agent=OnlyAhead).run()


def test_a_failed_point_is_a_row_with_its_error():
    table = alone(
        SCENE, {"rule.alpha[1]": [0.5, 3.0], "rule.threshold": [0.01, 0.02]}, "load_taken"
    )
    assert table["error"].str.startswith("StabilityError: ").tolist() == [False, False, True, True]
    assert table["load_taken"].isna().tolist() == [False, False, True, True]


def test_seeds_are_independent_and_repeatable():
    points = {"x": [0.0] * 64}
    first, again = (alone(sweep_work.drawn, points)["value"] for _ in range(2))
    assert first.tolist() == again.tolist()
    assert first.nunique() == 64
    assert alone(SCENE, {"run.seed": [1]}, "load_taken", run=LoadModel)["error"].tolist() == [""]
    assert alone(sweep_work.drawn, points, seed=1)["value"].nunique() == 64
    assert not set(first) & set(alone(sweep_work.drawn, points, seed=1)["value"])


@given(st.integers(1, 5), st.integers(1, 4), st.integers(1, 3))
def test_a_grid_has_every_combination_once(a, b, c):
    vary = {"a": list(range(a)), "b": list(range(b)), "c": list(range(c))}
    points = points_of(vary, "grid", None, 0)
    every = [(p["a"], p["b"], p["c"]) for p in (points[k] for k in range(len(points)))]
    assert every == [(i, j, k) for i in range(a) for j in range(b) for k in range(c)]


BETA = {"rule.beta": [1.0]}
UNEVEN = {"rule.beta": [1], "rule.threshold": [1, 2]}


@pytest.mark.parametrize(("arguments", "options", "error", "message"), [
    ((SCENE, {"rule.treshold": [1.0]}), {}, kaju.KajuError, "did you mean 'threshold'"),
    ((SCENE, {}), {}, ValueError, "vary: at least one quantity"),
    ((SCENE, {"rule.threshold": 0.1}), {}, ValueError, "needs a list of values"),
    ((SCENE, {"rule.threshold": []}), {}, ValueError, "has no values"),
    ((SCENE, {"rule.beta": stats.uniform()}), {}, ValueError, "method='sobol' or 'lhs'"),
    ((SCENE, {"rule.beta": [1]}), {"method": "gird"}, ValueError, "did you mean 'grid'"),
    ((SCENE, {"rule.beta": [1]}), {"samples": 4}, ValueError, "as many points as its values"),
    ((SCENE, BETA), {"method": "lhs"}, ValueError, "needs the number of points"),
    ((SCENE, BETA), {"method": "sobol", "samples": 100}, ValueError, "take 64 or 128"),
    ((SCENE, UNEVEN), {"method": "list"}, ValueError, "'rule.beta': 1, 'rule.threshold': 2"),
    ((SCENE, {"rule.beta": [1]}, 3), {}, ValueError, "measure: must be a name"),
    ((SCENE, BETA, lambda of: None), {}, ValueError, "measure returned None; let it return a"),
    ((SCENE, {"run.rate": [1]}), {}, ValueError, "run.rate: .* material_agent=Mine"),
    ((SCENE, {"run.thresold": [1]}), {"run": LoadModel}, ValueError, "mean 'threshold'"),
    ((SCENE, {"run.luck": [1, 2]}), {"run": OnlyAhead}, ValueError, "material_agent=OnlyAhead"),
    ((SCENE, BETA), {"run": 3}, ValueError, "run: must be a function or the class of a model"),
    ((divmod, {"x": [1]}), {}, ValueError, "every run failed, the first with TypeError: "),
    ((SCENE, {"rule.beta": [1]}), {"workers": 0.5}, ValueError, "workers: must be a whole"),
    ((SCENE, {"rule.beta": [1]}), {"seed": -1}, ValueError, "seed: must be a whole"),
])  # fmt: skip
def test_what_cannot_be_swept_is_refused(arguments, options, error, message):
    with pytest.raises(error, match=message) as raised:
        sweep(*arguments, progress=False, **options)
    assert isinstance(raised.value, kaju.KajuError)
