"""The elastic rule's numbers: from the material, for a student to compare."""

import numpy as np
import pytest
from elastic_scenes import block, plate, ragged
from hypothesis import given
from hypothesis import strategies as st

from kaju import ElasticRule, Material, Shares
from kaju.agents.materials import LIBRARY
from kaju.errors import ParameterError
from kaju.model.elastic.relaxation.push_table import PushTable

STEEL = LIBRARY["steel"]
ratios = st.floats(-0.95, 0.49)


def test_steel_in_plane_stress():
    shares = ElasticRule.shares(STEEL)
    assert isinstance(shares, Shares)
    numbers = shares.forward, shares.backward, shares.friction, shares.poisson
    assert numbers == pytest.approx((0.3704, 0.3704, 0.1296, 0.2407), abs=5e-5)
    assert shares.growth == pytest.approx(2.963, abs=5e-4)


@given(ratio=ratios, shape=st.sampled_from([(2, "stress"), (2, "strain"), (3, None)]))
def test_what_is_taken_is_passed_on_whole(ratio, shape):
    dimension, plane = shape
    shares = ElasticRule.shares(Material("m", 3e9, ratio), dimension, plane)
    passed = shares.forward + shares.backward + 2 * (dimension - 1) * shares.friction
    assert passed == pytest.approx(1.0, rel=1e-14)
    assert 0.0 < shares.poisson < 0.5
    assert 2.0 < shares.growth <= 2.0 * dimension


@pytest.mark.parametrize("make", [plate, lambda: block((5, 5, 5))])
def test_an_agent_inside_hands_out_exactly_these_shares(make):
    scene = make()
    dimension = scene.lattice.dimension
    table = PushTable(scene)
    shares = ElasticRule.shares(STEEL, dimension, scene.plane)
    level = table.levels[0]
    axis, index = level.place
    middle = np.array(scene.lattice.shape) // 2 + 1
    (number,) = np.flatnonzero((axis == 0) & (index == middle).all(axis=1))
    row = level.shares[[number]].tocoo()
    assert len(row.data) == 2 + 6 * (dimension - 1)
    position = table.positions(0)
    step = (position[row.coords[1]] - position[number]) / scene.lattice.cell_size
    for target, share, offset in zip(row.coords[1], row.data, step, strict=True):
        if axis[target] != 0:
            expected = np.prod(np.sign(offset[offset != 0])) * shares.poisson
        elif abs(offset[0]) > 0.5:
            expected = shares.forward if offset[0] > 0.0 else shares.backward
        else:
            expected = shares.friction
        assert share == pytest.approx(expected)


def test_every_agent_passes_on_all_it_takes_and_pulls_as_much_as_it_pushes_across():
    table = PushTable(ragged())
    level = table.levels[0]
    axis = level.place[0]
    columns = np.concatenate([axis, table.place_axes])
    for across in range(2):
        total = level.shares @ (columns == across).astype(float)
        np.testing.assert_allclose(total, axis == across, atol=1e-14)


def test_air_gives_back_what_a_whole_neighbourhood_would_have_taken():
    # Beside air an agent is softer by just what is given back to it.
    table = PushTable(plate())
    level = table.levels[0]
    back = np.asarray(table.open_air.links.sum(axis=0)).ravel()
    position = table.positions(0)
    near_ground = position[:, 1] < 0.03
    whole = level.stiffness * (1.0 + back)
    np.testing.assert_allclose(whole[~near_ground], table.reference, rtol=1e-13)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"threshold": 0.0}, "threshold: must be a load above 0 N, got 0.0"),
        ({"order": "random"}, "order: must be one of 'wave', 'largest first', 'multilevel'"),
        ({"share": 0.5}, "share: belongs to the order 'wave'"),
        ({"order": "wave", "share": -1.0}, "share: must be a number above 0, got -1.0"),
        ({"tolerance": 2.0}, "tolerance: must lie between 0 and 1, got 2.0"),
    ],
)
def test_a_rule_out_of_range_is_refused(arguments, message):
    with pytest.raises(ParameterError, match=message):
        ElasticRule(**arguments)


def test_incompressible_material_is_refused_where_it_has_no_stiffness():
    water = Material("gel", 1e4, 0.5)
    assert ElasticRule.shares(water).forward == pytest.approx(0.4)
    with pytest.raises(ParameterError, match=r"'gel': 0\.5 is incompressible"):
        ElasticRule.shares(water, 3)
    with pytest.raises(ParameterError, match=r"dimension: 2 .with a plane. or 3"):
        ElasticRule.shares(water, 3, "stress")
