"""Materials: the library, its sources, and the ranges of the numbers."""

import math

import pytest

from kaju import Material, material
from kaju.agents.materials import LIBRARY
from kaju.errors import ParameterError


def test_the_library_has_the_usual_materials():
    wanted = (
        "steel aluminium copper glass concrete oak rubber ice granite cartilage noodle cork bone"
    )
    assert set(wanted.split()) | {"soft tissue"} <= set(LIBRARY)


@pytest.mark.parametrize("entry", LIBRARY.values(), ids=LIBRARY)
def test_every_entry_has_name_density_and_source(entry):
    assert LIBRARY[entry.name] is entry
    assert entry.density > 0.0
    assert len(entry.source) > 10


def test_a_near_spelling_is_suggested():
    with pytest.raises(
        ParameterError, match=r"no 'stele' \(did you mean 'steel'\?\); it has steel"
    ):
        material("stele")


def test_nothing_is_suggested_for_what_is_far_from_all():
    with pytest.raises(ParameterError, match=r"the library has no 'xyz'; it has"):
        material("xyz")


@pytest.mark.parametrize("modulus", [0.0, -1.0, math.nan, math.inf])
def test_the_modulus_is_above_zero(modulus):
    with pytest.raises(ParameterError, match=r"youngs_modulus: must be above 0 Pa, got"):
        Material("m", modulus, 0.3)


@pytest.mark.parametrize("ratio", [-1.0, 0.5000001, math.nan, -math.inf])
def test_poissons_ratio_has_a_range(ratio):
    with pytest.raises(ParameterError, match=r"poissons_ratio: must lie above -1 and up to 0.5"):
        Material("m", 1.0, ratio)


def test_the_ends_of_the_range_are_as_stated():
    assert Material("m", 1.0, 0.5).poissons_ratio == 0.5
    assert Material("m", 1.0, -0.999).poissons_ratio == -0.999


@pytest.mark.parametrize("density", [0.0, -1.0, math.nan, math.inf])
def test_a_density_is_above_zero(density):
    with pytest.raises(ParameterError, match=r"density: must be above 0 kg/m³"):
        Material("m", 1.0, 0.3, density)
