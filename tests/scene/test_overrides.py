"""Single values changed by their key path, as the command's --set does."""

import pytest
from plates import PLATE_TEXT

from kaju import Scene, load_scene
from kaju.errors import SceneError

PLATE = PLATE_TEXT + "steps = 20\n"


def changed(**changes):
    return Scene.from_toml(PLATE).with_overrides(
        {key.replace("__", "."): value for key, value in changes.items()}
    )


def test_values_are_read_as_toml_writes_them():
    scene = changed(
        loads__0__steps="1",
        rule__threshold="0.001",
        rule__accumulate="true",
        loads__0__force="[1, 0]",
    )
    assert scene.stages == 1
    assert scene.rule.threshold == 0.001
    assert scene.rule.accumulate is True
    assert scene.loads[0].force == (1.0, 0.0)


def test_items_of_lists_and_new_tables():
    scene = changed(loads__0__force__1="-3", materials__steel__base="steel",
                    sides__left="{stiffness = 1e6}", body__cells=[40, 40])  # fmt: skip
    scene_again = Scene.from_toml(PLATE)
    assert scene_again.loads[0].force == (0.0, -2.0)
    assert scene.loads[0].force == (0.0, -3.0)
    assert scene.side_condition("left").stiffness == 1e6
    assert scene.lattice.shape == (40, 40)


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("rule.treshold", "1", r"rule.treshold: unknown key \(did you mean 'threshold'\?\)"),
        ("loads.1.steps", "1", "loads.1: loads is a list; its items are 0 to 0, .* no item '1'"),
        ("loads.0.steps.0", "1", "loads.0.steps.0: loads.0.steps is 20, which has no parts"),
        ("body..cells", "1", "is not a key path"),
        ("loads.0.steps", "many", "loads.0.steps: must be a whole number, got 'many'"),
        # one value cannot smuggle in another
        ("loads.0.steps", "1\nother = 2", "loads.0.steps: must be a whole number"),
    ],
)
def test_paths_and_values_that_cannot_be(key, value, told):
    with pytest.raises(SceneError, match=told):
        Scene.from_toml(PLATE).with_overrides({key: value})


def test_a_file_may_be_mended_while_it_is_read(tmp_path):
    path = tmp_path / "plate.toml"
    path.write_text(PLATE.replace("steps = 20", "steps = 0"))
    with pytest.raises(SceneError, match=r"plate.toml: line 11: loads.0.steps: must be above 0"):
        load_scene(path)
    assert load_scene(path, {"loads.0.steps": "2"}).stages == 2


def test_a_new_kind_of_rule_starts_a_new_rule():
    scene = Scene.from_toml(PLATE)
    elastic = scene.with_overrides({"rule.threshold": "0.5", "rule.kind": "elastic"})
    assert (elastic.rule.kind, elastic.rule.threshold) == ("elastic", 0.5)
    assert scene.with_overrides({"rule.kind": "prescribed"}).rule == scene.rule
