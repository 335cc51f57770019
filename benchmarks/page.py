"""The page's figures: sizes, first picture, frames, certificate, elastic answer.

Opens exported pages in Debian's chromium, headless and with the network cut off.
Needs `pip install 'kaju[test]'` and chromium. Run:

    python benchmarks/page.py                                # everything, two minutes
    python benchmarks/page.py figures --part certificate     # one part

Times are by the clock: medians where several are taken, the number after ± the largest.
"""

import shutil
import sys
import tempfile
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from statistics import median

import numpy as np
from playwright.sync_api import sync_playwright
from shared import ROOT, by_name, of_tests

from kaju import (
    ElasticModel,
    History,
    LoadModel,
    Scene,
    SpawningModel,
    ThreeElement,
    creep,
    export_page,
)
from kaju.model.network import triangular

sys.path.append(str(ROOT / "docs"))
from make_pages import make

browser_pages = of_tests("browser_pages")
LONG = {"kind": "prescribed", "alpha": [0.5, 0.6, 0.12], "threshold": 1e-5, "accumulate": True}


def plate(cells, rule=None, **body):
    """Return a steel plate that stands on rigid ground and is pressed all along its top."""
    size = {"cell_size": 0.2 / cells, "cells": [cells, cells]}
    return Scene(
        body=size | {"thickness": 0.002, "material": "steel"} | body,
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [0.0, -2.0 * cells]}],
        rule=rule or {"kind": "prescribed"},
    )


def awake(cells):
    """Return the plate under a rule that wakes every agent: nearly all of a load goes ahead."""
    far = {"alpha": [0.5, 0.97, 0.002], "beta": 0.95, "threshold": 1e-3}
    return plate(cells, LONG | far)


def two_materials(cells):
    """Return the plate with a band of rubber: its radius must be iterated for."""
    soft = {"material": "rubber", "box": [[0.0, 0.08], [0.2, 0.12]]}
    rule = LONG | {"materials": {"rubber": {"alpha": [0.3, 0.5, 0.1], "beta": 0.3}}}
    return plate(cells, rule, regions=[soft])


KINDS = {
    "squares": lambda: plate(20),
    "hexagons": lambda: plate(20, lattice="hexagon"),
    "cubes": lambda: Scene(
        body={"size": [0.04] * 3, "cells": [8] * 3, "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"side": "top", "force": [0.0, 0.0, -50.0]}],
    ),
    "elastic agents": lambda: ElasticModel(plate(10, {"kind": "elastic"})).run(),
    "spawning agents": lambda: SpawningModel(plate(20), tolerance=0.1).run(),
    "a network": lambda: triangular(5, force=0.2).load_in_increments(10),
    "creep": lambda: creep(
        triangular(5), History.step().hold(10.0), rheology=ThreeElement(K_f=1.0, D_f=1.0)
    ),
}

FIRST = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
WATCH_INPUT = """globalThis.events = [], new PerformanceObserver((list) => events.push(
  ...list.getEntries().map((event) => event.duration)))
  .observe({ type: "event", durationThreshold: 16 })"""
"""From the key to the next picture that is painted, as the browser itself measures it."""


WINDOW = {"width": 1280, "height": 720}


def frame_times(page, count, act):
    """Do something `count` times, each when the last is painted; return milliseconds."""
    return page.js(
        "await (async () => { const spent = []; const painted = () => new Promise((done) => "
        "requestAnimationFrame(() => setTimeout(done))); "
        f"for (let i = 0; i < {count}; i++) {{ const began = performance.now(); {act}; "
        "await painted(); spent.push(performance.now() - began); } return spent; })()"
    )


class Bench:
    """Exported pages, opened."""

    def __init__(self, browser, folder):
        self.browser, self.folder = browser, folder
        self.pages = {}

    @contextmanager
    def opened(self, of, name):
        """Export a page if there is none of that name yet, and open it."""
        path = self.folder / f"{name}.html"
        if not path.exists():
            export_page(of(), path)
        page = browser_pages.BrowserPage(self.browser, path.as_uri(), viewport=WINDOW, offline=True)
        page.until("page?.drawn > 0")
        try:
            yield page
        finally:
            page.context.close()

    # ---------------------------------------------------------------- one request, no message

    def every_kind(self):
        """Every kind of page: requests but itself, messages, bytes."""
        rows, large = [], 0
        for name, of in KINDS.items():
            with self.opened(of, name) as page:
                page.tab.keyboard.press("End")
                page.tab.keyboard.press("ArrowLeft")
                page.tab.wait_for_timeout(200)
                rows.append((len(page.requests) - 1, len(page.messages)))
            large = max(large, (self.folder / f"{name}.html").stat().st_size)
        more, said = np.sum(rows, axis=0)
        yield f"{len(rows)} kinds of pages: requests but for itself", more, "0"
        yield f"{len(rows)} kinds of pages: messages to the console", said, "0"

    def bytes(self):
        """Bytes of a runnable page, of the lessons' pages, of 60 generations of 50 × 50 cells."""
        runnable = export_page(plate(50), self.folder / "small.html").stat().st_size
        yield "bytes of a runnable page", f"{runnable / 1e3:.0f} kB", "260 kB"
        sizes = [path.stat().st_size / 1e3 for path in make(self.folder / "lessons")[1:]]
        extent = f"{min(sizes):.0f} to {max(sizes):.0f} kB"
        yield f"bytes of the {len(sizes)} pages of lessons", extent, "260 kB"
        rule = {"kind": "prescribed", "threshold": 1e-9, "accumulate": True}
        scene = plate(50, rule).replace(sides={"bottom": "rigid", "left": "rigid"})
        model = LoadModel(scene, allow_unstable=True, engine="arrays", max_generations=60)
        path = export_page(model.run(), self.folder / "recorded.html")
        yield (
            "bytes of 60 recorded generations, 50²",
            f"{path.stat().st_size / 1e6:.2f} MB",
            "1.5 MB",
        )

    # ----------------------------------------------------------------------------- pictures

    def pictures(self):
        """First picture, frames a second, one step back: all agents are awake."""
        for cells, first, least in ((50, 0.5, 50), (200, 0.5, 30)):
            times = []
            for _ in range(7):
                with self.opened(lambda n=cells: awake(n), f"awake {cells}") as page:
                    page.until(FIRST)
                    times.append(page.js(FIRST) / 1e3)
            yield f"first picture, {cells}²", f"{median(times):.2f} s", f"{first} s"
            with self.opened(lambda n=cells: awake(n), f"awake {cells}") as page:
                page.until("page.over")
                assert page.js("page.run.agents") == cells**2
                for word, deformed in (("flat", "false"), ("deformed", "true")):
                    page.js(
                        f"(page.look.deformed = {deformed}, page.look.speed = 60, "
                        "page.seek(page.run.generation >> 1))"
                    )
                    frames = page.js(
                        "await (async () => { page.toggle(true); const from = page.drawn, "
                        "began = performance.now(); await new Promise((d) => setTimeout(d, 3000)); "
                        "page.toggle(false); "
                        "return (page.drawn - from) / (performance.now() - began) * 1000; })()"
                    )
                    yield f"frames a second, {cells}², {word}", f"{frames:.0f}", f"{least}"
                page.js("page.seek(page.run.generation >> 1)")
                back = frame_times(page, 20, "page.seek(page.g - 1)")
                yield f"one step back, {cells}²", median_and_largest(back), "32 ms"

    # -------------------------------------------------------------------------- certificate

    def certificate(self):
        """From a key on the slider to the red that is painted, on 200²."""
        for name, scene in (("one material", plate(200, LONG)), ("two", two_materials(200))):
            with self.opened(lambda scene=scene: scene, f"certificate {name}") as page:
                page.until("page.run.generation > 20")
                page.js(f"({WATCH_INPUT}, 0)")
                page.tab.get_by_role("slider", name="α₂ passed ahead").focus()
                spent = []
                for _ in range(7):
                    page.js("(events.length = 0)")
                    page.tab.keyboard.press("End")
                    page.tab.wait_for_timeout(400)
                    assert page.js("page.parts.verdict.classList.contains('bad')")
                    spent.append(max([16, *page.js("events")]))
                    page.tab.keyboard.press("Home")
                    page.tab.wait_for_timeout(400)
                yield (
                    f"certificate red after the slider, 200², {name}",
                    median_and_largest(spent),
                    "60 ms",
                )

    # ---------------------------------------------------------------------------- elasticity

    def elasticity(self):
        """Ask the page for the elastic answer on 200²; see how long input waits meanwhile."""
        with self.opened(lambda: plate(200), "elastic 200") as page:
            page.until("!page.rest || page.run.atRest")
            seconds, waits = [], []
            for _ in range(5):
                seconds.append(
                    page.js(
                        "await (async () => { page.setMode('body'); page.elastic.answer = null; "
                        "await new Promise((d) => setTimeout(d, 300)); globalThis.gap = 0; "
                        "globalThis.last = performance.now(); "
                        "const beat = setInterval(() => { const now = performance.now(); "
                        "gap = Math.max(gap, now - last); last = now; }, 5); "
                        "const began = performance.now(); page.setMode('twin'); "
                        "while (!page.elastic.answer) await new Promise((d) => setTimeout(d, 5)); "
                        "clearInterval(beat); return (performance.now() - began) / 1000; })()"
                    )
                )
                waits.append(page.js("gap"))
            yield "elastic answer in the page, 200²", f"{median(seconds):.2f} s", "1 s"
            yield (
                "longest time without an answer to input meanwhile",
                median_and_largest(waits),
                "100 ms",
            )


def median_and_largest(milliseconds):
    """Return times as a cell of the table."""
    return f"{median(milliseconds):.0f} ms (at most {max(milliseconds):.0f})"


Part = StrEnum("Part", "every_kind bytes pictures certificate elasticity")


def figures(part: Part | None = None):
    """Yield one part of the figures, or all, as rows of a table."""
    chromium = shutil.which("chromium")
    if chromium is None:
        sys.exit("chromium is not installed (apt-get install chromium)")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as player:
        browser = player.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        bench = Bench(browser, Path(folder))
        yield "| figure | seen | wanted |\n|---|---|---|"
        for name in [part] if part else Part:
            for row in getattr(bench, name)():
                yield f"| {' | '.join(map(str, row))} |"
        browser.close()


if __name__ == "__main__":
    by_name(__doc__, figures)
