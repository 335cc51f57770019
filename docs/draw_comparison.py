"""Draw and count the comparison of comparison.md, and write its table: agents against elements.

The worked plate (examples/plate.toml, load on one cell), with agents of the prescribed rule,
of the same rule with fitted coefficients, and of the elastic rule. The finite elements were
of order 4, graded to every corner (tests/exact/graded_elements.py). Run it with

    python docs/draw_comparison.py
"""

from __future__ import annotations

import re
from pathlib import Path

from kaju import load_scene
from kaju.agents.elastic_rule import ElasticRule
from kaju.model.elastic.relaxation.elastic_model import ElasticModel
from kaju.model.study.compare import Comparison, compare
from kaju.model.study.fitting import Fit, fit_rule
from kaju.model.study.reference import Reference
from kaju.model.transfer.load_model import LoadModel
from kaju.view.comparison import Line, plot_maps, plot_profiles, plot_shapes, plot_stress_ratio
from kaju.view.picture_files import save

ROOT = Path(__file__).parent.parent
PICTURES = Path(__file__).parent / "pictures"
DATA = ROOT / "tests" / "data"
BELIEVED = "finite elements"
STRESS = r"$\sigma_{yy}$"


def answers() -> tuple[dict[str, Comparison], Fit]:
    """Return the three kinds of agents, compared with finite elements."""
    reference = Reference.load(DATA / "plate_finite_elements.npz")
    scene = load_scene(ROOT / "examples" / "plate.toml").with_overrides({"loads.0.steps": 1})
    fit = fit_rule(scene, reference)
    elastic = ElasticModel(scene.replace(rule=ElasticRule(tolerance=1e-6)), engine="arrays").run()
    found = {
        "prescribed rule": LoadModel(scene).run(),
        "prescribed rule, fitted": LoadModel(scene.replace(rule=fit.rule)).run(),
        "elastic rule": elastic.result,
    }
    return {name: compare(result, reference) for name, result in found.items()}, fit


def draw(found: dict[str, Comparison]) -> list[Path]:
    """Write the four figures of the comparison."""
    corners = Reference.load(DATA / "plate_finite_elements_corners.npz")
    column = Line("depth under the load", (0.105, 0.2), (0.105, 0.0))
    row = Line("x, 5 mm below the top", (0.0, 0.195), (0.2, 0.195))
    pressure = 2.0 / (0.01 * 0.002)
    figures = {
        "stress_ratio": plot_stress_ratio(found, column, "y", pressure, believed=BELIEVED),
        "stress": plot_maps(found, "stress", "yy", believed=BELIEVED, symbol=STRESS),
        "deformed": plot_shapes(
            {name: comparison.result for name, comparison in found.items()}, corners, name=BELIEVED
        ),
        "displacement": plot_profiles(
            found, [column, row], "displacement", "y", believed=BELIEVED, symbol=r"$u_y$"
        ),
    }
    return [save(figure, PICTURES / f"comparison_{name}.png") for name, figure in figures.items()]


def table(found: dict[str, Comparison], fit: Fit) -> str:
    """Return the table of the page, and what the fit found."""
    lines = [
        "| agents | largest error of u | r.m.s. | misfit of u | misfit of σ | energy norm |",
        "|---|---|---|---|---|---|",
    ]
    for name, comparison in found.items():
        u, stress = comparison.displacement, comparison.stress
        assert stress is not None
        assert comparison.energy_error is not None
        lines.append(
            f"| {name} | {u.max_error:.1%} | {u.l2_error:.1%} | {u.misfit:.4f} "
            f"| {stress.misfit:.4f} | {comparison.energy_error:.4f} |"
        )
    alpha = ", ".join(f"{share:.4g}" for share in fit.rule.alpha or ())
    return "\n".join([*lines, "", f"The fit found α = ({alpha}), β = {fit.rule.beta:.4g}."])


def main() -> None:
    """Write the table of the page, and draw its pictures."""
    PICTURES.mkdir(exist_ok=True)
    found, fit = answers()
    written = table(found, fit)
    print(written)
    page = Path(__file__).with_name("comparison.md")
    text, count = re.subn(
        r"\| agents \|.*?The fit found [^\n]*", lambda _: written, page.read_text(), flags=re.DOTALL
    )
    assert count == 1
    page.write_text(text)
    for path in draw(found):
        print(path)


if __name__ == "__main__":
    main()
