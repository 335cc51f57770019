"""The elastic rule's numbers: from the material, for a student to compare."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kaju import ElasticRule, Material
from kaju.errors import ParameterError

ratios = st.floats(-0.95, 0.49)


@given(ratio=ratios, shape=st.sampled_from([(2, "stress"), (2, "strain"), (3, None)]))
def test_what_is_taken_is_passed_on_whole(ratio, shape):
    dimension, plane = shape
    shares = ElasticRule.shares(Material("m", 3e9, ratio), dimension, plane)
    passed = shares.forward + shares.backward + 2 * (dimension - 1) * shares.friction
    assert passed == pytest.approx(1.0, rel=1e-14)
    assert 0.0 < shares.poisson < 0.5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"threshold": 0.0}, "threshold: must be a load above 0 N, got 0.0"),
        ({"share": 0.5}, "share: belongs to the order 'wave'"),
        ({"tolerance": 2.0}, "tolerance: must lie between 0 and 1, got 2.0"),
    ],
)
def test_a_rule_out_of_range_is_refused(arguments, message):
    with pytest.raises(ParameterError, match=message):
        ElasticRule(**arguments)


def test_incompressible_material_is_refused_where_it_has_no_stiffness():
    water = Material("gel", 1e4, 0.5)
    assert ElasticRule.shares(water).forward == pytest.approx(0.4)
    with pytest.raises(ParameterError, match=r"poissons_ratio: must be below 0\.5 .* got 0\.5"):
        ElasticRule.shares(water, 3)
    with pytest.raises(ParameterError, match="dimension: "):
        ElasticRule.shares(water, 3, "stress")
