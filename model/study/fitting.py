"""Which coefficients of the prescribed rule come closest to a reference.

A load either exceeds the threshold or it does not, so the answer jumps where a coefficient passes
certain values, and has no gradients. The search divides the box of coefficients into ever smaller
boxes (Jones, Perttunen & Stuckman 1993, "Lipschitzian optimization without the Lipschitz
constant") and improves the best point by a simplex (Nelder & Mead 1965). Both are deterministic.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, isfinite, sqrt
from time import perf_counter
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from kaju.agents.materials import suggestion
from kaju.agents.rules import PrescribedRule
from kaju.arrays import Floats
from kaju.errors import ParameterError, StabilityError
from kaju.model.results.result import BodyResult
from kaju.model.scene import Scene, scene_needed
from kaju.model.study.compare import AnyAnswer, Comparison, Pair, Settling, compare
from kaju.model.study.reference import Reference
from kaju.model.study.solving import solve
from kaju.model.transfer.load_model import LoadModel
from kaju.model.transfer.transfer_result import TransferResult

Quantity = Literal["displacement", "stress"]
Believed = AnyAnswer | Reference | Settling

GLOBAL_SHARE = 0.7  # part of the evaluations that go into the search of the whole box
UNSTABLE = 10.0  # misfit of a rule whose loads would grow: worse than any worth considering
LEAST_BESIDE = 0.02  # at least this part of what is passed on goes beside the load's line
LARGEST_SHARE = 0.98  # no load is passed on in a larger piece, so that all of them end
CELLS_ACROSS = {2: 160, 3: 48}  # cells of a believed answer across a body, by default
SIMPLEX = 0.05  # edge of the first simplex, in the box


class Misfit(NamedTuple):
    """How far one quantity of one scene was off before the fit, and is after it.

    As the norm of the difference over that of the reference: 1 is no better than nothing.
    """

    scene: int  # from 0
    quantity: Quantity
    weight: float  # how much it counted; 0 if it was only watched
    before: float
    after: float


@dataclass(frozen=True, eq=False)
class Fit:
    """The coefficients that were found."""

    rule: PrescribedRule  # the first scene's with the fitted α and β, for `Scene.replace(rule=...)`
    comparisons: tuple[tuple[Comparison, Comparison], ...]
    """For every scene its own rule, and the fitted one, against the reference."""
    misfits: tuple[Misfit, ...]  # of every quantity of every scene, whether it was fitted or not
    history: Floats  # least weighted misfit up to each run of the rule, shape (evaluations,)
    seconds: float  # time that the search took (s)
    notes: tuple[str, ...] = ()  # what a reader of the figures should know

    @property
    def before(self) -> Comparison:
        """The first scene's own rule against the reference."""
        return self.comparisons[0][0]

    @property
    def after(self) -> Comparison:
        """The fitted rule on the first scene against the reference."""
        return self.comparisons[0][1]

    @property
    def quantity(self) -> str:
        """What was fitted."""
        return " and ".join(dict.fromkeys(row.quantity for row in self.misfits if row.weight))

    @property
    def evaluations(self) -> int:
        """How often the rule was run on all scenes."""
        return len(self.history)

    @property
    def misfit(self) -> tuple[float, float]:
        """Weighted misfit of what was fitted, before and after."""
        weights = [row.weight for row in self.misfits]
        before = _weighted([row.before for row in self.misfits], weights)
        return before, _weighted([row.after for row in self.misfits], weights)

    @property
    def trade_off(self) -> str:
        """What has become worse, and what better for it; empty if nothing has become worse."""
        worse = [row for row in self.misfits if row.after > row.before]
        if not worse:
            return ""
        better = [row for row in self.misfits if row.after < row.before]
        unfitted = any(row.weight == 0.0 for row in worse)
        remedy = "; quantity={'displacement': 1, 'stress': 1} weighs both" if unfitted else ""
        gained = f"{self._listed(better)} got better, but " if better else ""
        return f"{gained}{self._listed(worse)} got worse{remedy}"

    def _listed(self, rows: Sequence[Misfit]) -> str:
        several = len(self.comparisons) > 1
        return ", ".join(
            f"{row.quantity}{f' of scene {row.scene + 1}' if several else ''} "
            f"({row.before:.3g} to {row.after:.3g})"
            for row in rows
        )

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        before, after = self.misfit
        return {
            "alpha": list(self.rule.alpha or ()),
            "beta": self.rule.beta,
            "fitted": self.quantity,
            "misfit_before": before,
            "misfit_after": after,
            "misfits": [row._asdict() for row in self.misfits],
            "trade_off": self.trade_off or None,
            "runs": self.evaluations,
            "seconds": self.seconds,
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        assert self.rule.alpha is not None
        before, after = self.misfit
        alpha = ", ".join(f"{share:.4g}" for share in self.rule.alpha)
        text = (
            f"alpha = ({alpha}), beta = {self.rule.beta:.4g}: misfit of the {self.quantity} "
            f"{before:.3g} before, {after:.3g} after, {self.evaluations} runs"
        )
        return "; ".join([text, *filter(None, [self.trade_off]), *self.notes])


def elastic_reference(scene: Scene, resolution: int | None = None) -> BodyResult:
    """Return the answer of elasticity, by default on cells fine enough to be believed."""
    if resolution is None:
        across = CELLS_ACROSS[scene.lattice.dimension]
        resolution = min(8, max(1, across // max(scene.lattice.shape)))
    return solve(scene, resolution=resolution, strategy="uniform")


def fit_rule(
    scene: Scene | Sequence[Scene],
    reference: Believed | Sequence[Believed] | None = None,
    *,
    quantity: Quantity | Mapping[Quantity, float] = "displacement",
    weights: Sequence[float] | None = None,
    points: ArrayLike | None = None,
    most_passed_on: float = 1.0,
    evaluations: int = 600,
    seconds: float = 60.0,
) -> Fit:
    """Find α and β that bring the prescribed rule closest to references on scenes.

    The coefficients fit these bodies under these loads, and no others. Made small is the root of
    the weighted mean square of all misfits; the result lists what got worse for it.

    Parameters
    ----------
    scene : Scene, or several
        With a `PrescribedRule`; its threshold and kind of adding up are kept, coefficients of
        single materials are given up.
    reference : BodyResult, ElasticRun or Reference, or one for each scene, optional
        What to come close to; by default the answers of elasticity.
    quantity : {"displacement", "stress"} or mapping
        Whose misfit to make small: the norm of the difference over that of the reference.
        ``{"displacement": 1, "stress": 2}`` weighs several.
    weights : sequence of float, optional
        How much each scene counts; all alike unless given.
    points : array, shape (n, dimension), optional
        Where to compare (m); as for `compare`.
    most_passed_on : float
        α₂ + 2 (dimension - 1) α₃ is at most this. 1: no more than the load. Above 1 loads
        multiply on their way: displacements spread farther, but stresses count load twice.
    evaluations : int
        Runs of the rule on all scenes, about.
    seconds : float
        The search ends after so long (s) with the best found until then, and says so.

    Returns
    -------
    Fit

    Raises
    ------
    ParameterError
        If a scene's rule is another one, or an argument breaks its rule.
    ResultError
        If scene and reference cannot be compared.

    Examples
    --------
    >>> import kaju
    >>> scene = kaju.Scene(
    ...     body={"cell_size": 0.01, "cells": [6, 6], "material": "steel"},
    ...     sides={"bottom": "rigid"},
    ...     loads=[{"cell": [3, 5], "force": [0.0, -2.0]}],
    ... )
    >>> fit = kaju.fit_rule(scene, quantity={"displacement": 1, "stress": 1}, evaluations=60)
    >>> before, after = fit.misfit
    >>> after < before
    True
    """
    began = perf_counter()
    scenes = [scene] if isinstance(scene, Scene) or not isinstance(scene, Sequence) else [*scene]
    wanted: dict[Quantity, float] = {quantity: 1.0} if isinstance(quantity, str) else dict(quantity)
    counted = [1.0] * len(scenes) if weights is None else list(weights)
    _check(scenes, wanted, counted, most_passed_on, evaluations, seconds)
    if reference is None:
        references: list[Believed] = [elastic_reference(one) for one in scenes]
    else:
        references = list(reference) if isinstance(reference, Sequence) else [reference]
    if len(references) != len(scenes):
        raise ParameterError(
            f"reference: one for each of the {len(scenes)} scenes is needed, got {len(references)}"
        )
    cases = [
        _Case(one, believed, {name: weight * share for name, share in wanted.items()}, points)
        for one, believed, weight in zip(scenes, references, counted, strict=True)
    ]
    search = _Search(cases, most_passed_on, began + seconds)
    best = search.run(evaluations)
    pairs = tuple((case.before, case.compare(search.rule(case, best))) for case in cases)
    misfits = tuple(
        Misfit(number, name, case.weights.get(name, 0.0), first.misfit, _pair(after, name).misfit)
        for number, (case, (before, after)) in enumerate(zip(cases, pairs, strict=True))
        for name in get_args(Quantity)
        if (first := getattr(before, name)) is not None
    )
    notes: tuple[str, ...] = ()
    if search.ended_early:
        notes = (f"ended after {seconds:g} s with {len(search.found)} of {evaluations} runs",)
    history = np.minimum.accumulate(np.array(search.found))
    rule = search.rule(cases[0], best)
    return Fit(rule, pairs, misfits, history, perf_counter() - began, notes)


def _check(
    scenes: list[Scene],
    quantities: Mapping[Quantity, float],
    weights: list[float],
    most_passed_on: float,
    evaluations: int,
    seconds: float,
) -> None:
    for scene in scenes:
        scene_needed(scene)
        if not isinstance(scene.rule, PrescribedRule):
            raise ParameterError(
                f"scene: its rule is {scene.rule.kind!r}; the coefficients of a prescribed rule "
                "can be fitted, so replace it: scene.replace(rule=PrescribedRule())"
            )
    if len({scene.lattice.dimension for scene in scenes}) != 1:
        raise ParameterError(
            "scene: all must be in the plane, or all in space, where a load has more neighbours "
            "beside it; fit them apart"
        )
    for name in quantities:
        if name not in get_args(Quantity):
            raise ParameterError(
                f"quantity: 'displacement' or 'stress', got {name!r}"
                f"{suggestion(str(name), get_args(Quantity))}"
            )
    if len(weights) != len(scenes):
        raise ParameterError(
            f"weights: one for each of the {len(scenes)} scenes is needed, got {len(weights)}"
        )
    for key, each in (("quantity", list(quantities.values())), ("weights", weights)):
        if not (all(isfinite(w) and w >= 0.0 for w in each) and sum(each) > 0.0):
            raise ParameterError(
                f"{key}: weights from 0 upwards, not all 0, are needed, got {each}"
            )
    if not 0.0 < most_passed_on <= 2.0:
        raise ParameterError(
            f"most_passed_on: must lie above 0 and up to 2, got {most_passed_on}; above 1 loads "
            "multiply on their way"
        )
    if evaluations < 10:
        raise ParameterError(f"evaluations: 10 or more are needed, got {evaluations}")
    if not (isfinite(seconds) and seconds > 0.0):
        raise ParameterError(f"seconds: a time above 0 s is needed, got {seconds}")


class _Case:
    """One scene, what is believed about it, and how much each of its misfits counts."""

    def __init__(
        self,
        scene: Scene,
        reference: Believed,
        weights: Mapping[Quantity, float],
        points: ArrayLike | None,
    ) -> None:
        assert isinstance(scene.rule, PrescribedRule)
        # The last stage alone counts, and each is run from the start.
        self.scene, self.rule, self.weights = scene.in_one_step(), scene.rule, weights
        first = LoadModel(self.scene, engine="arrays", allow_unstable=True).run()
        self.before = compare(first, reference, points=points)
        self.own = [_pair(self.before, name).misfit for name in weights]

    def _run(self, rule: PrescribedRule) -> TransferResult:
        return LoadModel(self.scene.replace(rule=rule), engine="arrays").run()

    def compare(self, rule: PrescribedRule) -> Comparison:
        """Compare a rule with the reference, where the first one was compared."""
        return compare(self._run(rule), self.before.reference, points=self.before.points)

    def misfits(self, rule: PrescribedRule) -> list[float]:
        """Return the misfits of a rule that count."""
        result, found = self._run(rule), []
        for name in self.weights:
            at = result.stress_at if name == "stress" else result.displacement_at
            wanted = _pair(self.before, name)
            found.append(replace(wanted, values=at(self.before.points)).misfit)
        return found


class _TimeIsUpError(Exception):
    """The time is up."""


class _Search:
    """The misfit as a function of four numbers between 0 and 1.

    These are α₁, the share passed on along the load as a part of the most that may be, the
    part of it that goes beside, and β. So every corner of the box is a rule whose loads end
    if each is judged by itself.
    """

    def __init__(self, cases: list[_Case], most_passed_on: float, deadline: float) -> None:
        self.cases, self.most, self.deadline = cases, most_passed_on, deadline
        self.beside = 2 * (cases[0].scene.lattice.dimension - 1)
        self.weights = [weight for case in cases for weight in case.weights.values()]
        own = [misfit for case in cases for misfit in case.own]
        self.found = [_weighted(own, self.weights)]
        self.best, self.box = np.inf, self.start()
        self.ended_early = False

    def rule(self, case: _Case, box: Floats) -> PrescribedRule:
        """Return a scene's rule at a point of the box."""
        own, total, across, beta = (float(x) for x in np.clip(box, 0.0, 1.0))
        across = LEAST_BESIDE + (1.0 - LEAST_BESIDE) * across
        passed = self.most * total * np.array([1.0 - across, across / self.beside])
        forward, friction = (float(share) for share in np.minimum(passed, LARGEST_SHARE))
        alpha = (own, forward, friction)
        return replace(case.rule, alpha=alpha, beta=beta, materials={})

    def start(self) -> Floats:
        """Return the point of the box nearest to the first scene's own rule."""
        scene, rule = self.cases[0].scene, self.cases[0].rule
        shares = rule.shares(scene.cell_materials[0], scene.lattice.dimension)
        total = shares.forward + self.beside * shares.friction
        across = self.beside * shares.friction / total if total > 0.0 else 0.5
        beside = (across - LEAST_BESIDE) / (1.0 - LEAST_BESIDE)
        box = np.array([shares.own, total / self.most, beside, rule.beta])
        return np.asarray(np.clip(box, 0.0, 1.0))

    def __call__(self, box: Floats) -> float:
        """Return the weighted misfit at a point of the box."""
        if perf_counter() > self.deadline and len(self.found) > 1:
            raise _TimeIsUpError
        try:
            misfits = [m for case in self.cases for m in case.misfits(self.rule(case, box))]
            value = _weighted(misfits, self.weights)
        except StabilityError:
            value = UNSTABLE
        self.found.append(value)
        if value < self.best:
            self.best, self.box = value, np.array(box)
        return value

    def run(self, evaluations: int) -> Floats:
        """Return the best point of the box."""
        from scipy.optimize import Bounds, direct, minimize

        box = Bounds(np.zeros(4), np.ones(4))
        try:
            self(self.start())
            most = int(GLOBAL_SHARE * evaluations)
            direct(self, box, maxfun=most, maxiter=evaluations, locally_biased=True)
            # The best point and its neighbours along every axis, all inside the box.
            inwards = np.diag(np.where(self.box < 0.5, SIMPLEX, -SIMPLEX))
            options: Any = {
                "maxfev": max(evaluations - len(self.found), 5),
                "initial_simplex": self.box + np.concatenate([np.zeros((1, 4)), inwards]),
                "xatol": 1e-5,
            }
            minimize(self, self.box, method="Nelder-Mead", bounds=box, options=options)
        except _TimeIsUpError:
            self.ended_early = True
        return self.box


def _weighted(misfits: Sequence[float], weights: Sequence[float]) -> float:
    """Return the root of the weighted mean square."""
    whole = sum(weights)
    return hypot(*(sqrt(w / whole) * m for m, w in zip(misfits, weights, strict=True)))


def _pair(comparison: Comparison, quantity: Quantity) -> Pair:
    """Return the displacements or the stresses of a comparison."""
    pair: Pair | None = getattr(comparison, quantity)
    if pair is None:
        raise ParameterError("quantity: the reference knows no stress; fit the displacement")
    return pair
