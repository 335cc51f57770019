"""Scene texts with slips of the pen, or that no person writes: a scene, or an error by name."""

import re
import warnings
from pathlib import Path
from time import process_time

import numpy as np
import pytest
from plates import PLATE_TEXT

import kaju
from kaju import KajuError, Scene
from kaju.errors import SceneError

PLATE = (Path(kaju.__file__).parent / "plate.toml").read_text()
LAYERS = """
[body]
cell_size = 0.01
plane = "strain"
drawing = '''
##aa##
##aa##
######
'''
[[body.regions]]
disk = { centre = [0.03, 0.015], radius = 0.006 }
material = "air"
[legend]
"#" = "steel"
a = "soft"
[materials.soft]
youngs_modulus = 1e6
poissons_ratio = 0.45
[sides]
bottom = "rigid"
left = { displacement = [0.0, 1e-6] }
right = { stiffness = 1e9 }
[[loads]]
region = { box = [[0.0, 0.03], [0.02, 0.03]] }
force = [0.3, -2.0]
steps = 2
[rule]
kind = "elastic"
order = "wave"
[history]
times = [0.0, 1.0, 2.0]
factors = [0.0, 1.0, 0.5]
"""
NUMBERS = ["0", "-1", "1e308", "1e-308", "nan", "inf", "-inf", "99999999999", "0.5", "true", "'a'"]
NUMBERS += ["[]", "[[]]", "{}", "1_0", "0x7f", "2026-11-22", "[1, 2, 3, 4]", '""']


def slipped(text, rng):
    """Return a text with one to three slips."""
    for _ in range(rng.integers(1, 4)):
        way = rng.integers(6)
        lines = text.split("\n")
        if way == 0:
            del lines[rng.integers(len(lines))]
        elif way == 1:
            lines.insert(rng.integers(len(lines)), lines[rng.integers(len(lines))])
        if way < 2:
            text = "\n".join(lines)
            continue
        place = int(rng.integers(len(text)))
        if way == 2:
            text = text[:place] + text[place + int(rng.integers(1, 8)) :]
        elif way == 3:
            text = text[:place] + chr(int(rng.integers(1, 0x3000))) + text[place:]
        else:
            pattern = r"-?\d+\.?\d*(?:e-?\d+)?" if way == 4 else r"\"[^\"\n]*\"|\w+(?= =)"
            spans = [found.span() for found in re.finditer(pattern, text)]
            if spans:
                start, end = spans[rng.integers(len(spans))]
                words = NUMBERS if way == 4 else [text[slice(*spans[rng.integers(len(spans))])]]
                text = text[:start] + words[rng.integers(len(words))] + text[end:]
    return text


@pytest.mark.parametrize(
    ("seed", "count"), [(13, 250), pytest.param(2026, 5000, marks=pytest.mark.slow)]
)
def test_slips_are_scenes_or_errors_by_name(seed, count, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    warnings.simplefilter("error")
    refused = 0
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        text = slipped((PLATE, LAYERS)[number % 2], rng)
        try:
            Scene.from_toml(text).applied()
        except KajuError:
            refused += 1
        except Exception as error:
            raise AssertionError(f"{number}: {error!r}\n{text}") from error
    assert 0.1 < refused / count < 0.9


CIRCLE = ", ".join(f"[{0.1 + 1e-6 * k}, {0.1 + 1e-12 * k * k}]" for k in range(10_001))


@pytest.mark.parametrize(("text", "message"), [
    ("a = " + "[" * 100_000, "nested too deeply"),
    ("a = " + "{a = " * 5_000, "nested too deeply"),
    (PLATE_TEXT + "steps = 100001", "steps: must be 100000 or less"),
    (f"{PLATE_TEXT}[[body.regions]]\nmaterial = 'air'\npolygon = [{CIRCLE}]", "at most 10000"),
], ids=lambda value: value[:12])  # fmt: skip
def test_what_nobody_writes_is_refused_at_once(text, message):
    start = process_time()
    with pytest.raises(SceneError, match=message):
        Scene.from_toml(text)
    assert process_time() - start < 5.0


def test_a_text_larger_than_any_scene_is_refused_unread():
    with pytest.raises(SceneError, match=r"100000001 characters are more than 1e\+08"):
        Scene.from_toml("#" * 100_000_001)
