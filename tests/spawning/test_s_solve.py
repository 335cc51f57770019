"""Agents spawn where load is left unbalanced, until the error is within the tolerance."""

import numpy as np
import pytest
from elastic_scenes import spawned_agents
from spawning_bodies import spawned_by

import kaju
from kaju import Scene, solve
from kaju.errors import ConvergenceError, ParameterError, ResultFileError, SupportError
from kaju.model.elastic.elastic_result import ElasticResult
from kaju.model.elastic.spawning.solve_spawning import solve_spawning
from kaju.model.results.result import load_result

LIMIT = 1.32302e-8
"""Strain energy (J) of the plate by converged quadratic finite elements."""


def plate(cells=20, size=0.2, **others):
    """The worked plate under 2 N over 10 mm of its top."""
    middle = 0.5 * size
    load = {"region": {"box": [[middle, size], [middle + 0.01, size]]}, "force": [0.0, -2.0]}
    body = {"size": [size] * 2, "cells": [cells] * 2, "thickness": 2e-3, "material": "steel"}
    return Scene(body=body, sides={"bottom": "rigid"}, loads=[load], **others)


def problem(name):
    steel = {"material": "steel"}
    if name == "L":
        return Scene(
            body={
                "cell_size": 0.1,
                "drawing": "####....\n" * 4 + "########\n" * 4,
                "plane": "strain",
            },
            legend={"#": "steel", ".": "air"},
            sides={"bottom": "rigid"},
            loads=[{"region": {"box": [[0, 0.8], [0.4, 0.8]]}, "force": [100.0, 0.0]}],
        )
    if name == "hole":
        hole = {"material": "air", "disk": {"centre": [0.1, 0.1], "radius": 0.05}}
        return Scene(
            body={"size": [0.2, 0.2], "cells": [16, 16], "regions": [hole], **steel},
            sides={"bottom": "rigid"},
            loads=[{"side": "top", "pressure": 1e6}],
        )
    if name == "bending":
        return Scene(
            body={"size": [0.4, 0.05], "cells": [64, 8], **steel},
            sides={"left": "rigid"},
            loads=[{"side": "right", "force": [0.0, -100.0]}],
        )
    materials = {
        "a": {"youngs_modulus": 1e9, "poissons_ratio": 0.3},
        "b": {"youngs_modulus": 1e6 if name == "soft inclusion" else 1e8, "poissons_ratio": 0.4},
        "rubber": {"youngs_modulus": 1e6, "poissons_ratio": 0.4999},
    }
    inside = [] if name == "rubber" else [{"material": "b", "box": [[0.05, 0.05], [0.15, 0.15]]}]
    first = "rubber" if name == "rubber" else "a"
    return Scene(
        body={
            "size": [0.2, 0.2],
            "cells": [16, 16],
            "plane": "strain",
            "material": first,
            "regions": inside,
        },
        materials={k: v for k, v in materials.items() if k in (first, "b")},
        sides={"bottom": "rigid"},
        loads=[{"region": {"box": [[0.05, 0.2], [0.1, 0.2]]}, "force": [0.0, -100.0]}],
    )


PROBLEMS = ["L", "hole", "bending", "bimaterial", "soft inclusion", "rubber"]


@pytest.mark.parametrize("name", PROBLEMS)
def test_estimate_is_within_its_factors_of_the_true_error(name):
    scene = problem(name)
    fine = spawned_by(scene, tolerance=0.016)
    limit = fine.generations[-1].energy * (1 - fine.error_estimate**2)
    for tolerance in (0.1, 0.05):
        result = spawned_by(scene, tolerance=tolerance)
        error = np.sqrt(abs(result.generations[-1].energy / limit - 1))
        assert result.tolerance_kept == "proved"
        assert 0.5 < result.error_estimate / error < 3.0


def test_energy_of_the_plate_tends_to_the_finite_elements_limit():
    """With half the error for four times the agents: the best that any mesh can do."""
    results = [spawned_by(plate(), tolerance=t) for t in (0.08, 0.02)]
    errors = [np.sqrt(r.generations[-1].energy / LIMIT - 1) for r in results]
    assert errors[1] < 0.03
    slope = np.log(errors[1] / errors[0]) / np.log(results[1].agents / results[0].agents)
    assert slope < -0.45
    for result in results:
        np.testing.assert_allclose(result.reactions["bottom"], [0.0, 2.0], atol=2e-9)


def test_corner_of_the_L_does_not_spoil_the_order():
    """Nearly N^(-1/2), where equal cells fall more slowly."""
    results = [spawned_by(problem("L"), tolerance=t) for t in (0.1, 0.02)]
    fall = np.log(results[1].error_estimate / results[0].error_estimate)
    assert fall / np.log(results[1].agents / results[0].agents) < -0.45
    smallest = results[1].size == results[1].size.min()
    corner = np.linalg.norm(results[1].lower[smallest] - 0.4, axis=1)
    assert corner.min() < 2 * results[1].size.min()


def test_size_of_the_body_hardly_counts():
    small, large = plate(), plate(cells=320, size=3.2)
    counts = [spawned_by(scene, tolerance=0.05).agents for scene in (small, large)]
    assert counts[1] < 2.5 * counts[0]


def test_block_of_cubes_costs_what_the_load_reaches():
    """16,384³ cells, of which a few thousand agents stand for all."""
    load = {"region": {"box": [[0.499, 0.499, 1.0], [0.501, 0.501, 1.0]]}, "force": [0, 0, -1.0]}
    body = {"size": [1.0, 1.0, 1.0], "cells": [16384] * 3, "material": "steel"}
    scene = Scene(body=body, sides={"bottom": "rigid"}, loads=[load])
    result = spawned_by(scene, tolerance=0.25)
    assert result.tolerance_kept == "proved"
    assert result.agents < 10_000
    np.testing.assert_allclose(result.reactions["bottom"], [0, 0, 1.0], atol=1e-9)


def test_reasons_for_spawning_are_kept():
    result = spawned_by(plate(), tolerance=0.05)
    first, later = result.spawn_step == 0, result.spawn_step > 0
    assert np.all(result.cause[first] == 0.0)
    causes = result.cause[later]
    assert np.nanmin(causes) > 0.0
    assert np.isfinite(causes).any()
    assert result.spawn_step.max() == len(result.generations) - 1
    agents = [generation.agents for generation in result.generations]
    assert agents == sorted(agents)
    assert agents[-1] == result.agents == len(result.to_dataframe())
    assert result.error_share.sum() == pytest.approx(1.0)


def test_solving_again_gives_the_same_numbers():
    first, second = (spawned_by(plate(), tolerance=0.05) for _ in range(2))
    np.testing.assert_array_equal(
        first.found.spawning.displacement, second.found.spawning.displacement
    )


def test_values_at_points_are_those_of_fine_equal_cells():
    scene = plate()
    uniform = solve(scene, resolution=16, strategy="uniform")
    spawned = spawned_by(scene, tolerance=0.012)
    rng = np.random.default_rng(1)
    points = rng.uniform([0.0, 0.0], [0.2, 0.17], size=(200, 2))
    u = uniform.displacement_at(points)
    difference = spawned.displacement_at(points) - u
    assert np.abs(difference).max() < 2e-3 * np.abs(u).max()
    stress = uniform.stress_at(points)
    difference = spawned.stress_at(points) - stress
    assert np.sqrt((difference**2).mean()) < 0.02 * np.sqrt((stress**2).mean())


def test_bar_under_tension_needs_only_its_first_agents():
    """σ = 1 MPa everywhere: nothing is left unbalanced."""
    body = {"size": [0.4, 0.1], "cells": [16, 4], "material": "steel"}
    sides = {"left": "roller", "bottom": "roller"}
    pull = {"side": "right", "pressure": -1e6}
    result = spawned_by(Scene(body=body, sides=sides, loads=[pull]), tolerance=1e-3)
    assert len(result.generations) == 1
    np.testing.assert_allclose(result.stress[:, 0, 0], 1e6, rtol=1e-9)
    assert np.abs(result.stress[:, 1, 1]).max() < 1.0
    tip = result.displacement_at(np.array([[0.4, 0.05]]))
    youngs = kaju.material("steel").youngs_modulus
    np.testing.assert_allclose(tip[0, 0], 1e6 / youngs * 0.4, rtol=1e-9)


def test_member_one_cell_wide_gets_smaller_agents():
    drawing = "..#..\n..#..\n#####\n"
    scene = Scene.from_drawing(
        drawing,
        legend={"#": "steel", ".": "air"},
        cell_size=0.01,
        sides={"bottom": "rigid"},
        loads=[{"cell": [2, 2], "side": "top", "force": [1.0, 0.0]}],
    )
    result = spawned_by(scene, tolerance=0.1)
    assert any("one cell wide" in note for note in result.summary()["notes"])
    assert result.tolerance_kept == "proved"


def test_body_that_may_slide_is_refused():
    scene = plate().replace(sides={"bottom": "roller"})
    with pytest.raises(SupportError, match="move along x"):
        spawned_by(scene, tolerance=0.1)


def test_resolution_bounds_the_agents_and_says_so():
    result = spawned_by(plate(), tolerance=0.01, resolution=2)
    assert result.size.min() == pytest.approx(0.005)
    assert result.error_estimate > 0.01
    assert any("resolution" in note for note in result.summary()["notes"])


def test_too_many_agents_are_an_error_that_keeps_the_best():
    with pytest.raises(ConvergenceError, match="most_agents") as caught:
        solve(plate(), tolerance=0.01, most_agents=1000, strategy="spawning")
    assert spawned_agents(caught.value.best)
    assert 300 < caught.value.best.agents <= 1000


@pytest.mark.parametrize(
    ("how", "match"),
    [
        ({"tolerance": 2.0, "strategy": "spawning"}, "tolerance"),
        ({"tolerance": 0.1, "resolution": 0, "strategy": "spawning"}, "resolution"),
        ({"tolerance": 0.1, "strategy": "clever"}, "strategy"),
    ],
)
def test_bad_arguments_are_named(how, match):
    with pytest.raises(ParameterError, match=match):
        solve(plate(), **how)


def test_agents_spawn_if_that_strategy_is_asked_for():
    assert spawned_agents(solve(plate(), tolerance=0.3, strategy="spawning"))
    assert not spawned_agents(solve(plate(), tolerance=0.1, strategy="uniform"))


def test_saved_result_is_the_same_when_read(tmp_path):
    result = solve_spawning(plate(), tolerance=0.1)
    path = result.save(tmp_path / "plate")
    again = load_result(path)
    assert spawned_agents(again)
    assert again.summary() == result.summary()
    np.testing.assert_array_equal(again.cause, result.cause)
    points = np.array([[0.105, 0.19], [0.2, 0.0]])
    np.testing.assert_array_equal(again.stress_at(points), result.stress_at(points))
    with pytest.raises(ResultFileError):
        ElasticResult.load(tmp_path / "nothing.npz")


@pytest.mark.parametrize("dimension", [2, 3])
def test_vtk_file_holds_the_agents(tmp_path, dimension):
    meshio = pytest.importorskip("meshio")
    scene = plate()
    if dimension == 3:
        body = {"size": [1.0] * 3, "cells": [8] * 3, "material": "steel"}
        load = {"region": {"box": [[0.25, 0.25, 1], [0.5, 0.5, 1]]}, "force": [0, 0, -1.0]}
        scene = Scene(body=body, sides={"bottom": "rigid"}, loads=[load])
    result = spawned_by(scene, tolerance=0.3)
    mesh = meshio.read(result.to_vtk(tmp_path / "agents.vtu"))
    assert len(mesh.cells[0].data) == result.agents
    corner = mesh.points[mesh.cells[0].data]
    edge = np.ptp(corner[..., 0], axis=1)
    np.testing.assert_allclose(edge, result.size)
    np.testing.assert_allclose(mesh.cell_data["level"][0], result.level)
    assert np.abs(mesh.point_data["displacement"]).max() > 0
