"""Springs or cells that break one at a time: every step scales the load to the next break."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Floats, first_largest
from kaju.errors import MechanismError, SceneError, brief, by_name, require
from kaju.model.network import SpringNetwork, hexagon_body
from kaju.model.network.assembler import Assembler, spring_geometry
from kaju.model.network.equilibrium import SingularTangentError, tangent_error
from kaju.model.scene import Scene
from kaju.model.stepper import Stepper

from .breaking_bodies import Measure
from .fracture_result import COLUMNS, FractureResult, body_of, parts_of

PARTED = "parted: what is left hardly resists the load, or not at all"


class FractureModel(Stepper[FractureResult]):
    """A network or a body whose springs or cells break, one at a time.

    The load is scaled, up or down, to the factor at which the next one breaks: the one whose load
    is the largest share of its strength. Then the others take over its force. Displacements are
    small. Springs and cells break when they are pulled, not when they are pressed. The run ends
    when the body parts; that is not an error.

    Parameters
    ----------
    subject : SpringNetwork or Scene
        What breaks, under forces or given displacements: those of the only stage of a network, or
        of the last of a scene, of which cells break; hexagons are a network of springs.
    strength : float or (m,) floats
        Mean strength of the springs or the cells (row by row); with `weibull` the scale. By default
        1 for springs; cells need one.
    measure : {"force", "stress", "strain", "energy"}, optional
        What must not exceed the strength: tension of a spring (N) or largest principal stress of a
        cell (Pa), the defaults; largest strain; or energy (J), of a cell that is pulled.
    scatter : float
        Strengths are spread evenly over (1 ± scatter) times the mean.
    weibull : float, optional
        Modulus of a Weibull distribution of strengths, in the place of the even spread.
    most_breaks : int, optional
        Breaks after which to end; None: no limit.
    seed : int
        Seed of the strengths.

    Raises
    ------
    ParameterError
        If a number is outside its rule.
    SceneError
        If the subject cannot break: stretched from the start, of several stages of a network's
        load, under forces and given displacements or weight, of true outlines.
    MechanismError
        If the unbroken body already gives way without resistance.

    Notes
    -----
    At every step the work of the loads is what is stored plus what is released: ½ T e' of a spring
    with tension T whose gap opens to e'. A broken cell keeps 1e-10 of its stiffness.

    Cells do not resolve the tip of a crack: where stress is singular, the load at which a cell
    breaks depends on its size h, as 1/√h. The strength holds for cells of this size.

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

    @by_name
    def __init__(
        self,
        subject: SpringNetwork | Scene,
        *,
        strength: ArrayLike | None = None,
        measure: Measure | None = None,
        scatter: float = 0.1,
        weibull: float | None = None,
        most_breaks: int | None = None,
        seed: int = 0,
    ) -> None:
        right = isinstance(subject, SpringNetwork | Scene)
        require(right, f"subject: a SpringNetwork or a Scene is needed, got {brief(subject)}")
        ends = most_breaks is None or most_breaks >= 1
        require(ends, f"most_breaks: at least 1, got {most_breaks}")
        self.subject = _breakable(subject)
        cells = isinstance(self.subject, Scene)
        self._measure: Measure = measure or ("stress" if cells else "force")
        require(
            strength is not None or not cells,
            "strength: is needed for cells: that of the material at cells of this size, such as "
            "strength=250e6 (Pa); a strain (1e-3) or an energy (J) by these measures",
        )
        self._most = most_breaks
        mean, draw = 1.0 if strength is None else strength, np.random.default_rng(seed)
        self.strengths = self._drawn_strengths(mean, scatter, weibull, draw)
        try:
            self._body = body_of(self.subject, self.strengths, self._measure)
        except SingularTangentError as weakness:
            raise _mechanism(self.subject, weakness) from None
        self.outcome = ""
        """Why no step is left; "" while one is."""
        self.load_factor = self._work = self._released = 0.0
        self._rows: list[tuple[float, ...]] = []
        self._unbroken = self._resistance()
        self._end_where_nothing_breaks()

    def _drawn_strengths(
        self, strength: ArrayLike, scatter: float, weibull: float | None, draw: np.random.Generator
    ) -> Floats:
        """Return the strengths of springs or cells, shape (m,)."""
        count = parts_of(self.subject)
        scale = np.asarray(strength, dtype=np.float64)
        require(
            scale.shape in ((), (count,)),
            f"strength: one number, or one for each of the {count} that may break, got shape "
            f"{scale.shape}",
        )
        strong = bool(np.isfinite(scale).all() and (scale > 0.0).all())
        require(strong, f"strength: must be finite and above 0, got {brief(strength)}")
        require(0.0 <= scatter < 1.0, f"scatter: a share from 0 to below 1, got {scatter}")
        if weibull is None:
            return np.asarray(scale * (1.0 + scatter * draw.uniform(-1.0, 1.0, count)))
        require(0.0 < weibull < np.inf, f"weibull: a modulus above 0, got {weibull}")
        return np.asarray(scale * draw.weibull(weibull, count))

    @property
    def breaks(self) -> int:
        """Number of springs or cells that have broken."""
        return len(self._body.broken)

    def advance(self) -> None:
        """Scale the load to the next break, and take that part out."""
        body = self._body
        shares = body.shares
        place = first_largest(shares)
        factor, stored = 1.0 / float(shares[place]), body.stored
        if body.pull:  # how far the whole load moves (m) along itself, and its force (N)
            moved, pulled = body.yielded / body.pull, body.pull
        else:
            moved, pulled = body.shift, body.pushed / body.shift
        # Up or down to this load nothing breaks: the work grows with its square.
        self._work += 0.5 * (factor**2 - self.load_factor**2) * self._resistance()
        self.load_factor = factor
        yielded = body.yielded
        try:
            part, released = body.break_part(place)
        except SingularTangentError:
            # The load falls freely; the energy released is what the body held.
            part, released = body.broken[-1], stored
            self.outcome = PARTED
            stored = 0.0
        else:
            self._work += factor**2 * (body.yielded - yielded)
            stored = factor**2 * body.stored
        self._released += factor**2 * released
        row = (factor * moved, factor * pulled, stored, self._released, self._work)
        self._rows.append((part, factor, *row))
        self._end_where_nothing_breaks()

    def _end_where_nothing_breaks(self) -> None:
        """Say why no step is left, if none is."""
        body, shares, resisting = self._body, self._body.shares, self._resistance()
        if not self.outcome:
            if resisting <= body.parted * self._unbroken:
                self.outcome = PARTED
            elif shares.max() <= 1e-9 * np.abs(shares).max():
                self.outcome = "nothing that is left is pulled: at no load will more break"
            elif self.breaks == self._most:
                self.outcome = f"ended after {self._most} breaks, as asked"
        self.running = not self.outcome

    def _resistance(self) -> float:
        """Return the work of the whole load (J): none where nothing is left that resists."""
        return self._body.yielded + self._body.pushed

    def progress(self) -> str:
        """Return the line of progress."""
        return f"break {self.breaks}: load factor {self.load_factor:.4g}"

    def result(self) -> FractureResult:
        """Return what has broken so far."""
        rows = np.array(self._rows).reshape(-1, len(COLUMNS)).T
        columns = dict(zip(COLUMNS, rows, strict=True))
        return FractureResult(
            subject=self.subject,
            strengths=self.strengths,
            measure=self._measure,
            broken=columns.pop("broken").astype(np.int64),
            **columns,
            outcome=self.outcome,
            seconds=self.seconds,
        )


def _breakable(subject: SpringNetwork | Scene) -> SpringNetwork | Scene:
    """Return what is to break, hexagons as a network, or say why it cannot."""
    if isinstance(subject, Scene) and subject.lattice.boxes:
        pushed = bool(subject.applied().force.any())
        moved = any(side.displacement for side in subject.sides.values())
    else:
        if isinstance(subject, Scene):
            network = hexagon_body(subject)
            subject = network.with_loads(network.forces[-1], network.displacements[-1])
        if subject.stages > 1:
            raise SceneError(
                "loads: must have one stage, which is scaled until springs break, got "
                f"{subject.stages}; give the forces (or displacements) of one of them: "
                "network.with_loads(...)"
            )
        stretched = np.abs(subject.prestretch) > 1e-9 * subject.initial_length
        if stretched.any():
            spring = int(np.flatnonzero(stretched)[0])
            raise SceneError(
                f"rest_length: spring {spring} is stretched by {subject.prestretch[spring]:.3g} m "
                "before any load; a network that breaks must be free of force at first "
                "(rest_length=None)"
            )
        pushed, moved = bool(subject.forces.any()), bool(subject.displacements.any())
    if pushed == moved:
        found = "both" if pushed else "neither"
        raise SceneError(
            "loads: either forces or given displacements are needed, to be scaled until "
            f"something breaks, got {found}"
        )
    return subject


def _mechanism(body: SpringNetwork | Scene, weakness: SingularTangentError) -> MechanismError:
    """Return the error that names the nodes which nothing holds."""
    if isinstance(body, Scene):
        return MechanismError(
            "body: some of its cells hang together by single faces, about which they turn freely; "
            "give smaller cells (scene.refine(2))"
        )
    geometry = spring_geometry(body, np.zeros_like(body.positions))
    error = tangent_error(Assembler(body), geometry, body.stiffness, weakness.direction, 0.0)
    assert isinstance(error, MechanismError)
    return error
