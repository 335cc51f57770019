"""Draw the pictures that README.md and the pages of docs/ show, and the table of comparison.md.

The photograph of the page needs Debian's chromium.
"""

from __future__ import annotations

import argparse
import doctest
import itertools
import re
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from lesson_runs import broad
from matplotlib.figure import Figure
from playwright.sync_api import sync_playwright

import kaju
from kaju.model.study.rule_study import RuleStudy, beside_elasticity
from kaju.view.comparison import COLOURS, pictures_beside
from kaju.view.style import LINE, new_figure, save

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples"


def main() -> None:
    """Write all pictures into docs/pictures."""
    folder = HERE / "pictures"
    folder.mkdir(exist_ok=True)
    plate = kaju.LoadModel(kaju.load_scene(EXAMPLES / "plate.toml")).run()
    kaju.animate(plate, folder / "spawning.gif")
    rule = kaju.ElasticRule(threshold=0.02, order="multilevel")
    run = kaju.ElasticModel(kaju.load_scene(EXAMPLES / "plate.toml").replace(rule=rule)).run()
    kaju.plot(run, "left", moment=8).savefig(folder / "elastic_agents.png", dpi=80)
    jelly = kaju.creep(kaju.load_scene(EXAMPLES / "jelly.toml"))
    kaju.plot(jelly, "curves").savefig(folder / "jelly_curves.png", dpi=90)
    square = kaju.solve(broad(20, 0.01), tolerance=0.005)
    kaju.animate(square, folder / "agents_spawn.gif", "generations", fps=1.5)
    cube = kaju.solve(kaju.load_scene(EXAMPLES / "cube.toml"), tolerance=0.12)
    kaju.plot(cube, "agents").savefig(folder / "agents_octree.png", dpi=110)
    lug = kaju.solve(kaju.load_scene(EXAMPLES / "lug.toml"), tolerance=0.05)
    kaju.plot(lug, "von_mises").savefig(folder / "lug.png", dpi=90)
    _tutorials(folder)
    _bracket().savefig(folder / "bracket.png", dpi=110)
    _stability().savefig(folder / "stability_map.png", dpi=100)
    study = beside_elasticity(kaju.load_scene(EXAMPLES / "plate.toml"), evaluations=600)
    for name, figure in pictures_beside(study).items():
        save(figure, folder / f"comparison_{name}.png")
    _table(study)
    _photograph(folder / "page.png")


def _tutorials(folder: Path) -> None:
    """Draw what two tutorials plot, by the programs that stand in them."""
    for name in ("own-agent", "tolerance"):
        page = HERE / "tutorials" / f"{name}.md"
        told = doctest.DocTestParser().get_doctest(page.read_text(), {}, name, str(page), 0)
        doctest.DocTestRunner().run(told, clear_globs=False)
        told.globs["figure"].savefig(folder / f"{name.replace('-', '_')}.png", dpi=90)


def _table(study: RuleStudy) -> None:
    """Write the table of comparison.md, and what the fit found."""
    assert study.fit
    rows = [
        f"| {name} | {u.max_error:.1%} | {u.l2_error:.1%} | {u.misfit:.4f} "
        f"| {stress.misfit:.4f} | {found.energy_error:.4f} |"
        for name, found in study.comparisons.items()
        if (u := found.displacement) and (stress := found.stress)
    ]
    alpha = ", ".join(f"{share:.4g}" for share in study.fit.rule.alpha or ())
    told = "\n".join([*rows, "", f"The fit found α = ({alpha}), β = {study.fit.rule.beta:.4g}."])
    page = HERE / "comparison.md"
    rest = r"\| prescribed rule \|.*?The fit found [^\n]*"
    page.write_text(re.sub(rest, lambda _: told, page.read_text(), flags=re.DOTALL))


def _photograph(target: Path) -> None:
    """Take a picture of the page that `kaju demo` writes."""
    if (chromium := shutil.which("chromium")) is None:
        sys.exit("chromium is not installed (apt-get install chromium)")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as player:
        scene = kaju.load_scene(EXAMPLES / "plate.toml", {"loads.0.steps": 1})
        page_file = kaju.export_page(scene, f"{folder}/plate.html", title="A plate under load")
        options = ["--no-sandbox", "--disable-gpu"]
        browser = player.chromium.launch(executable_path=chromium, args=options)
        tab = browser.new_page(viewport={"width": 1280, "height": 720})
        tab.goto(page_file.as_uri())
        tab.wait_for_timeout(1000)
        tab.screenshot(path=target)
        browser.close()


def _bracket() -> Figure:
    """Draw how bounds close in on the energy as agents spawn."""
    figure = new_figure((5.4, 3.6))
    ax = figure.subplots()
    answers = [kaju.solve(broad(20, 0.01), tolerance=most) for most in (0.1, 0.025, 0.01, 0.005)]
    agents = [answer.agents for answer in answers]
    lower, upper = 1e9 * np.array([answer.energy_bounds for answer in answers]).T
    ax.fill_between(agents, lower, upper, color=COLOURS[1], alpha=0.25, lw=0)
    for edge in (lower, upper):
        ax.plot(agents, edge, color=COLOURS[1], marker=".", lw=1.2)
    ax.set_xlabel("agents", fontsize=9)
    ax.set_ylabel("energy (nJ): the true one lies in the band", fontsize=9)
    ax.tick_params(labelsize=8)
    ax.grid(color=LINE, lw=0.4)
    return figure


def _stability() -> Figure:
    """Draw which coefficients let loads end in runs, beside the limit of the certificate."""
    figure = new_figure((4.6, 3.6))
    ax = figure.subplots()
    changes: dict[str, Any] = {"body.cells": [9, 9], "loads.0": {"cell": [4, 8], "force": [0, -1]}}
    plate = kaju.load_scene(EXAMPLES / "plate.toml", changes)
    for ahead, friction in itertools.product(range(10), repeat=2):
        rule = kaju.PrescribedRule((0.5, ahead / 10, friction / 20), 0.5, accumulate=True)
        run = kaju.LoadModel(plate.replace(rule=rule), allow_unstable=True, threshold=1e-6).run()
        mark = "C0o" if run.last.outcome.startswith("at rest") else "C3x"
        ax.plot(ahead / 10, friction / 20, mark, ms=5)
    ax.plot([0, 0.85], [0.425, 0], "k", lw=1.2)  # β = 0.5 and ν = 0.3 take 0.15 off
    ax.set(xlabel="ahead α₂", ylabel="friction α₃")
    return figure


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
