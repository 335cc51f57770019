"""The certificate, against what runs really do."""

import pytest
from plates import PLATE

from kaju import Coefficients, LoadModel, PrescribedRule, Scene, stability
from kaju.errors import StabilityError


def test_the_plate_ends_within_eight_generations():
    certificate = stability(Scene(**PLATE))
    assert certificate.stable
    assert certificate.spectral_radius == pytest.approx(1.15)
    assert certificate.generations == 8
    assert certificate.verdict == "every load ends after at most 8 generations"


def test_added_up_the_plate_is_refused_with_a_remedy_that_works():
    scene = Scene(**PLATE, rule=PrescribedRule(accumulate=True))
    told = r"grow by 15 % .*α₂ \(passed ahead\) below 0\.35 or"
    with pytest.raises(StabilityError, match=told) as error:
        LoadModel(scene)
    assert "α₃ (to each side) below 0.175" in str(error.value)
    limits = [(0.3499, 0.25, "every load ends"), (0.35, 0.25, "lower threshold loads stay as")]
    for forward, friction, told in [*limits, (0.5, 0.1749, "every load ends")]:
        rule = PrescribedRule(alpha=(0.5, forward, friction), accumulate=True)
        mended = Scene(**PLATE, rule=rule)
        assert told in stability(mended).verdict
        assert LoadModel(mended, engine="arrays").run().last.ledger.pending == 0.0


@pytest.mark.parametrize(
    ("forward", "told"), [(0.4, "by 5 %"), (0.35, "up to"), (None, "may never")]
)
def test_what_comes_to_rest_by_its_threshold_is_not_refused(forward, told):
    """The sums that grow say nothing of γ; a share of 1 in a material that no load reaches, too."""
    rule = PrescribedRule(alpha=(0.5, forward or 0.4, 0.25), accumulate=True)
    if not forward:
        rule = PrescribedRule(materials={"rubber": Coefficients(alpha=(0.5, 1.0, 0.25))})
    far = {"box": [[0.0, 0.0], [0.02, 0.02]], "material": "rubber"}
    scene = Scene(**PLATE | {"body": PLATE["body"] | {"regions": [far]}}, rule=rule)
    certificate, last = stability(scene), LoadModel(scene).run().last
    assert certificate.stable
    assert certificate.generations == last.generations
    assert "come to rest after" in certificate.verdict
    assert told in certificate.verdict
    assert "come to rest, because" in LoadModel(scene, order=list).certificate.verdict
    assert last.ledger.pending == 0.0


def test_a_share_of_one_never_ends():
    scene = Scene(**PLATE, rule=PrescribedRule(alpha=(0.5, 1.0, 0.25)))
    with pytest.raises(StabilityError, match="never ends"):
        LoadModel(scene)
    stage = LoadModel(scene, allow_unstable=True, max_generations=30).run().last
    assert stage.outcome == "stopped after max_generations = 30 with loads on their way"


def test_loads_that_end_one_by_one_may_grow_together():
    scene = Scene(**PLATE, rule=PrescribedRule(alpha=(0.1, 0.9, 0.9), threshold=1e-6))
    assert "their sum grows by up to 173 % a generation" in stability(scene).verdict
    assert "grown to" in LoadModel(scene, engine="arrays").run().last.outcome


def test_a_share_of_one_in_one_material_alone_may_end_and_is_watched():
    """Loads that end only after more generations than are tried are not said never to end."""
    body = {"cell_size": 0.01, "drawing": "s" * 400 + "r" + "s" * 400}
    rule = PrescribedRule(
        alpha=(0.01, 0.99, 0.0), beta=1.0, threshold=0.01,
        materials={"rubber": Coefficients(alpha=(0.0, 1.0, 0.0), beta=1.0)},
    )  # fmt: skip
    scene = Scene(
        body=body, legend={"s": "steel", "r": "rubber"}, sides={"bottom": "rigid"},
        loads=[{"cell": [400, 0], "force": [1.0, 0.0]}], rule=rule,
    )  # fmt: skip
    certificate, model = stability(scene), LoadModel(scene)
    assert not certificate.known
    assert "so it may never end, unless the threshold ends them" in certificate.verdict
    assert model.run().last.outcome == "at rest after 460 generations"
