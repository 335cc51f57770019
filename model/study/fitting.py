"""Which coefficients of the prescribed rule come closest to a reference.

A load either exceeds the threshold or it does not, so the answer jumps where a coefficient passes
certain values, and has no gradients. The search divides the box of coefficients into ever smaller
boxes (Jones, Perttunen & Stuckman 1993, "Lipschitzian optimization without the Lipschitz
constant") and improves the best point by a simplex (Nelder & Mead 1965). Both are deterministic.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats
from kaju.errors import ParameterError, StabilityError, require, suggestion
from kaju.model.scene import Scene, scene_needed
from kaju.model.study.compare import Comparison, Pair, compare
from kaju.model.study.solving import solve
from kaju.model.transfer.load_model import LoadModel

Quantity = Literal["displacement", "stress"]

LEAST_BESIDE = 0.02  # at least this part of what is passed on goes beside the load's line


@dataclass(frozen=True, eq=False)
class Fit:
    """The coefficients that were found."""

    rule: PrescribedRule  # the scene's with the fitted α and β, for `Scene.replace(rule=...)`
    before: Comparison  # the scene's own rule against the reference
    after: Comparison  # the fitted rule against it
    quantity: Quantity  # whose misfit was minimised
    evaluations: int  # how often the rule was run

    @property
    def misfits(self) -> dict[Quantity, tuple[float, float]]:
        """Misfit of each quantity that the reference knows, fitted or not, before and after."""
        known = [name for name in get_args(Quantity) if getattr(self.before, name) is not None]
        return {
            name: (_pair(self.before, name).misfit, _pair(self.after, name).misfit)
            for name in known
        }

    @property
    def misfit(self) -> tuple[float, float]:
        """Misfit of what was fitted, before and after."""
        return self.misfits[self.quantity]

    @property
    def trade_off(self) -> str:
        """What has become worse, and what better for it; empty if nothing has become worse."""
        told = {name: [f"{m:.3g}" for m in both] for name, both in self.misfits.items()}
        better, worse = (
            ", ".join(
                f"{name} ({' to '.join(told[name])})"
                for name, (before, after) in self.misfits.items()
                if len({*told[name]}) == 2 and (after > before) == up
            )
            for up in (False, True)
        )
        return worse and f"better: {better or 'nothing'}; worse: {worse}"

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        before, after = self.misfit
        return {
            "alpha": list(self.rule.alpha or ()),
            "beta": self.rule.beta,
            "misfit_before": before,
            "misfit_after": after,
            "trade_off": self.trade_off or None,
            "runs": self.evaluations,
        }

    def __str__(self) -> str:
        alpha = ", ".join(f"{share:.4g}" for share in self.rule.alpha or ())
        before, after = self.misfit
        text = (
            f"alpha = ({alpha}), beta = {self.rule.beta:.4g}: misfit {before:.3g} before, "
            f"{after:.3g} after, {self.evaluations} runs"
        )
        return "; ".join(filter(None, [text, self.trade_off]))


def elastic_reference(scene: Scene, resolution: int | None = None) -> Any:
    """Return the answer of elasticity, by default on cells fine enough to be believed."""
    if resolution is None:
        across = {2: 160, 3: 48}[scene.lattice.dimension]
        resolution = min(8, max(1, across // max(scene.lattice.shape)))
    return solve(scene, resolution=resolution)


def fit_rule(
    scene: Scene,
    reference: Any = None,
    *,
    quantity: Quantity = "displacement",
    evaluations: int = 600,
) -> Fit:
    """Find the α and β for which the prescribed rule is closest to a reference.

    They fit this body under these loads only. Agents never pass on more along the load than they
    take.

    Parameters
    ----------
    scene : Scene
        With a `PrescribedRule`; its threshold and way of adding up are kept, coefficients of single
        materials are dropped.
    reference : answer of elasticity or Reference, optional
        What counts as the truth; by default the answer of elasticity.
    quantity : {"displacement", "stress"}
        Which misfit to minimise: the norm of the difference over the norm of the reference.
    evaluations : int
        About how often the rule is run.

    Returns
    -------
    Fit
        The `rule`, and its `misfit` before and after.

    Raises
    ------
    ParameterError, ResultError
        If the scene's rule is another one, or scene and reference cannot be compared.

    Examples
    --------
    >>> import kaju
    >>> scene = kaju.load_scene("plate.toml")
    >>> fit = kaju.fit_rule(scene, quantity="stress", evaluations=60)
    >>> before, after = fit.misfit
    >>> after < before
    True
    """
    scene_needed(scene)
    if not isinstance(scene.rule, PrescribedRule):
        raise ParameterError(
            f"scene: its rule is {scene.rule.kind!r}; the coefficients of a prescribed rule "
            "can be fitted, so replace it: scene.replace(rule=PrescribedRule())"
        )
    if quantity not in get_args(Quantity):
        known = suggestion(str(quantity), get_args(Quantity))
        told = f"must be 'displacement' or 'stress', got {quantity!r}"
        raise ParameterError(f"quantity: {told}{known}")
    require(evaluations >= 10, f"evaluations: must be 10 or more, got {evaluations}")
    search = _Search(scene, elastic_reference(scene) if reference is None else reference, quantity)
    best = search.rule(search.run(evaluations))
    return Fit(best, search.before, search.compare(best), quantity, search.runs)


class _Search:
    """The misfit as a function of four numbers between 0 and 1.

    These are α₁, the share passed on along the load, the part of it that goes beside, and β. So
    every corner of the box is a rule whose loads end if each is judged by itself.
    """

    def __init__(self, scene: Scene, reference: Any, quantity: Quantity) -> None:
        assert isinstance(scene.rule, PrescribedRule)
        # The last stage alone counts, and each is run from the start.
        self.scene, self.own, self.runs = scene.in_one_step(), scene.rule, 0
        first = LoadModel(self.scene, engine="arrays", allow_unstable=True).run()
        self.before = compare(first, reference)
        self.quantity: Quantity = quantity
        self.beside = 2 * (scene.lattice.dimension - 1)
        self.best, self.box = np.inf, self.start()

    def compare(self, rule: PrescribedRule) -> Comparison:
        """Compare a rule with the reference, where the first one was compared."""
        result = LoadModel(self.scene.replace(rule=rule), engine="arrays").run()
        return compare(result, self.before.reference, points=self.before.points)

    def rule(self, box: Floats) -> PrescribedRule:
        """Return the rule at a point of the box."""
        own, total, across, beta = (float(x) for x in np.clip(box, 0.0, 1.0))
        across = LEAST_BESIDE + (1.0 - LEAST_BESIDE) * across
        passed = total * np.array([1.0 - across, across / self.beside])
        # No load is passed on in a larger piece, so that all of them end.
        forward, friction = (float(share) for share in np.minimum(passed, 0.98))
        return replace(self.own, alpha=(own, forward, friction), beta=beta, materials={})

    def start(self) -> Floats:
        """Return the point of the box nearest to the scene's own rule."""
        shares = self.own.shares(self.scene.cell_materials[0], self.scene.lattice.dimension)
        total = shares.forward + self.beside * shares.friction
        across = self.beside * shares.friction / total if total > 0.0 else 0.5
        beside = (across - LEAST_BESIDE) / (1.0 - LEAST_BESIDE)
        return np.asarray(np.clip([shares.own, total, beside, self.own.beta], 0.0, 1.0))

    def __call__(self, box: Floats) -> float:
        """Return the misfit at a point of the box."""
        self.runs += 1
        try:
            value = _pair(self.compare(self.rule(box)), self.quantity).misfit
        except StabilityError:
            value = 10.0  # loads that grow are worse than any rule worth considering
        if value < self.best:
            self.best, self.box = value, np.array(box)
        return value

    def run(self, evaluations: int) -> Floats:
        """Return the best point of the box."""
        from scipy.optimize import Bounds, direct, minimize

        box = Bounds(np.zeros(4), np.ones(4))
        self(self.start())
        direct(self, box, maxfun=int(0.7 * evaluations), maxiter=evaluations, locally_biased=True)
        # The best point and its neighbours along every axis, all inside the box.
        inwards = np.diag(np.where(self.box < 0.5, 0.05, -0.05))
        options: Any = {
            "maxfev": max(evaluations - self.runs, 5),
            "initial_simplex": self.box + np.concatenate([np.zeros((1, 4)), inwards]),
            "xatol": 1e-5,
        }
        minimize(self, self.box, method="Nelder-Mead", bounds=box, options=options)
        return self.box


def _pair(comparison: Comparison, quantity: Quantity) -> Pair:
    """Return the displacements or the stresses of a comparison."""
    pair: Pair | None = getattr(comparison, quantity)
    if pair is None:
        raise ParameterError("quantity: the reference knows no stress; fit the displacement")
    return pair
