"""A stress that balances does as much work on any displacement without gaps as the loads do."""

from itertools import pairwise, product

import numpy as np
import pytest
from exact.graded_elements import graded_elements
from plates import plate as pressed
from spawning_bodies import STEEL, drawn

from kaju import solve
from kaju.model.elastic.bounds import admissible_displacement as admissible
from kaju.model.elastic.bounds.admissible_displacement import AdmissibleDisplacement
from kaju.model.elastic.bounds.admissible_stress import AdmissibleStress
from kaju.model.elastic.bounds.bound_cells import corner_ends
from kaju.model.elastic.bounds.bounds_of_arrays import boxes_of_cells
from kaju.model.elastic.bounds.bounds_of_leaves import boxes_of_agents
from kaju.model.elastic.bounds.energy_bounds import bracket_of, stress_of
from kaju.model.elastic.bounds.equilibration import equilibrate
from kaju.model.elastic.equal.staggered import strain_energy

SOFT = {"youngs_modulus": 2e9, "poissons_ratio": 0.2}
INNER = [
    {"cell": [1, 1], "side": "top", "force": [0.0, -30.0]},
    {"cell": [2, 1], "side": "right", "force": [7.0, 3.0]},
    {"region": {"box": [[0.0, 0.0], [0.2, 0.2]]}, "force": [1.0, 2.0]},
]
DRAGGED = [{"region": {"box": [[0.0, 0.2], [0.1, 0.2]]}, "force": [20.0, -50.0]}]


def body(rows, loads, sides):
    return drawn(rows, [STEEL, SOFT], loads, sides=sides, cell_size=0.05)


def work_of(stress, field):
    """Add up the work of the tractions on all sides of every box, and of the forces within."""
    boxes, d = stress.boxes, stress.boxes.dimension
    everyone = np.arange(len(boxes.size))
    normal = np.zeros(boxes.beside.shape)
    found = equilibrate(boxes, stress.normal, normal, normal, np.ones(len(everyone), bool), np.inf)
    traction = found.traction
    for side, value in enumerate(stress.normal):
        traction[:, side, :, side // 2, 0] = value[:, None]
    traction[stress.irregular.box] = stress.irregular.traction

    def moved(place):
        return field.displacement_at(everyone, np.tile(place, (len(everyone), 1)))

    # Two points of Gauss on every half are exact for linear tractions and quadratics.
    halves, points = corner_ends(d - 1), 0.5 + np.array([-1, 1]) / np.sqrt(12)
    total = 0.0
    for end in corner_ends(d):
        for point in product(points, repeat=d):
            body = moved(0.5 * (end + point)) * boxes.body.T
            total += float((body * boxes.size[:, None] ** d).sum()) / 4**d
    for side, (part, end), point in product(
        range(2 * d), enumerate(halves), product(points, repeat=d - 1)
    ):
        axis, upper = divmod(side, 2)
        modes = np.array([1.0, *(np.array(point) - 0.5)])
        work = moved(np.insert(0.5 * (end + point), axis, upper)) * (
            traction[:, side, part] @ modes
        )
        area = boxes.size[:, None] ** (d - 1) / 4 ** (d - 1)
        total += (2 * upper - 1) * float((work * area).sum())
    return total


def assert_same_work(result, times, share, left=np.inf):
    """A stress that balances does the work of the loads on random displacements without gaps."""
    spawning = result.found.tree
    boxes = boxes_of_agents(spawning.balance, spawning.displacement)
    stress, field = AdmissibleStress(boxes), AdmissibleDisplacement(boxes)
    assert stress.left < left
    rng = np.random.default_rng(0)
    for _ in range(times):
        field.displacement = rng.normal(size=field.displacement.shape)
        field.hold()
        own = work_of(stress, field)
        size = np.abs(field.displacement).max() * np.abs(boxes.loads.force).sum()
        assert own == pytest.approx(field.work(), abs=share * size)


@pytest.mark.parametrize("how", [{"strategy": "uniform", "resolution": 2}, {"tolerance": 0.15}])
@pytest.mark.parametrize(
    ("loads", "sides"),
    [(INNER, {"bottom": "rigid"}), (DRAGGED, {"left": "rigid", "bottom": "roller"})],
)
@pytest.mark.parametrize(
    "rows", [["aa..", "aa..", "aaaa", "aaaa"], ["bb..", "ab..", "aabb", "b.aa"], ["aaaa"] * 4]
)
def test_the_work_of_a_stress_that_balances_is_that_of_the_loads(rows, loads, sides, how):
    result = solve(body(rows, loads, sides), **({"strategy": "spawning"} | how))
    assert_same_work(result, times=3, share=1e-8)


@pytest.mark.parametrize("how", [{"strategy": "uniform"}])
@pytest.mark.parametrize("sides", [{"bottom": "rigid"}, {"bottom": "roller", "left": "rigid"}])
@pytest.mark.parametrize(
    "rows",
    [
        [["aa", "aa"], ["a.", "ba"]],  # re-entrant edges that meet, and two materials
        [["aa", "aa"], ["aa", "aa"]],
    ],
)
def test_in_solids_that_work_is_the_same(rows, sides, how):
    codes = np.array([[[".ab".index(k) for k in row] for row in layer] for layer in rows])
    loads = [
        {"cell": [0, 1, 0 if codes[1, 1, 0] == 0 else 1], "side": "top", "force": [7, 3, -9]},
        {"cell": [0, 0, 0], "side": "right", "force": [0.0, 2.0, 1.0]},
        {"cell": [1, 1, 0], "force": [1.0, 2.0, -3.0]},
    ]
    result = solve(body(codes.transpose(2, 1, 0), loads, sides), **({"strategy": "spawning"} | how))
    assert ("tolerance" in how) == (len(np.unique(result.size)) > 1)
    assert_same_work(result, times=1, share=1e-10, left=1e-7)


def solid(n, codes):
    """Return a cube of 0.2 m, `n` cells a side, of pixels."""
    cells = codes.repeat(n // len(codes), 0).repeat(n // len(codes), 1).repeat(n // len(codes), 2)
    load = {"region": {"box": [[0.0, 0.0, 0.2], [0.1, 0.1, 0.2]]}, "force": [0, 0, -9.0]}
    return drawn(cells, [STEEL], [load], cell_size=0.2 / n)


def test_a_long_edge_has_the_bounds_of_a_plane_corner():
    rows = ["aa..", "aa..", "aaaa", "aaaa"]
    load = {"region": {"box": [[0.0, 0.2], [0.1, 0.2]]}, "force": [0.0, -50.0]}
    flat = drawn(rows, [STEEL], [load], cell_size=0.05, plane="strain", thickness=0.05)
    codes = np.ones((4, 1, 4), dtype=int)
    codes[2:, :, 2:] = 0
    load = {"region": {"box": [[0, 0, 0.2], [0.1, 0.05, 0.2]]}, "force": [0, 0, -50.0]}
    sides = {"bottom": "rigid", "front": "roller", "back": "roller"}
    long = drawn(codes, [STEEL], [load], cell_size=0.05, sides=sides)
    (low, high), (below, above) = (
        solve(scene, strategy="uniform", resolution=4).energy_bounds for scene in (flat, long)
    )
    # In the plane fields may bend more, on both sides of the truth.
    assert 0.98 * low < below < low
    assert high < above < 1.03 * high


@pytest.mark.parametrize("missing", [[(1, 1, 1)], [(0, 1, 1), (1, 1, 0)], [(1, 1, 1), (1, 0, 1)]])
def test_bounds_of_solids_with_re_entrant_edges_lie_within_each_other(missing):
    codes = np.ones((2, 2, 2), dtype=int)
    for cell in missing:
        codes[cell] = 0
    bounds = [solve(solid(n, codes), strategy="uniform").energy_bounds for n in (4, 8, 16)]
    for (low, high), (below, above) in pairwise(bounds):
        assert low < below < above < high
    assert bounds[-1][1] < 1.25 * bounds[-1][0]


@pytest.mark.parametrize("dimension", [2, 3])
def test_forces_of_linear_fields_are_the_same_in_a_compiled_loop(dimension, monkeypatch):
    monkeypatch.setattr(admissible, "MOST_QUADRATIC", 0)
    tree = in_cells(dimension).tree
    boxes = boxes_of_agents(tree.balance, tree.displacement)
    plain = AdmissibleDisplacement(boxes)
    monkeypatch.setattr(admissible, "FEW", 0)
    compiled = AdmissibleDisplacement(boxes)
    assert plain._moduli is None
    assert compiled._moduli is not None
    v = np.random.default_rng(dimension).normal(size=plain.displacement.shape)
    force = plain.force(v)
    np.testing.assert_allclose(compiled.force(v), force, rtol=0, atol=1e-13 * np.abs(force).max())


def test_forces_do_the_work_of_the_strains():
    """Twice the energy, by points of Gauss that are exact for all fields."""
    dimension = 2
    found = in_cells(dimension, strategy="spawning", tolerance=0.02)
    boxes = boxes_of_agents(found.balance, found.displacement)
    assert len(boxes.mesh.slave)
    field = AdmissibleDisplacement(boxes)
    rng = np.random.default_rng(dimension)
    field.displacement = rng.normal(size=field.displacement.shape)
    field._straighten(field.displacement)
    everyone, total = np.arange(len(boxes.size)), 0.0
    line, weights = np.polynomial.legendre.leggauss(3)
    for end, k in product(corner_ends(dimension), product(range(3), repeat=dimension)):
        inside = np.tile(0.5 * (end + 0.5 * (line[list(k)] + 1.0)), (len(everyone), 1))
        strain = field.strain_at(everyone, inside)
        square = np.einsum("nab,nab->n", stress_of(boxes.law, strain), strain)
        total += np.prod(weights[list(k)]) / 4**dimension * (square @ boxes.size**dimension)
    beds = 0.0
    for bed in boxes.beds:
        axis, upper = divmod(bed.side, 2)
        for end, k in product(corner_ends(dimension - 1), product(range(3), repeat=dimension - 1)):
            place = np.insert(0.5 * (end + 0.5 * (line[list(k)] + 1.0)), axis, upper)
            moved = field.displacement_at(bed.box, np.tile(place, (len(bed.box), 1)))[:, axis]
            area = np.prod(weights[list(k)]) / 4 ** (dimension - 1) * boxes.size[bed.box]
            beds += area @ (bed.stiffness * moved**2 * boxes.size[bed.box] ** (dimension - 2))
    work = float((field.force(field.displacement) * field.displacement).sum())
    assert work == pytest.approx(total + beds, rel=1e-12)
    assert 2.0 * field.energies().sum() == pytest.approx(total, rel=1e-12)


def test_what_an_iteration_has_left_belongs_to_the_bound():
    """An answer that has hardly settled: its bound holds, and is hardly worse."""
    grid = solid(8, np.ones((2, 2, 2), dtype=int))
    exact = solve(grid, strategy="uniform").found
    for share in (1e-2, 1e-4):
        rng = np.random.default_rng(1)
        off = tuple(rng.normal(size=u.shape) * (u != 0) for u in exact.solution.displacement)
        size = np.sqrt(strain_energy(exact.problem, off) / exact.solution.energy)
        u = tuple(
            u + share / size * w for u, w in zip(exact.solution.displacement, off, strict=True)
        )
        found = bracket_of(boxes_of_cells(exact.problem, u, share, exact.grid, None))
        assert found.lower <= exact.bracket.upper <= found.upper
        assert exact.bracket.error <= found.error < exact.bracket.error + 4 * share


def test_what_is_left_far_from_any_wall_is_passed_on_until_it_comes_to_one():
    """Stresses a little too large: only the wall at the other end can bear the rest."""
    bar = body(["a" * 40] * 2, [{"side": "right", "pressure": -1e3}], {"left": "rigid"})
    exact = solve(bar, resolution=1, strategy="uniform").found
    boxes = boxes_of_cells(exact.problem, exact.solution.displacement, 0.0, exact.grid, None)
    boxes.sigma[:] *= 1.0 + 1e-5
    stress = AdmissibleStress(boxes)
    assert stress.left < 1e-9
    assert len(stress.irregular.box) == 80


def rubber(rows, ratio):
    gum = {"youngs_modulus": 1e6, "poissons_ratio": ratio}
    described = {"cell_size": 0.05, "plane": "strain", "thickness": 0.01}
    sides = {"bottom": "rigid", "left": "roller"}
    return drawn(rows, [gum, SOFT], [*DRAGGED, INNER[2]], sides=sides, **described)


@pytest.mark.parametrize(
    "rows", [["aa..", "aa..", "aaaa", "aaaa"], ["aaaa", "aaaa", "abaa", "aaaa"]]
)
def test_what_keeps_its_volume_does_not_lock(rows):
    bounds = []
    for ratio in (0.3, 0.4999):
        scene = rubber(rows, ratio)
        truth = graded_elements(scene, order=3, levels=10).strain_energy
        result = solve(scene, strategy="uniform", resolution=8)
        lower, upper = result.energy_bounds
        assert 0.9 * truth < lower < truth < upper
        spawned = solve(scene, tolerance=0.06)
        assert spawned.tolerance_kept == "proved"
        assert spawned.energy_bounds[0] < truth < spawned.energy_bounds[1]
        bounds.append(result.error_bound)
    assert bounds[1] < 3.3 * bounds[0]


def test_shares_of_boxes_add_up_to_what_lies_between_the_bounds():
    plate = pressed([8, 8], [4, 7], side="top", size=[0.08, 0.08])
    bounds = solve(plate).found.bracket
    # The energies differ by half the squared distance.
    assert 0.5 * bounds.shares.sum() == pytest.approx(bounds.upper - bounds.lower, rel=0.05)
    assert (bounds.shares > 0.0).all()


def in_cells(dimension, missing=(), **how):
    """Return the answer of a body of two materials, pressed and dragged, on a roller and a bed."""
    n = 12 if dimension == 2 else 6
    codes, middle = np.ones((n,) * dimension, dtype=int), [n // 4] * (dimension - 1)
    codes[(slice(n // 3, n // 2),) * dimension] = 2
    for place in missing:
        codes[place] = 0
    down = [0.0 * k for k in middle] + [-2.0]
    sides = {"bottom": "rigid", "left": "roller", "right": {"stiffness": 1e10}}
    loads = [
        {"cell": [*middle, n - 1], "side": "top", "force": [1.0, *down[1:]]},
        {"cell": [*middle, n - 3], "force": down},
    ]
    scene = drawn(codes, [STEEL, SOFT], loads, sides=sides)
    exact = {"strategy": "uniform", "resolution": 1, "tolerance": 1e-12}
    return solve(scene, **(how or exact)).found


@pytest.mark.parametrize(
    ("dimension", "missing"),
    [
        (2, []),
        (2, [np.s_[6:, 7:]]),  # a re-entrant corner
        (2, [np.s_[2:4, 6:8], np.s_[4:6, 8:10]]),  # two holes that touch at a corner
        (3, []),
        (3, [np.s_[3:, 3:, 4:]]),
    ],
)
def test_equal_cells_are_told_as_agents_of_one_size_are(dimension, missing):
    found = in_cells(dimension, missing)
    cells = boxes_of_cells(found.problem, found.solution.displacement, 0.0, found.grid, None)
    spawning, order = found.tree, found._in_tree
    agents = boxes_of_agents(spawning.balance, spawning.displacement)
    unit = found.scales.displacement / found.tree.scales.displacement
    scale = found.scales.force / found.tree.scales.force
    told = [
        (unit * cells.sigma, agents.sigma), (unit * cells.moved, agents.moved),
        *((unit * tau, agents.shear[pair]) for pair, tau in cells.shear.items()),
        (scale * cells.body, agents.body), *zip(cells.law, agents.law, strict=True),
    ]  # fmt: skip
    for own, other in told:
        np.testing.assert_allclose(own, other[..., order], atol=1e-9 * np.abs(own).max())
    for own, other in ((cells.kind, agents.kind), (cells.uneven, agents.uneven)):
        np.testing.assert_array_equal(own, other[..., order])
    for own, other in ((cells.held, agents.held), (cells.beds, agents.beds)):
        sides = [(one.side, *(sorted(box.tolist()) for box in [one.box])) for one in own]
        place = np.argsort(order)
        assert sides == [(one.side, sorted(place[one.box].tolist())) for one in other]
    assert np.abs(cells.rest).max() < 1e-9 * cells.largest
    one, two = bracket_of(cells), found.tree.bracket
    assert one.error == pytest.approx(two.error, rel=0.02)
    assert one.lower == pytest.approx(two.lower / (scale * unit), rel=0.01)
