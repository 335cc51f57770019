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
        ("a" + ".a" * 100_000 + " = 1", "too many parts"),
        ("[" + "a." * 3_000 + "a]", "too many parts"),
        ("x = {" + "a . " * 3_000 + "a = 1}", "too many parts"),
        ('"a"' + '."a"' * 3_000 + " = 1", "too many parts"),
        ("'a'" + ".'a'" * 3_000 + " = 1", "too many parts"),
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


def test_dots_in_drawings_texts_and_comments_are_not_keys():
    drawn = "ab" + ".a" * 40
    scene = Scene.from_toml(
        f'''
# a comment with a.key.of.very.many.parts.{"x." * 40}
[body]
cell_size = 0.01
drawing = """
{drawn}
{"=" * len(drawn)}
"""
[legend]
"." = "steel"
a = "steel" # "not a text {"a." * 40}
b = 'steel'
"=" = "rigid"
[[loads]]
cell = [0, 1]
force = [0.0, -1.0]
'''
    )
    assert scene.lattice.shape == (len(drawn), 2)


def test_a_text_larger_than_any_scene_is_refused_unread():
    with pytest.raises(SceneError, match=r"100000001 characters are more than 1e\+08"):
        Scene.from_toml("#" * 100_000_001)
