"""Lattices of one's own: what follows from three answers, with triangles as the example."""

import numpy as np
import pytest
from plates import loaded, plate
from strategies import Triangles
from transfer_answers import ENGINES

import kaju
from kaju import ElasticModel, ElasticRule, KajuError, Lattice, LoadModel, Material, PrescribedRule
from kaju.errors import SceneError
from kaju.model.network import hexagon_body

STRAIGHT = Material("straight", youngs_modulus=1e9, poissons_ratio=0.0)
DOWN, UP = 4, 1  # 270° and 90°, of 30°, 90° ... 330°


def sheet(cells=(5, 2), force=(0.0, -1.0), cell=(1, 1), rule=None, lattice=Triangles, **parts):
    rule = rule or PrescribedRule((0.5, 0.5, 0.25), 1.0, threshold=0.1)
    parts = {"material": "straight", "materials": {"straight": STRAIGHT}} | parts
    return plate(cells, cell, force, rule=rule, lattice=lattice, **parts)


@ENGINES
def test_a_case_worked_out_by_hand(engine):
    """1 N on a triangle that stands on a side: ½ ahead, ¼ to each side; on a corner: ½ and ½."""
    stage = LoadModel(sheet(), engine=engine).run().last
    told = stage.history
    where = np.column_stack([told.generation, stage.cells[told.agent], told.direction])
    assert dict(zip(map(tuple, where.tolist()), told.load.tolist(), strict=True)) == {
        (1, 1, 1, DOWN): 1.0,
        (2, 1, 0, DOWN): 0.5,
        (2, 0, 1, DOWN): 0.25,
        (2, 2, 1, DOWN): 0.25,
        (3, 0, 0, DOWN): 0.25,
        (3, 2, 0, DOWN): 0.25,
        (3, 1, 1, DOWN): 0.25,  # an eighth from either side
        (3, 0, 1, DOWN): 0.125,  # given back by the free left side
        (3, 3, 1, DOWN): 0.125,
        (4, 0, 0, UP): 0.125,  # given back by the ground
        (4, 2, 0, UP): 0.125,
    }
    assert sorted(stage.boundary_cells.tolist()) == [[-1, 1], [0, -1], [2, -1]]
    assert stage.ledger.imbalance < 1e-15


class OutlinedSquares(Lattice):
    """Squares that say no more than they must."""

    kind = "outlined square"

    def outline(self, form):
        return self.cell_size * np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])

    def centres(self, cells):
        return self.cell_size * (cells + 0.5)


@pytest.mark.parametrize("sense", [False, True])
def test_squares_by_outline_do_what_squares_by_formula_do(sense):
    how = {"rule": PrescribedRule(threshold=1e-3, sense=sense)}
    how["sides"] = {"bottom": "rigid", "left": "roller"}
    loads = [
        {"cell": [3, 4], "force": [0.5, 2.0]},
        {"side": "right", "pressure": 1e4},
        {"cell": [1, 4], "side": "top", "force": [0.0, -1.0]},
    ]
    results = []
    for lattice in ("square", OutlinedSquares):
        drawing = "######\n####.#\n#=####\n##..##\n######"
        scene = loaded(drawing, *loads, lattice=lattice, **how)
        assert scene.applied().force.sum() == pytest.approx(1.5 - 1e4 * 0.05)
        results.append(LoadModel(scene).run())
    formula, outline = results
    order = [np.lexsort(result.last.cells.T) for result in results]
    turned = [1, 3, 0, 2]  # 0°, 90°, 180°, 270° are +x, +y, -x, -y
    for name in ("cells", "spawn_step", "kept", "dropped"):
        ours, theirs = (getattr(r.last, name)[o] for r, o in zip(results, order, strict=True))
        np.testing.assert_allclose(theirs, ours, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        outline.last.taken[order[1]], formula.last.taken[order[0]][:, turned], rtol=1e-12
    )
    np.testing.assert_allclose(
        outline.displacement[order[1]], formula.displacement[order[0]], rtol=1e-9, atol=1e-20
    )


def test_a_lattice_is_stored_by_its_kind_and_read_where_its_class_exists(tmp_path):
    result = LoadModel(sheet()).run()
    again = kaju.load_result(result.save(tmp_path / "run"))
    assert again.scene == result.scene
    assert isinstance(again.scene.lattice, Triangles)
    np.testing.assert_array_equal(again.displacement, result.displacement)
    text = result.scene.to_toml()
    assert 'lattice = "triangle"' in text
    with pytest.raises(SceneError, match=r"no lattice 'triangel' .did you mean 'triangle'.*import"):
        kaju.Scene.from_toml(text.replace("triangle", "triangel"))


def test_what_triangles_cannot_do_is_said():
    scene = sheet()
    elastic = scene.replace(rule=ElasticRule())
    plane = {"region": {"box": [[0, 0.02], [0.03, 0.02]]}, "pressure": 1.0}
    for ask, words in (
        (lambda: kaju.solve(scene), "have a staggered grid, got triangles; take square"),
        (lambda: ElasticModel(elastic), "have a staggered grid, got triangles; take square"),
        (lambda: hexagon_body(scene), "cells of hexagons, got 'triangle'"),
        (lambda: scene.refine(2), "body.lattice: .* got triangles"),
        (lambda: sheet(size=[0.1, 0.1]), "rows of triangles overlap; give cell_size"),
        (lambda: scene.replace(loads=[plane]), "triangles have no faces in a plane; use side"),
    ):
        with pytest.raises(KajuError, match=words):
            ask()


def changed(**answers):
    return type("Changed", (Triangles,), {"kind": "changed", **answers})


def outlined(change):
    return changed(outline=lambda self, form: change(Triangles.outline(self, form), form))


def moved(change):
    return changed(centres=lambda self, cells: change(Triangles.centres(self, cells)))


@pytest.mark.parametrize(("lattice", "words"), [
    (Triangles((3, 3), 0.01), "body.lattice: must be .* or a subclass of kaju.Lattice"),
    (changed(kind="hexagon"), "needs a kind of its own, got 'hexagon'"),
    (Lattice, "Lattice needs centres, outline; see kaju.Lattice"),
    (changed(form=lambda self, cells: cells[:, 0] > 3), "form of Changed: must be whole"),
    (changed(forms=3), r"form of Changed: must give all of \[0, 1, 2\], gives \[0, 1\]"),
    (outlined(lambda o, form: o[::-1]), "outline of Changed: must run counter-clockwise"),
    (outlined(lambda o, form: (1 + form) * o), "outline of Changed: .* one area"),
    (outlined(lambda o, form: o[:, [0, 0, 0]]), "outline of Changed: must be of one shape"),
    (outlined(lambda o, form: o + 0.02), "outline of Changed: must be convex about the cell's"),
    (moved(lambda centres: 1.1 * centres), "centres of Changed: must leave no gaps"),
    (moved(lambda centres: -centres), "centres of Changed: must go right"),
    (
        changed(
            form=lambda self, cells: (cells[:, 0] > 4).astype(int),
            centres=lambda self, cells: Triangles(self.shape, 0.01).centres(cells),
        ),
        "form of Changed: must repeat",
    ),
])  # fmt: skip
def test_a_lattice_that_does_not_fit_together_is_refused(lattice, words):
    with pytest.raises(SceneError, match=words):
        sheet(lattice=lattice)
