"""Agents, boundaries and the cells that they deform, on bodies worked out by hand."""

import numpy as np
import pytest
from page_scenes import Leaky
from plates import loaded, plate
from transfer_answers import of_cells

from kaju import LoadModel, Material, PrescribedRule, RigidBoundaryAgent

LEFT, RIGHT, DOWN, UP = range(4)


def row_of(letters, sides, rule, cell=(1, 0), force=(-2.0, 0.0), **own):
    load = {"cell": cell, "force": force}
    return LoadModel(loaded(letters, load, sides=sides, rule=rule, allow_floating=True), **own)


STRAIGHT = PrescribedRule(alpha=(0.5, 0.5, 0.0), beta=1.0, threshold=0.3)


def agent_at(model, column, row=0):
    return next(agent for agent in model.agents if agent.index == (column, row))


def test_a_row_step_by_step():
    model = row_of("##", {"left": "rigid"}, STRAIGHT)
    assert agent_at(model, 1).inbox == {(LEFT, 2.0, "push"): 1.0}
    model.step()
    pressed = agent_at(model, 1)
    assert (pressed.taken, pressed.kept, pressed.passed) == ({LEFT: 2.0}, 1.0, {LEFT: 1.0})
    assert pressed.woken_by == []
    woken = agent_at(model, 0)
    assert woken.spawn_step == 2
    assert woken.woken_by == [pressed]
    model.step()
    wall = agent_at(model, -1)
    assert isinstance(wall, RigidBoundaryAgent)
    assert wall.returned == 0.5
    assert woken.inbox == {(RIGHT, 0.5, "push"): 1.0}, "the wall pushes back"
    model.step()
    assert woken.taken == {LEFT: 1.0, RIGHT: 0.5}
    assert woken.dropped == 0.25
    assert not model.running
    handed = row_of("##", {"left": "rigid"}, STRAIGHT, material_agent=Leaky)
    handed.step()
    assert agent_at(handed, 0).woken_by == [agent_at(handed, 1)], "by `hand_over`, too"


def test_a_roller_lets_slide_what_runs_along_it():
    rule = PrescribedRule(alpha=(0.5, 0.0, 0.3), beta=1.0, threshold=0.3)
    smooth = row_of("##", {"bottom": "roller"}, rule, cell=(0, 0))
    rough = row_of("##", {"bottom": "rigid"}, rule, cell=(0, 0))
    for model in (smooth, rough):
        model.step()
    assert agent_at(smooth, 0).inbox == {(LEFT, 0.6, "push"): 2.0}, "from above and from below"
    assert agent_at(rough, 0).inbox == {(LEFT, 0.6, "push"): 1.0, (RIGHT, 0.6, "push"): 1.0}


def test_air_and_ground_inside_the_array_are_boundaries_too():
    stage = row_of(".#=", {}, STRAIGHT, force=(2.0, 0.0)).run().last
    assert stage.boundary_cells.tolist() == [[2, 0], [0, 0]]
    assert stage.boundary_spawn_step.tolist() == [2, 3]


H, T, E, NU = 0.01, 0.002, 1e9, 0.25
JELLY = Material("jelly", E, NU)
OF = {"cell_size": H, "thickness": T, "material": "jelly", "materials": {"jelly": JELLY}}
ALONE = PrescribedRule(alpha=(0.5, 0.5, 0.0), beta=1.0, threshold=0.01)
KEPT = PrescribedRule(alpha=(0.5, 0.0, 0.0), beta=1.0)


def column(sides, row=4, rows=5, force=(0.0, -2.0), rule=ALONE):
    scene = plate([1, rows], [0, row], force, sides=sides, rule=rule, allow_floating=True, **OF)
    return LoadModel(scene).run()


def by_row(result):
    order = np.argsort(result.last.cells[:, 1])
    return result.displacement[order], result.strain[order], result.stress[order]


def test_a_cell_is_squeezed_by_its_own_share():
    result = column({"bottom": "rigid"}, rows=40, row=39)
    _, strain, stress = by_row(result)
    own = 0.5 * 2.0  # N, kept by the top cell
    assert stress[-1, 1, 1] == pytest.approx(-own / (H * T))
    assert strain[-1, 1, 1] == pytest.approx(-own / (H * T * E))
    assert strain[-1, 0, 0] == pytest.approx(NU * own / (H * T * E))
    assert stress[-1, 0, 0] == 0.0


@pytest.mark.parametrize("held", [("bottom",), ("top",), ("top", "bottom"), ()])
def test_displacements_are_summed_from_what_holds_the_line(held):
    displacement, strain, _ = by_row(column(dict.fromkeys(held, "rigid")))
    elongation = H * strain[:, 1, 1]
    if len(held) == 2:
        elongation -= elongation.mean()  # the misfit is spread
    expected = np.cumsum(elongation) - 0.5 * elongation
    if held == ("top",):
        expected -= elongation.sum()
    elif not held:
        expected -= expected[2]  # the middle stays
    np.testing.assert_allclose(displacement[:, 1], expected, rtol=1e-12, atol=1e-18)


def test_a_gap_in_a_line_separates_runs():
    """Above the hole the line has no rigid end of its own, so its middle stays."""
    loads = [{"cell": [0, row], "force": [0.0, -2.0]} for row in (4, 1)]
    how = {"thickness": T, "materials": {"jelly": JELLY}, "legend": {"#": "jelly", ".": "air"}}
    scene = loaded("##\n##\n.#\n##\n##", *loads, cell_size=H, rule=KEPT, **how)
    result = LoadModel(scene).run()
    moved = of_cells(result, result.displacement)
    squeeze = 0.5 * 2.0 / (H * T * E) * H
    assert moved[0, 1][1] == pytest.approx(-0.5 * squeeze)
    # Run of two cells: the upper one's middle lies half a squeezed cell above the middle.
    assert moved[0, 4][1] == pytest.approx(-0.5 * squeeze)
