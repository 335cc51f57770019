"""Which coefficients of the prescribed rule come closest to a reference.

A load either exceeds the threshold or it does not, so the answer jumps when a coefficient
passes certain values: no gradients. The search divides the box of coefficients into ever
smaller boxes (Jones, Perttunen & Stuckman 1993, "Lipschitzian optimization without the
Lipschitz constant") and improves the best point by a simplex (Nelder & Mead 1965). Both
are deterministic.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats
from kaju.errors import ParameterError, StabilityError
from kaju.model.results.result import BodyResult
from kaju.model.scene import Scene, scene_needed
from kaju.model.study.compare import Comparison, Pair, Settling, compare
from kaju.model.study.reference import Reference
from kaju.model.transfer.load_model import LoadModel

if TYPE_CHECKING:
    from kaju.model.transfer.transfer_result import TransferResult

Quantity = Literal["displacement", "stress"]

GLOBAL_SHARE = 0.7
"""Part of the evaluations that go into the search of the whole box."""
UNSTABLE = 10.0
"""What a rule counts whose loads would grow; worse than any that is worth considering."""
LEAST_BESIDE = 0.02
"""At least this part of what is passed on along the load goes beside."""
LARGEST_SHARE = 0.98
"""No load is passed on in a larger piece, so that all of them end."""


@dataclass(frozen=True, eq=False)
class Fit:
    """The coefficients that were found.

    Attributes
    ----------
    rule : PrescribedRule
        With the fitted α and β, ready for `Scene.replace(rule=...)`.
    before, after : Comparison
        The scene's own rule and the fitted one against the reference.
    quantity : {"displacement", "stress"}
        Whose misfit was made small.
    history : array, shape (evaluations,)
        Least misfit found up to each run of the model.
    seconds : float
        Time that the search took (s).
    """

    rule: PrescribedRule
    before: Comparison
    after: Comparison
    quantity: Quantity
    history: Floats
    seconds: float

    @property
    def evaluations(self) -> int:
        """How often the model was run."""
        return len(self.history)

    @property
    def misfit(self) -> tuple[float, float]:
        """Misfit of the fitted quantity before and after."""
        return _misfit(self.before, self.quantity), _misfit(self.after, self.quantity)

    def __str__(self) -> str:
        assert self.rule.alpha is not None
        before, after = self.misfit
        alpha = ", ".join(f"{share:.4g}" for share in self.rule.alpha)
        return (
            f"alpha = ({alpha}), beta = {self.rule.beta:.4g}: misfit of the {self.quantity} "
            f"{before:.3g} before, {after:.3g} after, {self.evaluations} runs"
        )


def fit_rule(
    scene: Scene,
    reference: BodyResult | Reference | Settling,
    *,
    quantity: Quantity = "displacement",
    points: ArrayLike | None = None,
    most_passed_on: float = 1.0,
    evaluations: int = 600,
) -> Fit:
    """Find α and β that bring the prescribed rule closest to a reference on a scene.

    The coefficients fit this body under this load, and no other.

    Parameters
    ----------
    scene : Scene
        With a `PrescribedRule`; its threshold and way of adding up are kept, coefficients of
        single materials are given up.
    reference : BodyResult, ElasticRun or Reference
        What to come close to.
    quantity : {"displacement", "stress"}
        Whose misfit to make small: the norm of the difference over that of the reference.
    points : array, shape (n, dimension), optional
        Where to compare (m); as for `compare`.
    most_passed_on : float
        α₂ + 2 (dimension - 1) α₃ is at most this. 1: no more than the load. Above 1 loads
        multiply on their way: displacements spread farther, but stresses count load twice.
    evaluations : int
        Runs of the model, about.

    Returns
    -------
    Fit

    Raises
    ------
    ParameterError
        If the scene's rule is another one, or an argument breaks its rule.
    ResultError
        If scene and reference cannot be compared.
    """
    began = perf_counter()
    _check(scene, quantity, most_passed_on, evaluations)
    search = _Search(scene, reference, quantity, points, most_passed_on)
    best = search.run(evaluations)
    rule = search.rule(best)
    after = search.compare(search.answer(rule))
    history = np.minimum.accumulate(np.array(search.found))
    return Fit(rule, search.before, after, quantity, history, perf_counter() - began)


def _check(scene: Scene, quantity: str, most_passed_on: float, evaluations: int) -> None:
    scene_needed(scene)
    if not isinstance(scene.rule, PrescribedRule):
        raise ParameterError(
            f"scene: its rule is {scene.rule.kind!r}; the coefficients of a prescribed rule can "
            "be fitted, so replace it: scene.replace(rule=PrescribedRule())"
        )
    if quantity not in get_args(Quantity):
        raise ParameterError(f"quantity: 'displacement' or 'stress', got {quantity!r}")
    if not 0.0 < most_passed_on <= 2.0:
        raise ParameterError(
            f"most_passed_on: must lie above 0 and up to 2, got {most_passed_on}; above 1 loads "
            "multiply on their way"
        )
    if evaluations < 10:
        raise ParameterError(f"evaluations: 10 or more are needed, got {evaluations}")


class _Search:
    """The misfit as a function of four numbers between 0 and 1.

    These are α₁, the share passed on along the load as a part of the most that may be, the
    part of it that goes beside, and β. So every corner of the box is a rule whose loads end
    if each is judged by itself.
    """

    def __init__(
        self,
        scene: Scene,
        reference: BodyResult | Reference | Settling,
        quantity: Quantity,
        points: ArrayLike | None,
        most_passed_on: float,
    ) -> None:
        # The last stage alone counts, and each is run from the start.
        loads = tuple(load.model_copy(update={"steps": 1}) for load in scene.loads)
        self.scene = scene.replace(loads=loads)
        self.quantity, self.most = quantity, most_passed_on
        self.beside = 2 * (scene.lattice.dimension - 1)
        assert isinstance(scene.rule, PrescribedRule)
        self.own_rule = scene.rule
        first = LoadModel(self.scene, engine="arrays", allow_unstable=True).run()
        self.before = compare(first, reference, points=points)
        pair = _pair(self.before, quantity)
        self.wanted, self.size = pair.reference, float(np.linalg.norm(pair.reference))
        self.found = [_misfit(self.before, quantity)]

    def rule(self, box: Floats) -> PrescribedRule:
        """Return the rule at a point of the box."""
        own, total, across, beta = (float(x) for x in np.clip(box, 0.0, 1.0))
        across = LEAST_BESIDE + (1.0 - LEAST_BESIDE) * across
        passed = self.most * total * np.array([1.0 - across, across / self.beside])
        forward, friction = (float(share) for share in np.minimum(passed, LARGEST_SHARE))
        alpha = (own, forward, friction)
        return replace(self.own_rule, alpha=alpha, beta=beta, materials={})

    def start(self) -> Floats:
        """Return the point of the box nearest to the scene's own rule."""
        shares = self.own_rule.shares(self.scene.cell_materials[0], self.scene.lattice.dimension)
        total = shares.forward + self.beside * shares.friction
        across = self.beside * shares.friction / total if total > 0.0 else 0.5
        beside = (across - LEAST_BESIDE) / (1.0 - LEAST_BESIDE)
        box = np.array([shares.own, total / self.most, beside, self.own_rule.beta])
        return np.asarray(np.clip(box, 0.0, 1.0))

    def answer(self, rule: PrescribedRule) -> TransferResult:
        """Run the model."""
        return LoadModel(self.scene.replace(rule=rule), engine="arrays").run()

    def compare(self, result: TransferResult) -> Comparison:
        """Compare a run with the reference, where the first one was compared."""
        return compare(result, self.before.reference, points=self.before.points)

    def __call__(self, box: Floats) -> float:
        """Return the misfit at a point of the box."""
        try:
            result = self.answer(self.rule(box))
        except StabilityError:
            value = UNSTABLE
        else:
            at = result.stress_at if self.quantity == "stress" else result.displacement_at
            value = float(np.linalg.norm(at(self.before.points) - self.wanted)) / self.size
        self.found.append(value)
        return value

    def run(self, evaluations: int) -> Floats:
        """Return the best point of the box."""
        from scipy.optimize import Bounds, direct, minimize

        everywhere = direct(
            self,
            Bounds(np.zeros(4), np.ones(4)),
            maxfun=int(GLOBAL_SHARE * evaluations),
            maxiter=evaluations,
            locally_biased=True,
        )
        start = self.start()
        candidates = [(float(everywhere.fun), everywhere.x), (self(start), start)]
        best, box = min(candidates, key=lambda candidate: candidate[0])
        left = max(evaluations - len(self.found), 5)
        nearby = minimize(
            self,
            box,
            method="Nelder-Mead",
            bounds=[(0.0, 1.0)] * 4,
            options={"maxfev": left, "initial_simplex": _simplex(box), "xatol": 1e-5},
        )
        return np.asarray(nearby.x if nearby.fun < best else box)


def _simplex(box: Floats, size: float = 0.05) -> Floats:
    """Return a point and its neighbours along every axis, all inside the box."""
    corners = np.tile(box, (len(box) + 1, 1))
    for axis in range(len(box)):
        corners[axis + 1, axis] += size if box[axis] < 0.5 else -size
    return corners


def _pair(comparison: Comparison, quantity: Quantity) -> Pair:
    if quantity == "displacement":
        return comparison.displacement
    if comparison.stress is None:
        raise ParameterError("quantity: the reference knows no stress; fit the displacement")
    return comparison.stress


def _misfit(comparison: Comparison, quantity: Quantity) -> float:
    return _pair(comparison, quantity).misfit
