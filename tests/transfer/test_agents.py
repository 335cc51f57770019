"""What an agent can tell of itself."""

import networkx as nx
import pytest
from plates import loaded

from kaju import (
    FreeBoundaryAgent,
    LoadModel,
    PrescribedRule,
    RigidBoundaryAgent,
    RollerBoundaryAgent,
)

LEFT, RIGHT, DOWN, UP = range(4)


def row_of(letters, sides, rule, cell=(1, 0), force=(-2.0, 0.0)):
    load = {"cell": cell, "force": force}
    return LoadModel(loaded(letters, load, sides=sides, rule=rule, allow_floating=True))


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


@pytest.mark.parametrize(
    ("side", "kind", "back"),
    [
        ("free", FreeBoundaryAgent, LEFT),
        ("rigid", RigidBoundaryAgent, RIGHT),
        ("roller", RollerBoundaryAgent, RIGHT),
    ],
)
def test_what_a_boundary_gives_back(side, kind, back):
    model = row_of("##", {"left": side}, STRAIGHT, cell=(0, 0))
    model.step()
    assert isinstance(agent_at(model, -1), kind)
    assert agent_at(model, 0).inbox == {(back, 1.0, "push"): 1.0}


def test_a_roller_lets_slide_what_runs_along_it():
    rule = PrescribedRule(alpha=(0.5, 0.0, 0.3), beta=1.0, threshold=0.3)
    smooth = row_of("##", {"bottom": "roller"}, rule, cell=(0, 0))
    rough = row_of("##", {"bottom": "rigid"}, rule, cell=(0, 0))
    for model in (smooth, rough):
        model.step()
    assert agent_at(smooth, 0).inbox == {(LEFT, 0.6, "push"): 2.0}, "from above and from below"
    assert agent_at(rough, 0).inbox == {(LEFT, 0.6, "push"): 1.0, (RIGHT, 0.6, "push"): 1.0}


def test_air_and_ground_inside_the_array_are_boundaries_too():
    model = row_of(".#=", {}, STRAIGHT, force=(2.0, 0.0))
    stage = model.run().last
    assert stage.boundary_cells.tolist() == [[2, 0], [0, 0]]
    assert stage.boundary_spawn_step.tolist() == [2, 3]


def test_the_load_path_is_a_graph_of_loads():
    model = row_of("##", {"left": "rigid"}, STRAIGHT)
    graph = model.run().load_path()
    assert isinstance(graph, nx.DiGraph)
    assert graph.edges[(1, 0), (0, 0)]["weight"] == 1.0
    assert graph.edges[(0, 0), (-1, 0)]["weight"] == 0.5
    assert graph.edges[(-1, 0), (0, 0)]["weight"] == 0.5
    assert graph.nodes[(-1, 0)]["kind"] == "rigid"
    assert graph.nodes[(0, 0)] == {
        "kind": "material",
        "material": "steel",
        "spawn_step": 2,
        "pos": (0.005, 0.005),
    }
