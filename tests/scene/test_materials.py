"""Materials: the library, its sources, and the ranges of the numbers."""

from math import inf, nan

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


def test_a_near_spelling_is_suggested_and_none_for_what_is_far_from_all():
    with pytest.raises(ParameterError, match=r"no 'stele' \(did you mean 'steel'\?\); it has"):
        material("stele")
    with pytest.raises(ParameterError, match=r"the library has no 'xyz'; it has"):
        material("xyz")


@pytest.mark.parametrize(
    ("name", "told", "values"),
    [
        ("youngs_modulus", "must be above 0 Pa, got", [0.0, -1.0, nan, inf]),
        ("poissons_ratio", "must lie above -1 and up to 0.5", [-1.0, 0.5000001, nan, -inf]),
        ("density", "must be above 0 kg/m³", [0.0, -1.0, nan, inf]),
    ],
)
def test_numbers_have_ranges(name, told, values):
    for value in values:
        with pytest.raises(ParameterError, match=f"{name}: {told}"):
            Material(**{"name": "m", "youngs_modulus": 1.0, "poissons_ratio": 0.3, name: value})


def test_the_ends_of_the_range_are_as_stated():
    assert Material("m", 1.0, 0.5).poissons_ratio == 0.5
    assert Material("m", 1.0, -0.999).poissons_ratio == -0.999
