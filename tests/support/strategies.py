"""Random scenes for the prescribed rule, as Hypothesis strategies."""

import runpy
from pathlib import Path

from hypothesis import strategies as st

from kaju import Coefficients, PrescribedRule, Scene

EXAMPLES = Path(__file__).parents[2] / "examples"
Triangles = runpy.run_path(str(EXAMPLES / "triangles" / "triangles.py"))["Triangles"]

share = st.floats(0.0, 0.6)
either = st.booleans()
coefficients = st.builds(
    Coefficients, alpha=st.none() | st.tuples(share, share, share), beta=st.floats(0.0, 1.0)
)
LEGEND = {"a": "steel", "b": "rubber", ".": "air", "=": "rigid"}


@st.composite
def rules(draw, senses=either):
    alpha = draw(st.none() | st.tuples(share, share, share))
    materials = draw(st.dictionaries(st.sampled_from(["steel", "rubber"]), coefficients))
    return PrescribedRule(
        alpha=alpha,
        beta=draw(st.floats(0.0, 1.0)),
        threshold=draw(st.floats(1e-3, 1.0)),
        accumulate=draw(st.booleans()),
        materials=materials,
        sense=draw(senses),
    )


@st.composite
def scenes(draw, rule=None, senses=either):
    """Small drawn bodies of three lattices, 1×N among them, pressed on at random."""
    columns, rows = draw(st.integers(1, 7)), draw(st.integers(1, 6))
    letters = st.text("aaaab.=", min_size=columns, max_size=columns)
    drawing = draw(st.lists(letters, min_size=rows, max_size=rows))
    body_cells = [
        [column, rows - 1 - row]
        for row, line in enumerate(drawing)
        for column, letter in enumerate(line)
        if letter in "ab"
    ]
    if not body_cells:
        drawing[0] = "a" + drawing[0][1:]
        body_cells = [[0, rows - 1]]
    force = st.floats(-5.0, 5.0)
    sense = st.sampled_from(["push", "pull", None])
    loads = [
        {
            "cell": draw(st.sampled_from(body_cells)),
            "force": [draw(force), draw(force) or -1.0],
            "sense": draw(sense),
        }
        for _ in range(draw(st.integers(1, 3)))
    ]
    held = st.sampled_from(["free", "rigid", "roller"])
    return Scene(
        body={
            "cell_size": 0.01,
            "thickness": 0.002,
            "drawing": "\n".join(drawing),
            "lattice": draw(st.sampled_from(["square", "hexagon", Triangles])),
            "allow_floating": True,
        },
        legend=LEGEND,
        sides={side: draw(held) for side in ("left", "right", "bottom", "top")},
        loads=loads,
        rule=draw(rules(senses)) if rule is None else rule,
    )
