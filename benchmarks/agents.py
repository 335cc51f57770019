"""Agents of kaju against the same rule written by hand: a plain Mesa model, and plain NumPy rows.

    python benchmarks/agents.py           # some two minutes
    python benchmarks/agents.py 20 100    # squares of so many cells a side only

Processor time, constructing and result included, the smallest of several runs that take turns in
one process. Both answers of a case must have as many agents and take the same load. The plain
programs write no ledger, no history and no certificate.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import mesa
import numpy as np
from mesa.discrete_space import CellAgent, OrthogonalVonNeumannGrid
from shared import in_turn

from kaju import LoadModel, MaterialAgent, PrescribedRule, Scene

Loads = list[tuple[tuple[int, int], int, float]]  # Cell, direction and size (N) of each
Answer = tuple[int, float]  # Agents that woke, and the load they took (N)

GAMMA = 1e-6
OWN, AHEAD, BESIDE, OUTWARDS = 0.5, 0.5, 0.25, 0.5 * 0.3 * 0.5
STEPS = ((-1, 0), (1, 0), (0, -1), (0, 1))
OPPOSITE, ACROSS = (1, 0, 3, 2), ((2, 3), (2, 3), (0, 1), (0, 1))
DOWN = 2


# The same rule as a plain Mesa model.


class PlainCell(CellAgent):
    """Takes loads, keeps half, and sends the rest to its neighbours."""

    def __init__(self, model: PlainModel, cell: Any) -> None:
        super().__init__(model)
        self.cell = cell
        self.inbox: dict[tuple[int, float], int] = {}
        self.taken = [0.0, 0.0, 0.0, 0.0]
        self.kept = 0.0

    def step(self) -> None:
        """Pass on what has arrived."""
        inbox, self.inbox = self.inbox, {}
        send = self.model.send
        for (direction, size), copies in inbox.items():
            self.taken[direction] += size * copies
            self.kept += OWN * size * copies
            send(self, direction, direction, AHEAD * size, copies)
            for side in ACROSS[direction]:
                send(self, side, direction, BESIDE * size, copies)
                send(self, side, side, OUTWARDS * size, copies)


class PlainWall(mesa.Agent):
    """Gives back what reaches it: reversed below the plate, as it is elsewhere."""

    def __init__(self, model: PlainModel, rigid: bool) -> None:
        super().__init__(model)
        self.rigid, self.inbox, self.returned = rigid, [], 0.0

    def step(self) -> None:
        """Give everything back."""
        inbox, self.inbox = self.inbox, []
        for cell, direction, size, copies in inbox:
            self.returned += size * copies
            self.model.arrive(cell, OPPOSITE[direction] if self.rigid else direction, size, copies)


class PlainModel(mesa.Model):
    """A square plate of agents."""

    def __init__(self, cells: int, loads: Loads) -> None:
        super().__init__(rng=0)
        self.cells = cells
        self.grid = OrthogonalVonNeumannGrid((cells, cells), torus=False, random=self.random)
        self.awake: dict[tuple[int, int], PlainCell] = {}
        self.walls: dict[tuple[int, int], PlainWall] = {}
        self.waiting: dict[tuple[int, int], dict[tuple[int, float], int]] = {}
        self.busy: dict[PlainWall, None] = {}
        for cell, direction, size in loads:
            self.arrive(cell, direction, size, 1)

    def arrive(self, cell: tuple[int, int], direction: int, size: float, copies: int) -> None:
        """Put a load above γ where the cell's agent finds it in the next step."""
        if size > GAMMA:
            box = self.waiting.setdefault(cell, {})
            key = (direction, round(size, 12))
            box[key] = box.get(key, 0) + copies

    def send(self, agent: PlainCell, arm: int, direction: int, size: float, copies: int) -> None:
        """Bring a load to the neighbour over an arm."""
        if size <= GAMMA:
            return
        (x, y), (dx, dy) = agent.cell.coordinate, STEPS[arm]
        there = (x + dx, y + dy)
        if 0 <= there[0] < self.cells and 0 <= there[1] < self.cells:
            self.arrive(there, direction, size, copies)
            return
        wall = self.walls.get(there)
        if wall is None:
            wall = self.walls[there] = PlainWall(self, rigid=there[1] < 0)
        wall.inbox.append(((x, y), direction, size, copies))
        self.busy[wall] = None

    def step(self) -> None:
        """Let all act for whom loads wait."""
        waiting, self.waiting = self.waiting, {}
        for cell, inbox in waiting.items():
            agent = self.awake.get(cell)
            if agent is None:
                agent = self.awake[cell] = PlainCell(self, self.grid[cell])
            agent.inbox = inbox
            agent.step()
        walls, self.busy = self.busy, {}
        for wall in walls:
            wall.step()


def plain_model(cells: int, loads: Loads) -> Answer:
    """Run a square plate of plain agents to its end."""
    model = PlainModel(cells, loads)
    while model.waiting:
        model.step()
    return len(model.awake), sum(sum(agent.taken) for agent in model.awake.values())


# The same rule as rows of NumPy arrays.


def plain_rows(cells: int, loads: Loads) -> Answer:
    """Run a square plate; a row is a cell, a direction, a size and so many copies."""
    dx, dy = np.array(STEPS).T
    opposite, across = np.array(OPPOSITE), np.array(ACROSS)
    cell = np.array([x * cells + y for (x, y), _, _ in loads])
    direction = np.array([d for _, d, _ in loads])
    size, copies = np.array([s for _, _, s in loads]), np.ones(len(loads))
    taken, woken = np.zeros((4, cells * cells)), np.zeros(cells * cells, dtype=bool)
    while len(size):
        sizes, number = np.unique(np.round(size, 12), return_inverse=True)
        code = (cell * 4 + direction) * len(sizes) + number
        different, which = np.unique(code, return_inverse=True)
        copies = np.bincount(which, copies, minlength=len(different))
        where, number = np.divmod(different, len(sizes))
        cell, direction = np.divmod(where, 4)
        size = sizes[number]
        woken[cell] = True
        np.add.at(taken, (direction, cell), size * copies)
        one, other = across[direction].T
        arm = np.concatenate([direction, one, one, other, other])
        along = np.concatenate([direction, direction, one, direction, other])
        passed = (AHEAD, BESIDE, OUTWARDS, BESIDE, OUTWARDS)
        sent = np.concatenate([share * size for share in passed])
        sender, count = np.tile(cell, 5), np.tile(copies, 5)
        loud = sent > GAMMA
        arm, along, sent, sender, count = (c[loud] for c in (arm, along, sent, sender, count))
        x, y = sender // cells + dx[arm], sender % cells + dy[arm]
        inside = (x >= 0) & (x < cells) & (y >= 0) & (y < cells)
        out = ~inside
        turned = np.where(y[out] < 0, opposite[along[out]], along[out])
        cell = np.concatenate([(x * cells + y)[inside], sender[out]])
        direction = np.concatenate([along[inside], turned])
        size = np.concatenate([sent[inside], sent[out]])
        copies = np.concatenate([count[inside], count[out]])
    return int(woken.sum()), float(taken.sum())


# The cases.


class Own(MaterialAgent):
    """Does what all do, in methods of its own."""

    def take(self, load: Any) -> None:
        """Count the loads."""
        super().take(load)
        self.loads = getattr(self, "loads", 0) + 1

    def emissions(self, load: Any) -> Any:
        """Send what all send."""
        return super().emissions(load)


METAL = {"metal": {"youngs_modulus": 2.1e11, "poissons_ratio": 0.3}}


def square(cells: int) -> tuple[Scene, Loads]:
    """Return a plate under 2 N on a tenth of its top, and the loads for the plain programs."""
    first, count = int(0.45 * cells), max(1, round(0.1 * cells))
    pressed, each = range(first, first + count), 2.0 / count
    scene = Scene(
        body={"cell_size": 0.01, "cells": [cells, cells], "material": "metal"},
        materials=METAL,
        sides={"bottom": "rigid"},
        loads=[{"cell": [x, cells - 1], "force": [0.0, -each]} for x in pressed],
        rule=PrescribedRule(threshold=GAMMA),
    )
    return scene, [((x, cells - 1), DOWN, each) for x in pressed]


def of_kaju(scene: Scene, **how: Any) -> Answer:
    """Run kaju."""
    result = LoadModel(scene, **how).run(progress=False)
    acted = result.last.spawn_step <= result.last.generations
    return int(acted.sum()), result.last.ledger.taken


def beside(case: str, ours: Callable[[], Answer], theirs: Callable[[], Answer], runs: int) -> str:
    """Return the processor times of two programs, whose answers must agree."""
    ((agents, taken), own), ((others, also), other) = in_turn(runs, ours, theirs)
    assert agents == others, f"{agents} agents beside {others}"
    assert abs(taken - also) <= 1e-6 * also, f"{taken} N beside {also} N"
    return f"{case:44} {own:9.4f} s {other:9.4f} s {own / other:6.2f} x"


def squares(sides: list[int]) -> Iterator[str]:
    """Compare plates of so many cells a side."""
    for cells in sides:
        scene, loads = square(cells)
        runs = 15 if cells <= 100 else 5 if cells <= 300 else 3
        by_hand, rows = partial(plain_model, cells, loads), partial(plain_rows, cells, loads)
        objects = partial(of_kaju, scene, engine="agents")
        yield beside(f"{cells}², objects / plain Mesa", objects, by_hand, min(runs, 7))
        if cells == 100:
            own = partial(objects, material_agent=Own)
            yield beside(f"{cells}², own take and emissions / plain Mesa", own, by_hand, 7)
        arrays = partial(of_kaju, scene, engine="arrays")
        yield beside(f"{cells}², arrays / plain NumPy", arrays, rows, runs)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cells", nargs="*", type=int, help="along a side; 20 100 300 1000 of none")
    for line in squares(parser.parse_args().cells or [20, 100, 300, 1000]):
        print(line, flush=True)
