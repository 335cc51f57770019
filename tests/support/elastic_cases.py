"""Bodies on the staggered grid for the tests of the elastic solver."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st
from scipy.ndimage import label

from kaju.errors import SupportError
from kaju.model.elastic.equal.grid import problem_of
from kaju.model.elastic.equal.problem import SIDES, CellLoads, rim_layer
from kaju.model.elastic.equal.solver import solve_problem
from kaju.model.elastic.equal.supports import check_supports, slender_cell
from kaju.model.scene.cell_types import AIR, FOUNDATION, RIGID, ROLLER

BEYOND = {
    "free": AIR,
    "rigid": RIGID,
    "roller": ROLLER,
    "foundation": FOUNDATION,
    "displacement": RIGID,
}


def make_problem(kinds, materials, cell_size, *, plane=None, thickness=1.0, sides=None, loads=None):
    """A problem from an array of kinds; sides are words, or words with a number."""
    rim = np.pad(np.asarray(kinds, dtype=np.int32), 1, constant_values=AIR)
    sides = {
        name: (side, None) if isinstance(side, str) else side
        for name, side in (sides or {}).items()
    }
    for name, (word, _) in sides.items():
        rim[rim_layer(rim.ndim, SIDES[rim.ndim].index(name))] = BEYOND[word]
    return problem_of(
        rim,
        materials,
        cell_size,
        plane=plane or ("stress" if rim.ndim == 2 else None),
        thickness=thickness,
        sides={name: side for name, side in sides.items() if side[1] is not None},
        loads=loads,
    )


def press(cells, direction, forces):
    """Loads on cells by a face, one force for all or one each."""
    cells = np.atleast_2d(np.asarray(cells))
    forces = np.broadcast_to(np.asarray(forces, float), cells.shape)
    return CellLoads(cells, np.full(len(cells), direction), np.array(forces))


def plate(n):
    """The worked plate under 2 N over the middle 20 mm of its top."""
    width = n // 10
    first = n // 2 - width // 2
    cells = [[i, n - 1] for i in range(first, first + width)]
    return make_problem(
        np.zeros((n, n), int),
        [(206e9, 0.3)],
        0.2 / n,
        plane="stress",
        thickness=2e-3,
        sides={"bottom": "rigid"},
        loads=press(cells, 3, [0.0, -2.0 / width]),
    )


def cube(n, poissons_ratio=0.3):
    """The unit cube, clamped below, under 1 N on the patch [3/8, 5/8]² of its top."""
    a, b = 3 * n // 8, 5 * n // 8
    cells = [[i, j, n - 1] for i in range(a, b) for j in range(a, b)]
    return make_problem(
        np.zeros((n, n, n), int),
        [(1.0, poissons_ratio)],
        1.0 / n,
        sides={"bottom": "rigid"},
        loads=press(cells, 5, [0.0, 0.0, -1.0 / len(cells)]),
    )


def pixel_body(name, n):
    """A square body with holes, inclusions or layers, clamped below, pressed in the middle."""
    kinds = np.zeros((n, n), int)
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    x, y = (i + 0.5) / n - 0.5, (j + 0.5) / n - 0.5
    word, _, number = name.partition(" ")
    value = float(number or 1.0)
    if word == "hole":
        kinds[x**2 + y**2 <= 0.04] = -1
    elif word == "square-hole":
        kinds[(abs(x) < 1 / 6) & (abs(y) < 1 / 6)] = -1
    elif word == "frame":
        kinds[(abs(i - n / 2 + 0.5) < n / 2 - 3) & (abs(j - n / 2 + 0.5) < n / 2 - 3)] = -1
    elif word == "comb":
        kinds[(j >= n // 4) & ((i // 4) % 2 == 1)] = -1
    second = {
        "top": y > 0,
        "bottom": y < 0,
        "inclusion": (abs(x + 0.05) < 1 / 8) & (abs(y) < 1 / 8),
        "checkers": (i // 3 + j // 3) % 2 == 0,
    }.get(word)
    if second is not None:
        kinds[second] = 1
    ratio = value if word in ("strain", "ratio") else 0.3
    top = [[k, n - 1] for k in range(n // 2 - 2, n // 2 + 2)]
    if word == "comb":
        top = [[k, n - 1] for k in range(n) if (k // 4) % 2 == 0]
    return make_problem(
        kinds,
        [(1.0, ratio), (value if second is not None else 1.0, 0.3)],
        1.0 / n,
        plane="strain" if word == "strain" else "stress",
        sides={"bottom": "rigid"},
        loads=press(top, 3, [0.0, -1.0 / len(top)]),
    )


@dataclass
class Body:
    """A random body and random loads on its surface and inside, ready to be changed."""

    kinds: Any
    materials: list
    sides: dict
    loads: CellLoads | None
    plane: str | None
    cell_size: float = 1.0
    thickness: float = 1.0

    def problem(self, loads=None):
        return make_problem(
            self.kinds,
            self.materials,
            self.cell_size,
            plane=self.plane,
            thickness=self.thickness,
            sides=self.sides,
            loads=self.loads if loads is None else loads,
        )

    def solve(self, loads=None):
        """Return displacements in metres, the problem and the solution."""
        problem = self.problem(loads)
        solution = solve_problem(problem, 1e-13)
        assert solution.converged
        unit = problem.scales.displacement
        return [unit * u for u in solution.displacement], problem, solution


@st.composite
def bodies(draw, dimension=None):
    """Pixel bodies of up to three materials that hold together, standing on the ground."""
    d = dimension or draw(st.sampled_from([2, 2, 3]))
    shape = [draw(st.integers(3, 9 if d == 2 else 5)) for _ in range(d)]
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    coarse = rng.choice([-1, 0, 0, 0, 1, 2], size=shape)
    kinds = np.kron(coarse, np.ones((2,) * d, dtype=coarse.dtype))
    contrast = 10.0 ** rng.uniform(-3, 3, size=2)
    ratios = rng.uniform(-0.5, 0.44, size=3)
    materials = list(zip([1.0, *contrast], ratios, strict=True))
    sides = {"bottom": "rigid"}
    for name in ("left", "right"):
        sides[name] = draw(st.sampled_from(["free", "free", "roller", ("foundation", 0.3)]))
    parts, _ = label(kinds >= 0)
    ground = np.unique(parts[..., 0])
    kinds[(parts == 0) | ~np.isin(parts, ground)] = -1
    plane = draw(st.sampled_from(["stress", "strain"]))
    body = Body(kinds, materials, sides, None, plane if d == 2 else None)
    assume((kinds >= 0).sum() > 4)
    body.loads = random_loads(body, rng)
    assume(body.loads is not None)
    try:
        problem = body.problem()
        check_supports(problem)
    except SupportError:
        assume(False)
    assume(slender_cell(problem) is None)
    return body, rng


def random_loads(body, rng, count=4):
    """Forces on free faces of the body, and in the middle of cells."""
    kinds = np.pad(body.kinds, 1, constant_values=-1)
    d = body.kinds.ndim
    held = {name for name, side in body.sides.items() if side != "free"}
    names = SIDES[d]
    places = []
    for cell in np.argwhere(body.kinds >= 0):
        for face in range(2 * d):
            beyond = cell.copy()
            beyond[face // 2] += 2 * (face % 2) - 1
            outside = beyond[face // 2] in (-1, body.kinds.shape[face // 2])
            if kinds[tuple(beyond + 1)] == -1 and not (outside and names[face] in held):
                places.append((*cell, face))
        places.append((*cell, -1))
    chosen = np.array(places)[rng.integers(len(places), size=count)]
    return CellLoads(chosen[:, :d], chosen[:, d], rng.normal(size=(count, d)))
