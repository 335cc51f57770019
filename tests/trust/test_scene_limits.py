"""Texts that no person writes are refused at once, by name."""

from time import process_time

import pytest
from plates import PLATE_TEXT

from kaju import Scene
from kaju.errors import SceneError

CIRCLE = ", ".join(f"[{0.1 + 1e-6 * k}, {0.1 + 1e-12 * k * k}]" for k in range(10_001))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = " + "[" * 100_000, "nested too deeply"),
        ("a = " + "{a = " * 5_000, "nested too deeply"),
        (PLATE_TEXT + "steps = 100001", "steps: must be 100000 or less"),
        (f"{PLATE_TEXT}[[body.regions]]\nmaterial = 'air'\npolygon = [{CIRCLE}]", "at most 10000"),
    ],
    ids=lambda value: value[:12],
)
def test_what_nobody_writes_is_refused_at_once(text, message):
    start = process_time()
    with pytest.raises(SceneError, match=message):
        Scene.from_toml(text)
    assert process_time() - start < 5.0


def test_a_text_larger_than_any_scene_is_refused_unread():
    with pytest.raises(SceneError, match=r"100000001 characters are more than 1e\+08"):
        Scene.from_toml("#" * 100_000_001)
