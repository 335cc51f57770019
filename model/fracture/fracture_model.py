"""Springs that break one at a time, as a Mesa model: every step scales the load to the next."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import first_largest
from kaju.errors import MechanismError, ParameterError, SceneError
from kaju.mesa_model import SteppedModel
from kaju.model.network import SpringNetwork
from kaju.model.network.assembler import Assembler
from kaju.model.network.equilibrium import tangent_error
from kaju.model.network.linear import GivesWayError
from kaju.model.network.network_result import network_archive, network_from
from kaju.model.results.archive import Archive
from kaju.model.scene import Scene
from kaju.stepping import Until

from .breaking import BreakingNetwork
from .fracture_result import COLUMNS, FractureResult
from .strength import Measure, drawn_strengths, elongation_limits

PARTED = "parted: what is left hardly resists the load, or not at all"
UNBROKEN = "no spring that is left is pulled: at no load will another break"

_ROUNDING = 1e-9
"""Share of others below which an elongation or a work is none, but for rounding."""


class FractureModel(SteppedModel):
    """A spring network whose springs break one at a time, where their strength is exceeded.

    The load is scaled, up or down, to the factor at which the next spring breaks: the one whose
    elongation is the largest share of what it survives. Then its force goes to the others.
    Displacements are small: the answer is linear in the load as long as nothing breaks.
    Springs break when they are pulled, not when they are pressed. A network that parts has come
    to its end; that is no error.

    Parameters
    ----------
    subject : SpringNetwork or Scene
        What breaks, under the loads of its one stage, forces or given displacements; of a scene
        with hexagonal cells the network that stands for it, under all its loads.
    strength : float or (m,) floats
        Mean strength of the springs; with `weibull` its scale.
    measure : {"force", "strain", "energy"}
        What is exceeded: tension (N), elongation as a share of the length, or energy (J).
    scatter : float
        Strengths are spread evenly over (1 ± scatter) times the mean.
    weibull : float, optional
        Modulus of a Weibull distribution of strengths, in the place of the even spread.
    most_breaks : int, optional
        Springs after which to end; none: as many as there are.
    rng, seed : int, optional
        Seed of the strengths.

    Attributes
    ----------
    running : bool
        Whether a step is left.
    outcome : str
        Why there is none; "" while there is.
    load_factor : float
        Share of the load at which the last spring broke.
    datacollector : mesa.DataCollector
        The last row of the history after every step.

    Raises
    ------
    ParameterError
        If a number is outside its rule.
    SceneError
        If the subject is nothing that can break: springs stretched from the start, several
        stages of the load, forces beside given displacements.
    MechanismError
        If the network resists the load not even unbroken.

    See Also
    --------
    kaju.NetworkModel : the same networks under large displacements, unbroken.

    Notes
    -----
    When a spring with tension T and elongation e breaks, and the gap then opens to e', the
    energy ½ T e' is released under the fixed load; the work of the loads is what is stored and
    what is released, at every step.

    References
    ----------
    L. de Arcangelis, S. Redner, H. J. Herrmann, "A random fuse model for breaking processes",
    Journal de Physique Lettres 46 (1985) 585-590.

    Examples
    --------
    Three fibres side by side, of strengths 1, 2 and 3 N:

    >>> import kaju
    >>> fibres = kaju.SpringNetwork.build(
    ...     [[0, 0], [1, 0]], [[0, 1]] * 3, held=[[1, 1], [0, 1]], forces=[[0, 0], [1, 0]]
    ... )
    >>> broken = kaju.FractureModel(fibres, strength=[1.0, 2.0, 3.0], scatter=0.0).run()
    >>> broken.load_factor.round(9)
    array([3., 4., 3.])
    >>> broken.outcome
    'parted: what is left hardly resists the load, or not at all'
    """

    def __init__(
        self,
        subject: SpringNetwork | Scene,
        *,
        strength: ArrayLike = 1.0,
        measure: Measure = "force",
        scatter: float = 0.1,
        weibull: float | None = None,
        most_breaks: int | None = None,
        rng: Any = None,
        seed: int | None = None,
    ) -> None:
        super().__init__(rng, seed)
        if not isinstance(subject, (SpringNetwork, Scene)):
            raise ParameterError(
                f"subject: a SpringNetwork or a Scene is needed, got {subject!r:.80}"
            )
        if most_breaks is not None and most_breaks < 1:
            raise ParameterError(f"most_breaks: at least 1, got {most_breaks}")
        self.subject = subject
        self.network = _breakable(subject)
        self._options: dict[str, Any] = {
            "measure": measure,
            "scatter": scatter,
            "weibull": weibull,
            "most_breaks": most_breaks,
        }
        self._strength = strength
        self.reset()

    def reset(self) -> None:
        """Go back to the unbroken network, with the same strengths."""
        self._start_again()
        self.seconds = 0.0
        began = perf_counter()
        options = self._options
        self.strengths = drawn_strengths(
            len(self.network.springs),
            self._strength,
            options["scatter"],
            options["weibull"],
            self.rng,
        )
        limits = elongation_limits(self.network, self.strengths, options["measure"])
        try:
            self._left = BreakingNetwork(self.network, limits)
        except GivesWayError as weakness:
            raise _mechanism(self.network, weakness) from None
        self.outcome = ""
        self.load_factor = self._work = self._released = 0.0
        self._rows: list[tuple[float, ...]] = []
        self._end_where_nothing_breaks()
        self.seconds += perf_counter() - began
        self._note()

    @property
    def breaks(self) -> int:
        """Number of springs that have broken."""
        return len(self._left.broken)

    def step(self) -> None:
        """Scale the load to the next break, and take that spring out."""
        began = perf_counter()
        left = self._left
        share = left.elongation / left.limit
        joint = first_largest(share)
        factor = 1.0 / float(share[joint])
        elongation, stored = float(left.elongation[joint]), left.stored
        moved, pulled = self._response()
        # Up or down to this load nothing breaks: the work grows with its square.
        self._work += 0.5 * (factor**2 - self.load_factor**2) * self._resistance()
        self.load_factor = factor
        yielded = left.yielded
        try:
            spring = left.break_weakest(joint)
        except GivesWayError:
            # The load falls freely; what is told is the energy that the springs held.
            spring = left.broken[-1]
            self.outcome = PARTED
            self._released += factor**2 * stored
            stored = 0.0
        else:
            gap = float(left.elongation[joint])
            tension = float(self.network.stiffness[spring]) * elongation
            self._released += 0.5 * factor**2 * tension * gap
            self._work += factor**2 * (left.yielded - yielded)
            stored = factor**2 * left.stored
        row = (factor * moved, factor * pulled, stored, self._released, self._work)
        self._rows.append((spring, factor, *row))
        self._end_where_nothing_breaks()
        self.seconds += perf_counter() - began

    def _response(self) -> tuple[float, float]:
        """Return how far the whole load moves (m) along itself, and its force (N)."""
        forces, given = self.network.forces[-1], self.network.displacements[-1]
        if forces.any():
            force = float(np.linalg.norm(forces, axis=1).sum())
            return self._left.yielded / force, force
        moved = float(np.linalg.norm(given, axis=1).max())
        return moved, self._left.pushed / moved

    def _end_where_nothing_breaks(self) -> None:
        """Say why no step is left, if none is."""
        left, most = self._left, self._options["most_breaks"]
        share, resisting = left.elongation / left.limit, self._resistance()
        if not self.breaks:
            self._unbroken = resisting
        if not self.outcome:
            if resisting <= _ROUNDING * self._unbroken:
                self.outcome = PARTED
            elif share.max() <= _ROUNDING * np.abs(share).max():
                self.outcome = UNBROKEN
            elif self.breaks == most:
                self.outcome = f"ended after {most} breaks, as asked"
        self.running = not self.outcome

    def _resistance(self) -> float:
        """Return the work of the whole load (J): none where nothing is left that resists."""
        return self._left.yielded + self._left.pushed

    def figures(self) -> dict[str, float]:
        """Return what is noted after every step; lengths (m), forces (N), energies (J)."""
        row = self._rows[-1] if self._rows else (-1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        return dict(zip(COLUMNS, row, strict=True))

    def run(self, until: Until | None = None) -> FractureResult:
        """Break springs until the network parts, or a question is answered with yes."""
        return self._run(until, self.result)

    def result(self) -> FractureResult:
        """Return what has broken so far."""
        rows = np.array(self._rows).reshape(-1, len(COLUMNS)).T
        columns = dict(zip(COLUMNS, rows, strict=True))
        return FractureResult(
            network=self.network,
            strengths=self.strengths,
            measure=self._options["measure"],
            spring=columns.pop("spring").astype(np.int64),
            **columns,
            outcome=self.outcome,
            seconds=self.seconds,
        )

    def checkpoint_options(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the model's plain arguments, and those that no file can hold."""
        return self._options | {"strength": np.asarray(self._strength).tolist()}, {}

    def checkpoint_parts(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return what breaks as arrays and plain values."""
        return network_archive(self.network)

    @staticmethod
    def checkpoint_subject(archive: Archive) -> Any:
        """Return the network that `checkpoint_parts` took apart."""
        return network_from(archive)


def _breakable(subject: SpringNetwork | Scene) -> SpringNetwork:
    """Return the network to break, or say why there is none."""
    if isinstance(subject, Scene):
        network = SpringNetwork.from_scene(subject)
        network = network.with_loads(network.forces[-1], network.displacements[-1])
    else:
        network = subject
    if network.stages > 1:
        raise SceneError(
            f"loads: one load is scaled until springs break, got {network.stages} stages; "
            "give the forces (or displacements) of one of them: network.with_loads(...)"
        )
    stretched = np.abs(network.prestretch) > 1e-9 * network.initial_length
    if stretched.any():
        spring = int(np.flatnonzero(stretched)[0])
        raise SceneError(
            f"rest_length: spring {spring} is stretched by {network.prestretch[spring]:.3g} m "
            "before any load; springs that break are free of force at first"
        )
    pushed, moved = network.forces.any(), network.displacements.any()
    if pushed == moved:
        found = "both" if pushed else "neither"
        raise SceneError(
            f"loads: forces or given displacements are scaled until springs break, got {found}"
        )
    return network


def _mechanism(network: SpringNetwork, weakness: GivesWayError) -> MechanismError:
    """Return the error that names the nodes which nothing holds."""
    assembler = Assembler(network)
    geometry = assembler.geometry(np.zeros_like(network.positions))
    stiffness = network.stiffness
    error = tangent_error(assembler, geometry, stiffness, weakness.direction, 0.0)
    assert isinstance(error, MechanismError)
    return error
