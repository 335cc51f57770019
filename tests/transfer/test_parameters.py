"""Numbers given to a model by keyword: those of the rule, and those that agents declare."""

import pytest
from plates import plate

import kaju
from kaju import KajuError, LoadModel, MaterialAgent, Parameter, RigidBoundaryAgent, State
from kaju.errors import ParameterError


class Hardening(MaterialAgent):
    """Becomes stiffer for every load that it has taken, up to so many loads."""

    loads = Parameter(3, 1, 10, "loads before it hardens")
    softly = Parameter(False, text="whether it hardens softly")

    def shortening(self, axis):
        return super().shortening(axis) / self.loads


def pressed(**more):
    return plate([5, 4], [2, 3], **more)


def hardening(**numbers):
    return LoadModel(pressed(), material_agent=Hardening, threshold=0.01, **numbers)


def test_a_declared_number_acts_and_is_told_in_summary_file_and_columns(tmp_path):
    model = hardening(loads=6)
    three, six = hardening().run(), model.run()
    assert three.displacement == pytest.approx(2.0 * six.displacement, rel=1e-12)
    assert six.summary()["parameters"] == {"loads": 6, "softly": False}
    again = kaju.load_result(six.save(tmp_path / "six.npz"))
    assert again.parameters == six.parameters
    assert "own_agents='Hardening'" in repr(again)
    frame = model.datacollector.get_model_vars_dataframe()
    assert set(frame["loads"]) == {6}
    assert len(frame) == model.steps


@pytest.mark.parametrize(("numbers", "told"), [
    ({"thresold": 1.0}, "thresold: .*did you mean 'threshold'"),
    ({"gamma": 1.0}, "gamma: .* 'threshold'"),
    ({"loads": 11}, "loads: .*from 1 to 10"),
    ({"loads": 2.5}, "loads: .*whole number"),
    ({"threshold": "much"}, "threshold: must be a number"),
])  # fmt: skip
def test_wrong_numbers_are_named(numbers, told):
    with pytest.raises(KajuError, match=told):
        LoadModel(pressed(), material_agent=Hardening, **numbers)


def test_it_is_the_same_for_all_agents():
    class Careless(Hardening):
        def take(self, load):
            super().take(load)
            self.loads = 2

    with pytest.raises(ParameterError, match="loads: is a Parameter"):
        LoadModel(pressed(), material_agent=Careless).run()
    with pytest.raises(ParameterError, match=r"^loads: a Parameter .* on the class of the agents,"):
        type("Mine", (LoadModel,), {"loads": Parameter(3, 1, 10)})(pressed())
    with pytest.raises(ParameterError, match=r"r.3, 1, 2.: must be a whole number from 1 to 2"):
        Parameter(3, 1, 2)
    for low, high in ((2, 1), ("a", 1), (None, None)):
        with pytest.raises(ParameterError, match=f"^low, high: .*smaller.*got {low!r} and {high}"):
            Parameter(1, low, high)


def test_classes_that_cannot_be_agents_are_named():
    class Short(MaterialAgent):
        def __init__(self, model):
            super().__init__(model)

    class Open(MaterialAgent):
        def __init__(self, *start):
            super().__init__(*start)

    for wrong in (3, Short, RigidBoundaryAgent, MaterialAgent.step):
        with pytest.raises(ParameterError, match="material_agent: "):
            LoadModel(pressed(), material_agent=wrong)
    for walls, told in ((MaterialAgent, ": must"), ({"rigid": MaterialAgent}, r"\['rigid'\]: ")):
        with pytest.raises(ParameterError, match=f"boundary_agents{told}"):
            LoadModel(pressed(), boundary_agents=walls)
    for name in ("random", "dropped", "engine", "cell_x", "stress"):
        with pytest.raises(ParameterError, match=f"^{name}: "):
            LoadModel(pressed(), material_agent=type("M", (MaterialAgent,), {name: State(0)}))
    with pytest.raises(ParameterError, match=r"^steps: every LoadModel has this name already"):
        LoadModel(pressed(), material_agent=type("M", (Open,), {"steps": Parameter(3, 1, 10)}))
    for agent in (Open, type("Looks", (Open,), {"seen": State(0)})):  # a name that nobody sets
        assert LoadModel(pressed(), material_agent=agent).run().last.generations > 0
