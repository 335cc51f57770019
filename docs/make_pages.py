"""Make the lessons' pages: python docs/make_pages.py [FOLDER], docs/pages unless given.

A lesson is a text in docs/lessons; its pages show what the text tells to look at, and try.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from kaju import ElasticRule, History, Scene, SpawningModel, ThreeElement, creep, export_page
from kaju.model.network import triangular

if TYPE_CHECKING:
    from kaju.model.network import NetworkResult
    from kaju.model.results.result import Result
    from kaju.model.rheology.network import NetworkCreepResult

HERE = Path(__file__).parent


def plate(cells: int = 20, pressed: int = 10) -> Scene:
    """Return a steel plate pressed at one cell of its top."""
    return Scene(
        body={"cell_size": 0.01, "cells": [cells, cells], "thickness": 0.002, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [pressed, cells - 1], "force": [0.0, -2.0]}],
        rule=ElasticRule(),
    )


def spawned(scene: Scene, tolerance: float = 0.05) -> Callable[[], Result]:
    """Let agents spawn until the error is below the tolerance."""
    return lambda: SpawningModel(scene, tolerance=tolerance).run()


def pressed(width: int, force: float) -> Callable[[], NetworkResult]:
    """Press a lattice in its middle, in 20 increments."""
    return lambda: triangular(width, force=force).solve(20)


def bitten(damper: float, hold: float) -> Callable[[], NetworkCreepResult]:
    """Bite a noodle, hold it, and let it go."""

    def run() -> NetworkCreepResult:
        history = History().ramp(1.0, duration=1.0).hold(hold).release(duration=1.0).hold(20.0)
        element = ThreeElement(K_f=1.0, D_f=1.0, D_d=damper)
        return creep(triangular(5, force=0.05), history, rheology=element, step=0.25)

    return run


HOLE = plate().with_region(box=[[0.06, 0.06], [0.14, 0.12]])
PAGES: dict[str, dict[str, Callable[[], Result]]] = {
    "agents-of-many-sizes": {
        "": spawned(plate()),
        "rough": spawned(plate(), 0.1),
        "fine": spawned(plate(), 0.025),
        "twice-as-large": spawned(plate(40, 20)),
        "hole": spawned(HOLE),
        "at-the-edge": spawned(plate(pressed=2)),
    },
    "a-lattice-bends": {
        "": pressed(9, 0.1),
        "0.05-N": pressed(9, 0.05),
        "0.2-N": pressed(9, 0.2),
        "5-wide": pressed(5, 0.1),
        "17-wide": pressed(17, 0.1),
    },
    "a-noodle-remembers": {
        "": bitten(20.0, 5.0),
        "2-s": bitten(20.0, 2.0),
        "10-s": bitten(20.0, 10.0),
        "firm": bitten(200.0, 5.0),
    },
}
"""What is shown, by lesson and page; the nameless page is the lesson's own."""


def told(lesson: str) -> tuple[str, str]:
    """Return the headline of a lesson, and what its page says: all but programs and worksheet."""
    text = (HERE / "lessons" / f"{lesson}.md").read_text("utf-8")
    title = text.splitlines()[0].removeprefix("# ")
    body = text.split("\n", 1)[1].split("## Extending it")[0]
    body = re.sub(r"```.*?```\n", "", body, flags=re.S)
    body = re.sub(
        r"^\| (?:try|---).*\n", "", re.sub(r"^\|---.*\n", "", body, flags=re.M), flags=re.M
    )
    body = re.sub(r"^\| (.+?) \| (.+?) \|$", r"- \1: \2", body, flags=re.M)
    body = re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", body)
    return title, re.sub(r"^## ", "# ", body, flags=re.M).strip()


def make(folder: Path) -> list[Path]:
    """Write all pages into a folder; return them."""
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for lesson, pages in PAGES.items():
        title, text = told(lesson)
        for name, run in pages.items():
            headline = f"{title}: {name.replace('-', ' ')}" if name else title
            target = folder / f"{'-'.join(filter(None, (lesson, name)))}.html"
            made.append(export_page(run(), target, title=headline, text=text))
    return made


if __name__ == "__main__":
    import runnable_lessons

    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pages"
    for page in make(folder):
        print(page)
    for lesson in runnable_lessons.lessons():
        print(runnable_lessons.build(lesson, folder))
