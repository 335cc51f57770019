"""Pictures of elastic results and of spring networks, and the words that go with numbers."""

import numpy as np
import pytest
from artists import axes_of, drawn, part
from plates import plate

from kaju import plot, solve
from kaju.errors import ParameterError
from kaju.model.network import solve as solve_network
from kaju.model.network import triangular


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
        plot(result, "loads")


def test_the_springs_of_a_network_are_coloured_by_tension() -> None:
    result = solve_network(triangular(5), 4)
    springs = part(axes_of(result), "springs")
    assert len(springs.get_segments()) == len(result.network.springs)
    assert springs.get_array().tolist() == result.tension[-1].tolist()
    assert springs.norm.vmin == -springs.norm.vmax


@pytest.mark.parametrize("options", [{"record": 9}, {"record": -9}, {"magnification": 0.0}])
def test_what_a_network_does_not_know_is_refused(options) -> None:
    with pytest.raises(ParameterError, match=next(iter(options))):
        plot(solve_network(triangular(3), 2), **options)
