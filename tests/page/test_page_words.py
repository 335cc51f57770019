"""Words of the page: complete in every language, and the certificate's are kaju's."""

import json
import re
from pathlib import Path

import pytest
from page_scenes import described, random_scenes

import kaju.view.page
from kaju import stability

PAGE = Path(kaju.view.page.__file__).parent

VERDICTS = """
import { certifying } from "./rule.js";
import { say, verdictOf } from "./words.js";
const last = (steps) => { let one; do one = steps.next(); while (!one.done); return one.value; };
const told = ({ scene, cells }) => verdictOf(last(certifying(scene, cells)), scene.rule, say("en"));
tell(data.map(told));
"""


@pytest.mark.parametrize("share", [3, pytest.param(1, marks=pytest.mark.slow)])
def test_the_certificate_says_what_stability_says(node, share):
    scenes = [scene for scene, _ in random_scenes(70 // share, seed=3)]
    scenes += [scene for scene, _ in random_scenes(50 // share, seed=4, accumulate=True)]
    expected = [stability(scene).verdict for scene in scenes]
    assert node(VERDICTS, [described(scene) for scene in scenes]) == expected
    assert sum("grow" in verdict for verdict in expected) > 10 / share


@pytest.mark.parametrize("file", ["words.json", "python/words.json"])
def test_every_language_has_every_word_and_its_gaps(file):
    words = json.loads((PAGE / file).read_text("utf-8"))
    assert set(words) == {"en", "de", "ja"}
    for language in ("de", "ja"):
        assert words[language].keys() == words["en"].keys()
        for key, text in words["en"].items():
            holes, theirs = (set(re.findall(r"{(\w+)", t)) for t in (text, words[language][key]))
            assert theirs == holes, (language, key)


def test_a_force_times_a_length_is_typed_as_work(node):
    ask = 'import { numberOf } from "./controls.js"; tell(data.map((text) => numberOf(text, "mJ")))'
    told = node(ask, ["14 N·mm", "1,4 kN · µm", "2 Nm", "3 mJ", "4 mN", "5 kN"])
    assert told == [pytest.approx(14), pytest.approx(1.4), pytest.approx(2000), 3, None, None]


def test_a_quantity_is_rounded_once(node):
    ask = 'import { quantity } from "./words.js"; tell(data.map((d) => quantity(...d)))'
    told = node(ask, [[116.44604, "N", 116.44604], [11.6446, "N", 116.4], [1.16449, "N", 116.4]])
    assert told == ["116.4 N", "11.64 N", "1.16 N"]


def test_a_logarithmic_axis_has_several_ticks(node):
    ask = 'import { ticksOf } from "./charts.js"; tell(data.map((d) => ticksOf(...d, 5, true)))'
    told = node(ask, [[0.8, 19.0], [1e-5, 1.0], [0.011, 0.019]])
    assert told == [[1, 2, 5, 10], [1e-5, 1e-4, 1e-3, 0.01, 0.1, 1], [0.012, 0.014, 0.016, 0.018]]
