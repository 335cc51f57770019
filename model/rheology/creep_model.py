"""Time step by step: every step goes on to the next of the times asked for."""

from __future__ import annotations

from numpy.typing import ArrayLike

from kaju.errors import ParameterError, ResultError
from kaju.model.network import SpringNetwork
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.integrate import Drives, StepControl
from kaju.model.rheology.load_history import History
from kaju.model.scene import Scene
from kaju.model.stepper import Stepper

from .creeping import AnyTimeResult, Moment, Rheology, SchemeName, TimeTask


class CreepModel(Stepper[AnyTimeResult]):
    """What creeps, step by step in time.

    Every step goes on to the next of the times asked for; on the way there, as many time steps
    are made as the tolerance needs. The numbers are those of `creep`.

    Parameters
    ----------
    subject : Scene, SpringNetwork or ThreeElement
        What creeps.
    history : History, optional
        What drives it; of a scene, its own unless given.
    duration : float, optional
        How long (s); by default as long as the history.
    times : array_like, optional
        Where steps end (s), rising; by default 100 even steps, and the corners of the history.
    step, tolerance, scheme, rheology, drive, most_steps
        As for `creep`.

    Attributes
    ----------
    moment : float
        The time reached (s).
    running : bool
        Whether a time is left.

    Raises
    ------
    ParameterError
        If an argument is outside its rule.

    Examples
    --------
    >>> import kaju
    >>> dough = kaju.ThreeElement(K_f=2.0, D_f=1.0, D_d=20.0)
    >>> model = kaju.CreepModel(dough, kaju.History.step().hold(10.0), times=[0, 1, 5, 10])
    >>> model.run(2).displacement.round(3)
    array([0.   , 0.482, 0.75 ])
    >>> model.step()
    >>> model.moment
    10.0
    """

    def __init__(
        self,
        subject: Scene | SpringNetwork | ThreeElement,
        history: History | None = None,
        duration: float | None = None,
        *,
        times: ArrayLike | None = None,
        step: float | None = None,
        tolerance: float = 1e-3,
        scheme: SchemeName = "sdirk2",
        rheology: Rheology = None,
        drive: Drives = "both",
        most_steps: int = 100_000,
    ) -> None:
        if not isinstance(subject, (Scene, SpringNetwork, ThreeElement)):
            raise ParameterError(
                "subject: a Scene, a SpringNetwork or a ThreeElement is needed, "
                f"got {subject!r:.80}"
            )
        self.subject = subject
        self.task = TimeTask(
            subject,
            history,
            duration,
            times=times,
            control=StepControl(step, tolerance, most_steps),
            scheme=scheme,
            rheology=rheology,
            drive=drive,
        )
        self._state = self.task.first
        self._moments: list[Moment] = []
        self._ahead = self.task.states(self._state)
        if self.task.asked[0] == self._state.time:
            self._moments.append(self.task.moment(next(self._ahead)))

    @property
    def scene(self) -> Scene | None:
        """The scene that creeps, if it is one."""
        return self.subject if isinstance(self.subject, Scene) else None

    @property
    def network(self) -> SpringNetwork | None:
        """The spring network that creeps, if it is one."""
        return self.subject if isinstance(self.subject, SpringNetwork) else None

    @property
    def moment(self) -> float:
        """The time reached (s)."""
        return self._state.time

    def advance(self) -> None:
        """Go on to the next of the times asked for."""
        self._state = next(self._ahead)
        self._moments.append(self.task.moment(self._state))
        self.running = self._state.time < self.task.asked[-1]

    def progress(self) -> str:
        """Return the line of progress."""
        return f"{self.moment:.4g} s of {self.task.asked[-1]:.4g} s"

    def result(self) -> AnyTimeResult:
        """Return what has been seen so far.

        Raises
        ------
        ResultError
            Before the first step, unless the start is among the times asked for.
        """
        if not self._moments:
            raise ResultError("result: no time has passed yet; take a step first")
        return self.task.result(self._moments, self._state, self.seconds)
