"""Pictures of elastic results and of spring networks, and the words that go with numbers."""

import dataclasses

import numpy as np
import pytest
from artists import axes_of, drawn, notes, part
from plates import plate
from scattered import scattered

from kaju import plot, solve
from kaju.errors import ParameterError
from kaju.model.network import solve as solve_network
from kaju.model.network import triangular
from kaju.view import plot_all
from kaju.view.style import arrow_polygons
from kaju.view.units import Scale, grouped, quantity, round_down, scale_for, times


def test_an_elastic_result_is_drawn_on_the_cells_that_were_solved() -> None:
    """And as agents of one size."""
    result = solve(plate([8, 6], None, material="oak", loads=[{"side": "top", "pressure": 1e5}]))
    cells = np.count_nonzero(result.cells().body)
    assert len(drawn(axes_of(result, "deformed"), "moved")) == cells
    field = part(axes_of(result, "von_mises"), "map")
    assert field.get_array().max() == pytest.approx(np.nanmax(result.von_mises))
    agents = part(axes_of(result, "agents"), "agents")
    assert len(agents.get_paths()) == result.agents
    assert np.all(agents.get_array() == 0)
    with pytest.raises(ParameterError, match="there is deformed, displacement"):
        plot(result, "load_path")


def test_the_springs_of_a_network_are_coloured_by_tension() -> None:
    result = solve_network(triangular(5), 4)
    springs = part(axes_of(result), "springs")
    assert len(springs.get_segments()) == len(result.network.springs)
    assert springs.get_array().tolist() == result.tension[-1].tolist()
    assert springs.norm.vmin == -springs.norm.vmax
    strains = part(axes_of(result, colour="strain", record=2), "springs")
    assert strains.get_array().tolist() == result.strain(2).tolist()


def test_large_displacements_of_a_network_are_drawn_as_they_are() -> None:
    result = solve_network(triangular(5, force=0.3), 4)
    ax = axes_of(result)
    segments = np.array(part(ax, "springs").get_segments())
    np.testing.assert_allclose(segments, result.positions()[result.network.springs])
    assert "deformation shown ×1" in notes(ax)


def test_networks_in_space_and_all_pictures_of_networks(tmp_path) -> None:
    paths = plot_all(solve_network(scattered(20, dimension=3, force=0.01), 2), tmp_path)
    assert [path.name for path in paths] == ["deformed.png", "response.png"]


def test_one_stage_is_drawn_beside_what_is_proportional() -> None:
    net = triangular(3, force=0.1)
    stages = {name: np.tile(getattr(net, name), (2, 1, 1)) for name in ("forces", "displacements")}
    twice = dataclasses.replace(net, **stages)
    for network, beside in ((net, True), (twice, False)):
        lines = axes_of(solve_network(network, 2), "response").lines
        assert any(line.get_label() == "proportional" for line in lines) == beside


@pytest.mark.parametrize(
    "options", [{"record": 9}, {"record": -9}, {"colour": "age"}, {"magnification": 0.0}]
)
def test_what_a_network_does_not_know_is_refused(options) -> None:
    with pytest.raises(ParameterError, match=next(iter(options))):
        plot(solve_network(triangular(3), 2), **options)


def test_arrows_end_at_their_heads_and_keep_their_length() -> None:
    tail, head = np.array([[0.0, 0.0]]), np.array([[3.0, 4.0]])
    (outline,) = arrow_polygons(tail, head, np.array([0.2]))
    assert outline[0].tolist() == [3.0, 4.0]
    back = outline @ np.array([0.6, 0.8])
    assert back.min() == pytest.approx(0.0)
    assert back.max() == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (5.0449e-9, "m", "5.045 nm"),
        (0.01, "N", "0.01 N"),
        (1e-6, "N", "1 µN"),
        (-56290.0, "Pa", "−56.29 kPa"),
        (0.0, "m", "0 m"),
        (999.9999999999, "Pa", "1 kPa"),
    ],
)
def test_quantities_read_well(value: float, unit: str, text: str) -> None:
    assert quantity(value, unit) == text


def test_magnifications_are_round() -> None:
    values = [round_down(value) for value in (1.0, 1.99, 4.9, 5.0, 9.99, 10.0, 0.037, 123456.0)]
    assert values == pytest.approx([1.0, 1.0, 2.0, 5.0, 5.0, 10.0, 0.02, 100000.0])
    assert times(1e4) == "×10\u202f000"
    assert times(0.02) == "×0.02"
    assert grouped(1234567) == "1\u202f234\u202f567"


def test_small_powers_of_ten_are_written_as_such():
    marks = {1e-5: "$10^{-5}$", 2e-5: "2e−05", 1.0: "1", -3.0: "−3", 0.0: "0", 1e-3: "0.001"}
    assert {value: Scale(1.0, "").text(value) for value in marks} == marks


def test_prefixes_stay_within_what_there_is() -> None:
    assert scale_for([1e30], "m").unit == "Em"
    assert scale_for([1e-30], "m").unit == "am"
    assert scale_for([float("inf")], "m").unit == "m"
