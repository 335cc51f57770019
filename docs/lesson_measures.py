"""What can be seen in a lesson's runs: the words in which its claims and answers are written.

Where the rule runs these are the methods of `Seen`: ``cut(3)`` is the force through the third
row, ``p[1].cut(3)`` that of the second preset. Rows count from the top, from 1; cells are
(column, row) from the lower left; forces are in newtons, widths in cells, displacements in
nanometres. Of recorded lessons, `recorded` has the words.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property, partial
from itertools import pairwise
from math import ceil, log, sqrt
from typing import Any

import lesson_runs
import numpy as np
from numpy.typing import NDArray

import kaju
from kaju.model.network import triangular

DOWN = 2
"""Place of the downward direction among the four of a square cell."""


class Seen:
    """A plane scene of squares under a load from above, run and solved as far as somebody looks."""

    def __init__(self, scene: kaju.Scene) -> None:
        self.scene = scene

    @cached_property
    def certificate(self) -> Any:
        """Return what is known before the run."""
        return kaju.stability(self.scene)

    @cached_property
    def run(self) -> kaju.TransferResult:
        """Return the answer of the rule."""
        return kaju.LoadModel(self.scene, engine="arrays").run()

    @cached_property
    def elastic(self) -> Any:
        """Return the answer of elasticity on the same cells."""
        return kaju.solve(self.scene, strategy="uniform")

    def with_(self, **rule: Any) -> Seen:
        """Return the same body with other numbers of its rule."""
        return Seen(self.scene.with_overrides({f"rule.{k}": v for k, v in rule.items()}))

    def put_on(self) -> float:
        """Return force that presses on the body (N)."""
        return float(np.abs(self.scene.applied().force[:, 1].sum()))

    def cells(self) -> int:
        """Return cells of the body that are no air."""
        return int((self.scene.rasterise() >= 0).sum())

    def stable(self) -> bool:
        """Return whether every load ends."""
        return self.certificate.stable

    def verdict(self) -> str:
        """Return the sentence of the certificate."""
        return self.certificate.verdict

    def radius(self) -> float:
        """Return how many times more load there is after a generation, at most."""
        return self.certificate.upper

    def generations(self) -> int:
        """Return generations until all is at rest."""
        return self.run.last.generations

    def agents(self) -> int:
        """Return agents that have woken in the end."""
        return len(self.run.last.cells)

    def woken(self, generation: int) -> list[int]:
        """Return the agents of each row that are awake after a generation."""
        stage = self.run.last
        return self._rows(stage.cells[stage.spawn_step <= generation])

    def rows(self) -> list[int]:
        """Return the agents of each row, from the top."""
        return self._rows(self.run.last.cells)

    def _rows(self, cells: NDArray[Any]) -> list[int]:
        return [int(n) for n in np.bincount(self._top - cells[:, 1])] if len(cells) else []

    @property
    def _top(self) -> int:
        return int(self.scene.lattice.shape[1]) - 1

    def depth(self) -> int:
        """Return rows that a load reached."""
        return len(self.rows())

    def narrows(self) -> bool:
        """Return whether no row has more agents than the row above it."""
        rows = self.rows()
        return all(below <= above for above, below in pairwise(rows))

    def _load(self, generation: int) -> tuple[int, float, bool]:
        """Return where the only load of a generation is taken: row, size, whether it pulls."""
        history = self.run.last.history
        (row,) = np.flatnonzero(history.generation == generation)
        place = int(self.run.last.cells[history.agent[row], 1])
        return place, float(history.load[row]), bool(history.pull[row])

    def load_at(self, generation: int) -> int:
        """Return row, from the ground, in which the only load of a generation is taken."""
        return self._load(generation)[0]

    def load_in(self, generation: int) -> float:
        """Return size of the only load of a generation (N)."""
        return self._load(generation)[1]

    def pull_in(self, generation: int) -> bool:
        """Return whether the only load of a generation is a pull."""
        return self._load(generation)[2]

    def first_red(self) -> float:
        """Return smallest share ahead, in hundredths, with which loads do not die out."""
        keep, _, aside = self.scene.rule.alpha
        steps = (n / 100 for n in range(100))
        return next(a for a in steps if not self.with_(alpha=(keep, a, aside)).stable())

    def derived(self) -> list[float]:
        """Return what an elastic agent hands on: ahead, back, and to two sides."""
        shares = kaju.ElasticRule().shares(self.scene.cell_materials[0], 2)
        return [shares.forward, shares.backward, shares.friction, shares.friction]

    def pulls(self) -> bool:
        """Return whether any load pulls."""
        return bool(self.run.last.pulled.any())

    def first_pull(self) -> int:
        """Return generation in which a pull is taken first."""
        history = self.run.last.history
        return int(history.generation[history.pull].min())

    def tip(self) -> int:
        """Return which way the loaded cell moves: 1 up, -1 down."""
        return int(np.sign(self.tip_moves()))

    def tip_moves(self) -> float:
        """Return displacement of the loaded cell (nm), upwards."""
        top = self.scene.applied().cells[:1]
        return float(1e9 * self.run.displacement_at(self.scene.lattice.centres(top))[0, 1])

    def _moves(self, result: Any, *cell: int) -> float:
        moved = result.displacement_at(self.scene.lattice.centres(np.array([cell])))
        return float(1e9 * np.linalg.norm(moved))

    def moved(self, column: int, row: int) -> float:
        """Return how far a cell moves by the rule."""
        return self._moves(self.run, column, row)

    def elastic_moved(self, column: int, row: int) -> float:
        """Return how far a cell moves in elasticity."""
        return self._moves(self.elastic, column, row)

    def doubles_in_elasticity(self) -> bool:
        """Return whether half of the load moves all cells half as far in elasticity."""
        force = self.scene.applied().force[0]
        half = Seen(self.scene.with_overrides({"loads.0.force": (0.5 * force).tolist()}))
        centres = self.scene.lattice.centres(self.run.last.cells)
        whole, halved = (s.elastic.displacement_at(centres) for s in (self, half))
        return bool(np.allclose(whole, 2.0 * halved, rtol=1e-9, atol=0.0))

    def _grid(self, values: NDArray[Any]) -> NDArray[Any]:
        grid = np.zeros(self.scene.lattice.shape)
        grid[tuple(self.run.last.cells.T)] = values
        return grid

    def taken(self, column: int, row: int) -> float:
        """Return load that a cell has taken in all (N)."""
        return float(self._grid(self.run.last.taken.sum(axis=1))[column, row])

    def kept(self, column: int, row: int) -> float:
        """Return what of it the cell keeps along the vertical (N)."""
        return float(self._grid(self.run.last.kept[:, 1])[column, row])

    def shadow(self) -> float:
        """Return downward load in the middle of the bottom row over that row's mean."""
        row = self._grid(self.run.last.taken[:, DOWN] - self.run.last.pulled[:, DOWN])[:, 0]
        return float(row[len(row) // 2] / row.mean()) if row.any() else 0.0

    def even_ground(self) -> bool:
        """Return whether no cell of the bottom row takes 3 % more or less than that row's mean."""
        row = self._grid(self.run.last.taken.sum(axis=1))[:, 0]
        return bool((np.abs(row / row.mean() - 1.0) < 0.03).all())

    def largest(self) -> float:
        """Return largest load taken by an agent (N)."""
        return float(self.run.last.taken.sum(axis=1).max(initial=0.0))

    def largest_at(self) -> list[int]:
        """Return the cell of the largest load taken."""
        stage = self.run.last
        return [int(i) for i in stage.cells[stage.taken.sum(axis=1).argmax()]]

    def returned(self) -> float:
        """Return what air and walls have given back in all (N)."""
        return float(self.run.last.returned.sum())

    def at_ground(self) -> float:
        """Return what has been handed to the ground (N)."""
        return float(self.run.reactions.get("bottom", [0.0, 0.0])[1])

    def ground_share(self) -> float:
        """Return what has been handed to the ground, as a share of what was put on."""
        return self.at_ground() / float(-self.scene.applied().force[:, 1].sum())

    def _profile(self, result: Any, row: int) -> NDArray[Any]:
        """Return the squeeze (Pa, pressing is positive) of each cell of a row."""
        columns = np.arange(self.scene.lattice.shape[0])
        cells = np.stack([columns, np.full_like(columns, self._top + 1 - row)], axis=1)
        inside = self.scene.kinds(cells) >= 0
        squeeze = np.zeros(len(cells))
        squeeze[inside] = -result.stress_at(self.scene.lattice.centres(cells[inside]))[:, 1, 1]
        return squeeze

    def cuts(self) -> list[float]:
        """Return the forces (N) through all rows by the rule, from the top."""
        return [round(force, 6) for force in self.run.cuts("y").carried[::-1].tolist()]

    def elastic_cuts(self) -> list[float]:
        """Return the same by elasticity."""
        return [float(force) for force in self.elastic.cuts("y").carried[::-1]]

    def cut(self, row: int) -> float:
        """Return force (N) through a row by the rule."""
        return self.cuts()[row - 1]

    def elastic_cut(self, row: int) -> float:
        """Return the same by elasticity."""
        return self.elastic_cuts()[row - 1]

    def elastic_cuts_kept(self) -> bool:
        """Return whether every cut carries the load by elasticity, to a billionth."""
        return bool(np.allclose(self.elastic_cuts(), self.put_on(), rtol=1e-9, atol=0.0))

    def half_width(self, row: int) -> float:
        """Return where the squeeze of a row has fallen to half of its largest, in cells (rule)."""
        return half_width(self._profile(self.run, row))

    def elastic_half_width(self, row: int) -> float:
        """Return the same by elasticity."""
        return half_width(self._profile(self.elastic, row))

    def straight(self, rows: list[int], root: bool = False, elastic: bool = False) -> float:
        """Return how straight half widths lie over the depth, or over its root: 1 is a line."""
        depth = np.array(rows) - 0.5
        found = [self.elastic_half_width(r) if elastic else self.half_width(r) for r in rows]
        return float(np.corrcoef(np.sqrt(depth) if root else depth, found)[0, 1])

    def widening(self) -> float:
        """Return standard width of the downward loads in row 33 over that in row 9."""
        down = self._grid(self.run.last.taken[:, DOWN] - self.run.last.pulled[:, DOWN])
        return _spread(down[:, self._top - 32]) / _spread(down[:, self._top - 8])

    def misfit(self) -> float:
        """Return distance of the displacement from elasticity's: 1 is no better than nothing."""
        return float(kaju.compare(self.run, self.elastic).displacement.misfit)


def half_width(profile: NDArray[Any]) -> float:
    """Return the distance (cells) at which a profile falls to half of its largest value.

    Between cells it is a straight line; both sides are averaged; infinite if it never falls.
    """
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


def _spread(load: NDArray[Any]) -> float:
    place = np.arange(len(load))
    middle = (load * place).sum() / load.sum()
    return float(np.sqrt((load * (place - middle) ** 2).sum() / load.sum()))


def words_of(seen: list[Seen], preset: int = 0) -> dict[str, Any]:
    """Return the words for a lesson in which the rule runs, said of one of its presets."""
    told = [name for name, of in vars(Seen).items() if name[0] != "_" and callable(of)]
    words = {name: getattr(seen[preset], name) for name in told}
    return words | {"p": seen, "scene": lambda: seen[preset].scene} | ARITHMETIC


ARITHMETIC = {"log": log, "sqrt": sqrt, "ceil": ceil}
"""What every lesson may reckon with."""


def recorded(name: str) -> dict[str, Any]:
    """Return the words for a lesson whose pages show recorded runs."""
    run = partial(lesson_runs.run, name)
    return {"run": run} | RECORDED[name](run) | ARITHMETIC


def _many_sizes(run: Callable[..., Any]) -> dict[str, Any]:
    def size_near(x: float, y: float, page: str = "") -> float:
        away = np.abs(run(page).middle - [x, y]).max(axis=1) - 0.5 * run(page).size
        return float(run(page).size[away <= away.min() + 1e-9].min())

    def near(distance: float) -> Any:
        return np.linalg.norm(run().middle - [0.105, 0.2], axis=1) < distance

    @cache
    def course() -> list[tuple[int, float]]:
        return [(step.agents, step.error) for step in run().generations]

    return {
        "size_near": size_near,
        "near_share": lambda distance: float(near(distance).mean()),
        "near_area": lambda distance: float((run().size[near(distance)] ** 2).sum() / 0.2**2),
        "counts": lambda: [agents for agents, _ in course()],
        "errors": lambda: [error for _, error in course()],
    }


def _lattice(run: Callable[..., Any]) -> dict[str, Any]:
    def course(page: str = "") -> list[float]:
        size = np.linalg.norm(run(page).displacement, axis=2).max(axis=1)
        return [float(step) for step in size]

    def buckles_at(width: int, force: float) -> float:
        try:
            kaju.solve(triangular(width, force=force))
        except kaju.KajuError as error:
            return float(str(error).split()[2])
        return 1.0

    def pulled_across(number: int) -> bool:
        result = run()
        most = np.argsort(result.tension[-1])[-number:]
        ends = result.network.positions[result.network.springs[most]]
        return bool(np.allclose(ends[:, 0, 1], ends[:, 1, 1]))

    def pressed_nodes() -> set[int]:
        force = np.linalg.norm(run().network.force_at(1.0), axis=1)
        return set(np.flatnonzero(force).tolist())

    def hardest_at_a_force() -> bool:
        ends = run().network.springs[run().tension[-1].argmin()]
        return bool(set(ends.tolist()) & pressed_nodes())

    return {
        "course": course,
        "gives": lambda page="": float(run(page).largest_displacement()[1]),
        "pressed": lambda: int((run().tension[-1] < 0.0).sum()),
        "pulled": lambda: int((run().tension[-1] > 0.0).sum()),
        "buckles_at": buckles_at,
        "pulled_across": pulled_across,
        "forces": lambda: len(pressed_nodes()),
        "hardest_at_a_force": hardest_at_a_force,
    }


def _noodle(run: Callable[..., Any]) -> dict[str, Any]:
    def dent(time: float, page: str = "") -> float:
        """Return the largest displacement at a time, in millimetres."""
        size = np.linalg.norm(run(page).displacement, axis=2).max(axis=1)
        return float(1e3 * np.interp(time, run(page).times, size))

    return {"dent": dent}


def _bridges(run: Callable[..., Any]) -> dict[str, Any]:
    def compliance(page: str = "", step: int = -1) -> float:
        """Return the compliance after a step, in millijoules."""
        return float(1e3 * run(page).compliances[step])

    def tie(page: str = "") -> float:
        """Return the mean density between the feet, in the middle third of the lowest row."""
        return float(run(page).density[16:31, 1].mean())

    return {
        "compliance": compliance,
        "tie": tie,
        "top": lambda x, page="": float(run(page).density[x, -1]),
        "filled": lambda page="": 100.0 * float(run(page).volumes[-1]),
        "steps": lambda page="": run(page).steps,
    }


def _cracks(run: Callable[..., Any]) -> dict[str, Any]:
    def at_the_tip(page: str = "", half: float = 0.02) -> bool:
        """Return whether the first spring broke within two spacings of a tip."""
        result = run(page)
        nodes = result.network.positions
        place = nodes[result.network.springs[result.broken[0]]].mean(axis=0)
        from_middle = np.abs(place - 0.5 * nodes.max(axis=0))
        return bool(np.linalg.norm(from_middle - [half, 0.0]) < 0.02)

    return {
        "at_the_tip": at_the_tip,
        "nodes": lambda: len(run().network.positions),
        "bears": lambda page="": float(run(page).force.max()),
        "strong": lambda: float(run().strengths.mean()),
        "breaks": lambda page="": run(page).breaks,
        "before": lambda page="": int(np.argmax(run(page).force)),
        "first": lambda page="": float(run(page).force[0]),
        "largest": lambda page="": int(run(page).avalanche_sizes.max()),
        "books": lambda: bool(np.allclose(run().work, run().stored + run().released, rtol=1e-6)),
        "left": lambda page="": float(run(page).stored[-1]),
    }


def _round_hole(run: Callable[..., Any]) -> dict[str, Any]:
    radius, width, pull = 0.01, 0.1, 1e7

    def middle(page: str = "") -> NDArray[Any]:
        return run(page).lower + 0.5 * run(page).size[:, None]

    def far() -> float:
        """Return the stress of the agent in the upper right corner, in megapascals."""
        at = np.linalg.norm(middle() - width, axis=1).argmin()
        return float(1e-6 * run().von_mises[at])

    def peak(page: str = "") -> float:
        """Return the largest equivalent stress, in megapascals."""
        return float(1e-6 * run(page).von_mises.max())

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
        "factor": lambda page="": float(hoop(page).max() / pull),
        "formula": lambda across=1.0: 1.0 + 2.0 * across,
        "share": lambda: radius / width,
        "gap": lambda page="": (
            100.0 * float(np.diff(run(page).energy_bounds)[0]) / run(page).strain_energy
        ),
        "agents": lambda page="": run(page).agents,
        "pressed": lambda: float(hoop().min()),
        "near": lambda: 100.0 * float((np.linalg.norm(middle(), axis=1) < 3.0 * radius).mean()),
        "ground": lambda: 0.25 * np.pi * (9 - 1) * radius**2 / width**2,
        "cells": lambda: run("steps").scene.lattice.shape[0],
        "rising": lambda: bool(
            (np.diff([peak(f"steps{n}") for n in ("-20", "", "-80", "-160")]) > 2.0).all()
        ),
        "at_the_top": at_the_top,
    }


def _two_answers(run: Callable[..., Any]) -> dict[str, Any]:
    @cache
    def answer(cells: int) -> Any:
        return run(f"{cells}")

    def widths() -> list[float]:
        pairs = (answer(n).energy_bounds for n in (10, 20, 40, 80))
        return [upper - lower for lower, upper in pairs]

    def nested() -> bool:
        lower, upper = zip(*(answer(n).energy_bounds for n in (10, 20, 40, 80)), strict=True)
        return list(lower) == sorted(lower) and list(upper) == sorted(upper, reverse=True)

    def corner() -> list[float]:
        return [run(f"corner-{n}").error_bound for n in (16, 32, 64)]

    def bar_is_exact() -> bool:
        lower, upper = run("bar").energy_bounds
        return bool(upper - lower < 1e-6 * lower)

    return {
        "low": lambda cells: 1e9 * answer(cells).energy_bounds[0],
        "high": lambda cells: 1e9 * answer(cells).energy_bounds[1],
        "error": lambda cells: answer(cells).error_bound,
        "widths": widths,
        "nested": nested,
        "corner": corner,
        "bar_is_exact": bar_is_exact,
    }


RECORDED = {
    "agents-of-many-sizes": _many_sizes,
    "a-lattice-bends": _lattice,
    "a-noodle-remembers": _noodle,
    "two-wrong-answers": _two_answers,
    "bones-and-bridges": _bridges,
    "how-things-break": _cracks,
    "a-round-hole": _round_hole,
}
"""Words of the lessons that show recorded runs."""
