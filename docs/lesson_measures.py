"""What holds the sentences of lessons: expressions beside them, worked out by the tests.

Behind a sentence stands ``<!-- ... -->``: expressions, set apart by semicolons. What is true or
false must be true; all other values are the numbers of the sentence, in its order and to the digits
that it gives. A number in an expression is a setting: it may stand between them. Fields are held by
the answers in ``toml questions``. Where the rule runs, `PLANE` has the words: ``cut(3)`` is the
force through the third row, ``p[1].cut(3)`` that of the second preset; of recorded runs `RECORDED`.
Rows count from the top, from 1; cells are (column, row) from the lower left; forces are in newtons,
widths in cells, displacements in nanometres.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property, partial
from math import ceil, log, sqrt
from operator import attrgetter
from typing import Any

import lesson_runs
import numpy as np
from lesson_texts import FENCE, MARK, Lesson, lesson
from numpy.typing import NDArray

import kaju
from kaju.view.page.python import header

Words = dict[str, Callable[..., Any]]
DOWN = 2  # place of the downward direction among the four of a square cell
NUMBER = re.compile(r"(?<![\w.])\d+(?:,\d{3})*(?:\.\d+)?(?!\w)")
_SENTENCE = re.compile(r".+?(?:[.?!](?=\s|<!--|$)|$)(?:\s*<!--.*?-->)?", re.S)
ARITHMETIC = {"log": log, "sqrt": sqrt, "ceil": ceil}


class Seen:
    """A plane scene of squares under a load from above, run and solved when first asked for."""

    def __init__(self, scene: kaju.Scene, **how: Any) -> None:
        self.scene, self.how = scene, how or {"engine": "arrays", "allow_unstable": True}
        self.certificate = kaju.stability(scene)

    def __getattr__(self, word: str) -> Callable[..., Any]:
        if word not in PLANE:
            raise AttributeError(word)
        return partial(PLANE[word], self)

    @cached_property
    def run(self) -> kaju.TransferResult:
        """Return the answer of the rule."""
        return kaju.LoadModel(self.scene, **self.how).run()

    @cached_property
    def elastic(self) -> Any:
        """Return the answer of elasticity on the same cells."""
        return kaju.solve(self.scene)

    stage = property(lambda seen: seen.run.last)  # the last of the rule's run
    top = property(lambda seen: int(seen.scene.lattice.shape[1]) - 1)  # row, from the ground

    def by_row(self, cells: NDArray[Any]) -> list[int]:
        """Return how many of the cells each row has, from the top to the last that has any."""
        return np.bincount(self.top - cells[:, 1]).tolist() if len(cells) else []

    def only_load(self, generation: int) -> tuple[int, bool]:
        """Return the row and pull (or push) of the only load taken in a generation."""
        history = self.stage.history
        (place,) = np.flatnonzero(history.generation == generation)
        row = self.stage.cells[history.agent[place], 1]
        return int(row), bool(history.pull[place])

    def movement(self, result: Any, *cell: int) -> NDArray[Any]:
        """Return the displacement (nm) of a cell's centre."""
        return 1e9 * result.displacement_at(self.scene.lattice.centres(np.array([cell])))[0]

    def width(self, result: Any, row: int) -> float:
        """Return the half width (cells) of the pressure along a row."""
        columns = np.arange(self.scene.lattice.shape[0])
        cells = np.stack([columns, np.full_like(columns, self.top + 1 - row)], axis=1)
        inside = self.scene.kinds(cells) >= 0
        pressure = np.zeros(len(cells))
        pressure[inside] = -result.stress_at(self.scene.lattice.centres(cells[inside]))[:, 1, 1]
        return half_width(pressure)


def _ready(seen: Seen, name: str, put: tuple[str, str] = ("", ""), **numbers: float) -> Seen:
    """Return the scene under agents that pages begin with in the tab *Agent*, one word changed."""
    names: dict[str, Any] = {"__name__": name}
    exec(header({})["python"]["ready"][name]["code"].replace(*put), names)  # noqa: S102
    own = (value for value in names.values() if isinstance(value, type))
    agent = next(value for value in own if value.__module__ == name)
    return Seen(seen.scene, material_agent=agent, seed=1, **numbers)


def half_width(profile: NDArray[Any]) -> float:
    """Return how far (cells) from its peak a profile falls to half, both sides averaged."""
    peak = int(profile.argmax())
    widths = []
    for side in (profile[peak:], profile[peak::-1]):
        below = np.flatnonzero(side <= 0.5 * profile[peak])
        if not len(below):
            return float("inf")
        last = int(below[0])
        above, under = side[last - 1], side[last]
        widths.append(last - 1 + (above - 0.5 * profile[peak]) / (above - under))
    return float(np.mean(widths))


def _straight(seen: Seen, rows: list[int], root: bool = False, elastic: bool = False) -> float:
    """Return how straight half widths lie over the depth, or over its root: 1 is a line."""
    depth = np.array(rows) - 0.5
    widths = [seen.elastic_half_width(r) if elastic else seen.half_width(r) for r in rows]
    return float(np.corrcoef(np.sqrt(depth) if root else depth, widths)[0, 1])


PLANE: Words = {
    # the body, its load and its certificate
    "put_on": lambda seen: float(np.abs(seen.scene.applied().force[:, 1].sum())),
    "cells": lambda seen: int((seen.scene.rasterise() >= 0).sum()),  # that are no air
    "with_": lambda seen, **rule: Seen(
        seen.scene.with_overrides({f"rule.{name}": value for name, value in rule.items()})
    ),
    "ready": _ready,
    "broken": lambda seen: int(seen.run.states["broken"].values().sum()),
    "stable": lambda seen: seen.certificate.stable,
    "verdict": lambda seen: seen.certificate.verdict,
    "radius": lambda seen: seen.certificate.upper,  # growth of the load in a generation, at most
    "derived": lambda seen: list(  # what an elastic agent hands on: ahead, back, to two sides
        attrgetter("forward", "backward", "friction", "friction")(
            kaju.ElasticRule().shares(seen.scene.cell_materials[0], 2)
        )
    ),
    # agents and generations
    "generations": lambda seen: seen.stage.generations,
    "agents": lambda seen: len(seen.stage.cells),
    "woken": lambda seen, generation: seen.by_row(
        seen.stage.cells[seen.stage.spawn_step <= generation]
    ),
    "rows": lambda seen: seen.by_row(seen.stage.cells),
    "depth": lambda seen: len(seen.rows()),
    "narrows": lambda seen: seen.rows() == sorted(seen.rows(), reverse=True),
    # loads
    "load_at": lambda seen, generation: seen.only_load(generation)[0],  # row, from the ground
    "load_in": lambda seen, generation: float(  # taken by all agents
        seen.stage.history.load[seen.stage.history.generation == generation].sum()
    ),
    "pull_in": lambda seen, generation: seen.only_load(generation)[1],
    "pulls": lambda seen: bool(seen.stage.pulled.any()),
    "first_pull": lambda seen: int(
        seen.stage.history.generation[seen.stage.history.pull].min()  # its generation
    ),
    "taken": lambda seen, column, row, way=slice(None): float(  # of one direction, or of all
        seen.stage.taken[(seen.stage.cells == [column, row]).all(axis=1)][:, way].sum()
    ),
    "largest": lambda seen: float(seen.stage.taken.sum(axis=1).max(initial=0.0)),
    "largest_at": lambda seen: seen.stage.cells[seen.stage.taken.sum(axis=1).argmax()].tolist(),
    "returned": lambda seen: float(seen.stage.returned.sum()),  # by air and walls
    "at_ground": lambda seen: float(seen.run.reactions.get("bottom", [0.0, 0.0])[1]),
    # displacements
    "tip_moves": lambda seen: float(  # the loaded cell, upwards
        seen.movement(seen.run, *seen.scene.applied().cells[0])[1]
    ),
    "moved": lambda seen, *cell: float(np.linalg.norm(seen.movement(seen.run, *cell))),
    "elastic_moved": lambda seen, *cell: float(  # a cell's own, which the page shows
        1e9 * np.linalg.norm(seen.elastic.cells().displacement[cell])
    ),
    "misfit": lambda seen: float(kaju.compare(seen.run, seen.elastic).displacement.misfit),
    # forces through rows, and how wide the pressure is
    "cuts": lambda seen: seen.run.cuts("y").carried[::-1].round(6).tolist(),
    "cut": lambda seen, row: seen.cuts()[row - 1],
    "along": lambda seen, *cell: float(  # what a cell bears along the load
        -seen.run.stress_at(seen.scene.lattice.centres(np.array([cell])))[0, 1, 1]
        * (seen.scene.lattice.cell_size * seen.scene.thickness)
    ),
    "elastic_cut": lambda seen, row: float(seen.elastic.cuts("y").carried[-row]),
    "elastic_cuts_kept": lambda seen: bool(
        np.allclose(seen.elastic.cuts("y").carried, seen.put_on(), rtol=1e-9, atol=0.0)
    ),
    "half_width": lambda seen, row: seen.width(seen.run, row),
    "elastic_half_width": lambda seen, row: seen.width(seen.elastic, row),
    "straight": _straight,
}


def _largest_steps(result: Any) -> NDArray[Any]:
    """Return the largest displacement of a node (m) at every record."""
    return np.linalg.norm(result.displacement, axis=2).max(axis=1)


def _many_sizes(run: Callable[..., Any]) -> Words:
    def size_near(x: float, y: float, page: str = "") -> float:
        away = np.abs(run(page).middle - [x, y]).max(axis=1) - 0.5 * run(page).size
        return float(run(page).size[away <= away.min() + 1e-9].min())

    def near(distance: float) -> NDArray[Any]:
        return np.linalg.norm(run().middle - [0.105, 0.2], axis=1) < distance

    def with_most_of_the_gap(generation: int, page: str = "") -> int:
        gaps = np.sort(run(page).generations[generation].gap)[::-1].cumsum()
        return int(np.searchsorted(gaps, 0.9 * gaps[-1])) + 1

    return {
        "size_near": size_near,
        "with_most_of_the_gap": with_most_of_the_gap,
        "near_share": lambda distance: float(near(distance).mean()),
        "near_area": lambda distance: float((run().size[near(distance)] ** 2).sum() / 0.2**2),
        "halved": lambda x, y: log(0.02 / size_near(x, y, "hole")) / log(2.0),  # from 20 mm
    }


def _lattice(run: Callable[..., Any]) -> Words:
    def pulled_across(number: int) -> bool:
        most = np.argsort(run().tension[15])[-number:]  # at three quarters of the load
        ends = run().network.positions[run().network.springs[most]]
        return bool(np.allclose(ends[:, 0, 1], ends[:, 1, 1]))

    def pressed_nodes() -> set[int]:
        force = np.linalg.norm(run().network.force_at(1.0), axis=1)
        return set(np.flatnonzero(force).tolist())

    def hardest_at_a_force() -> bool:
        ends = run().network.springs[run().tension[15].argmin()]
        return bool(set(ends.tolist()) & pressed_nodes())

    return {
        "course": lambda page="": _largest_steps(run(page)).tolist(),
        "pulled_across": pulled_across,
        "forces": lambda: len(pressed_nodes()),
        "hardest_at_a_force": hardest_at_a_force,
    }


def _noodle(run: Callable[..., Any]) -> Words:
    def dent(time: float, page: str = "") -> float:
        """Return the largest displacement at a time, in millimetres."""
        return float(1e3 * np.interp(time, run(page).times, _largest_steps(run(page))))

    return {"dent": dent}


def _bridges(run: Callable[..., Any]) -> Words:
    return {
        "compliance": lambda page="", step=-1: float(1e3 * run(page).compliances[step]),  # mJ
        # the first step after which it is so many times as stiff as at the start
        "stiffer": lambda times: int(np.argmax(run().compliances <= run().compliances[0] / times)),
        # the share of the steel, in per cent, that is in cells at least 95 % full
        "full": lambda page="": (
            100 * float(np.average(run(page).cells > 0.95, weights=run(page).cells))
        ),
        # the mean density between the feet, in the middle third of the lowest row
        "tie": lambda page="": float(run(page).density[16:31, 1].mean()),
    }


def _cracks(run: Callable[..., Any]) -> Words:
    def at_the_tip(page: str = "", half: float = 0.02) -> bool:
        """Return whether the first spring broke within two spacings of a tip."""
        network, first = run(page).network, run(page).broken[0]
        place = network.positions[network.springs[first]].mean(axis=0)
        from_middle = np.abs(place - 0.5 * network.positions.max(axis=0))
        return bool(np.linalg.norm(from_middle - [half, 0.0]) < 0.02)

    def x_of(spring: int) -> float:
        """Return how far right the middle of a spring is, in centimetres."""
        return 100.0 * float(run().network.positions[run().network.springs[spring], 0].mean())

    def width() -> float:
        """Return the width of the net, in centimetres."""
        return 100.0 * float(np.ptp(run().network.positions[:, 0]))

    return {
        "at_the_tip": at_the_tip,
        "x_of": x_of,
        "width": width,
        # the largest load for each centimetre of the width that a cut leaves
        "per_cm": lambda page="", cut=4.0: run(page).force.max() / (width() - cut),
        "nets": lambda name="net": [run(f"{name}-{seed}") for seed in (1, 2, 3)],
        # of all that are held only one node, below, does not slide
        "sideways_free": lambda: int(run().network.held[:, 0].sum()) == 1,
        "books": lambda: bool(np.allclose(run().work, run().stored + run().released, rtol=1e-6)),
    }


def _round_hole(run: Callable[..., Any]) -> Words:
    radius, width, pull = 0.01, 0.1, 1e7

    def middle() -> NDArray[Any]:
        return run().lower + 0.5 * run().size[:, None]

    def far() -> float:
        """Return the stress of the agent in the upper right corner, in megapascals."""
        at = np.linalg.norm(middle() - width, axis=1).argmin()
        return float(1e-6 * run().largest_von_mises[at])

    def peak(page: str = "") -> float:
        """Return the largest equivalent stress, in megapascals."""
        return float(1e-6 * run(page).largest_von_mises.max())

    def hoop(page: str = "") -> NDArray[Any]:
        return run(page).outline_stress("hole")[1]

    def at_the_top() -> bool:
        at, stress = run().outline_stress("hole")
        x, y = at[stress.argmax()]
        return bool(x < 0.2 * radius and y > 0.95 * radius)

    return {
        "about": lambda value, wanted: abs(value / wanted - 1.0) < 0.05,
        "far": far,
        "peak": peak,
        "side": lambda page: float(  # of the agent of the peak, in millimetres
            1e3 * run(page).size[run(page).largest_von_mises.argmax()]
        ),
        "hoop": hoop,
        "factor": lambda page="": float(hoop(page).max() / pull),
        "gap": lambda page="": (
            100.0 * float(np.diff(run(page).energy_bounds)[0]) / run(page).strain_energy
        ),
        "near": lambda: 100.0 * float((np.linalg.norm(middle(), axis=1) < 3.0 * radius).mean()),
        "ground": lambda: 0.25 * np.pi * (9 - 1) * radius**2 / width**2,
        "at_the_top": at_the_top,
    }


def _two_answers(run: Callable[..., Any]) -> Words:
    def bounds() -> NDArray[Any]:
        """Return the lower and upper bound of every generation, shape (2, 6)."""
        return np.array([(step.lower, step.upper) for step in run().generations]).T

    def nested() -> bool:
        closer = np.diff(bounds(), axis=1)
        return bool((closer[0] >= 0.0).all() and (closer[1] <= 0.0).all())

    def disagrees_below_the_load() -> bool:
        """Return whether the first agent of the largest gap stands below the load."""
        model = kaju.SpawningModel(run().scene, tolerance=0.005)
        model.step()
        first = model.result()
        x, y = first.middle[first.gap.argmax()]
        return bool(abs(x - 0.1) < 0.02 and y > 0.16)

    def smallest_at_the_ground() -> bool:
        """Return whether all of the smallest agents stand within 1 mm of a lower corner."""
        smallest = run().middle[run().size == run().size.min()]
        away = [np.linalg.norm(smallest - corner, axis=1) for corner in ([0.0, 0.0], [0.2, 0.0])]
        return bool((np.min(away, axis=0) < 0.001).all())

    return {
        "low": lambda step: float(1e9 * bounds()[0, step]),
        "high": lambda step: float(1e9 * bounds()[1, step]),
        "nested": nested,
        "gaps_add_up": lambda: bool(
            abs(run().gap.sum() / np.diff(run().energy_bounds)[0] - 2.0) < 1e-6
        ),
        "disagrees_below_the_load": disagrees_below_the_load,
        "smallest_at_the_ground": smallest_at_the_ground,
    }


RECORDED: dict[str, Callable[[Callable[..., Any]], Words]] = {
    "agents-of-many-sizes": _many_sizes,
    "a-lattice-bends": _lattice,
    "a-noodle-remembers": _noodle,
    "two-wrong-answers": _two_answers,
    "bones-and-bridges": _bridges,
    "how-things-break": _cracks,
    "a-round-hole": _round_hole,
}


@dataclass(frozen=True)
class Claim:
    """A sentence of a lesson, the preset that it is said of, and the expressions that hold it."""

    preset: int
    text: str
    held_by: tuple[str, ...]


def claims(of: Lesson) -> Iterator[Claim]:
    """Return the sentences of a lesson's English text that something holds."""
    for section, text in of.texts["en"].sections.items():
        preset = -1 if section == "Things to try" and of.scenes else 0
        for line in _blocks(section, text):
            preset += line.startswith("### ")
            for sentence in _SENTENCE.findall(line):
                if marks := MARK.findall(sentence):
                    bare = MARK.sub("", sentence).replace("(1 − β)", "").strip()
                    parts = (part.strip() for mark in marks for part in mark[4:-3].split(";"))
                    yield Claim(max(preset, 0), bare, tuple(filter(None, parts)))


def _blocks(section: str, text: str) -> Iterator[str]:
    """Return headings, paragraphs, list items and rows of tables; the worksheet has its fields."""
    if section.startswith("Worksheet"):
        return
    text = re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", FENCE.sub("\n", text))
    text = re.sub(r"^(?:\d+\.|-) ", "\n", text, flags=re.M)
    text = re.sub(r"^\|[ \w%,]*\|.*\n\|---.*$", "", text, flags=re.M)
    text = re.sub(r"^(\||### .*$)", r"\n\1", text, flags=re.M)
    text = re.sub(r"^(### .*)$", r"\1\n", text, flags=re.M)
    for block in re.split(r"\n\s*\n", text):
        if block.strip():
            yield " ".join(block.split())


def words(of: Lesson, preset: int = 0) -> dict[str, Any]:
    """Return the words in which claims and answers of a lesson are written."""
    if of.scenes:  # the rule runs; they are said of one of the presets
        seen = _seen(of.name)
        plane = {word: partial(measure, seen[preset]) for word, measure in PLANE.items()}
        return plane | {"p": seen, "scene": lambda: seen[preset].scene} | ARITHMETIC
    run = partial(lesson_runs.run, of.name)
    generations: Words = {
        "counts": lambda: [step.agents for step in run().generations],
        "errors": lambda name="": [step.error for step in run(name).generations],
    }
    return {"run": run} | generations | RECORDED[of.name](run) | ARITHMETIC


@cache
def _seen(name: str) -> list[Seen]:
    return [Seen(scene) for scene in lesson(name).scenes]


def value(of: Lesson, expression: str, preset: int = 0) -> Any:
    """Return what an expression says: it is the repository's own text."""
    return eval(expression, words(of, preset))  # noqa: S307


def fault(of: Lesson, claim: Claim) -> str | None:
    """Return why a claim is not held, None if it is."""
    found: list[float] = []
    for expression in claim.held_by:
        try:
            got = value(of, expression, claim.preset)
        except Exception as error:  # whatever is wrong with it, the sentence is not held
            return f"{expression}: {error!r}"
        if isinstance(got, (bool, np.bool_)):
            if not got:
                return f"not true: {expression}"
        elif not isinstance(got, str):
            found += _flat(got)
    numbers, settings = NUMBER.findall(claim.text), NUMBER.findall(" ".join(claim.held_by))
    return None if tells(numbers, found, settings) else f"{numbers} do not tell {found}"


def tells(numbers: list[str], values: list[float], settings: list[str]) -> bool:
    """Tell whether numbers are all the values, in their order; settings may stand between."""
    if not numbers:
        return not values
    here, *rest = numbers
    if values and fits(here, values[0]) and tells(rest, values[1:], settings):
        return True
    return here in settings and tells(rest, values, settings)


def _flat(value: Any) -> list[float]:
    return np.ravel(value).astype(float).tolist()


def fits(number: str, value: float) -> bool:
    """Tell whether a written number is a value, rounded to the digits that are given."""
    whole, _, part = number.replace(",", "").partition(".")
    rounded = len(whole) - len(whole.rstrip("0")) if not part and len(whole) > 2 else 0
    step = 10.0 ** (rounded - len(part))
    return abs(float(number.replace(",", "")) - abs(value)) <= 0.5000001 * step


def answers(of: Lesson, question: int) -> list[float]:
    """Return the answers to the fields of a question, worked out."""
    expressions = of.kinds[question].get("answers", [])
    return _flat([value(of, expression) for expression in expressions])
