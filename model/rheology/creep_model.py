"""Time as a Mesa model: every step goes on to the next of the times asked for."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kaju.errors import ParameterError, ResultError
from kaju.mesa_model import SteppedModel
from kaju.model.network import SpringNetwork
from kaju.model.rheology.element import ThreeElement
from kaju.model.rheology.integrate import Drives, StepControl
from kaju.model.rheology.load_history import History
from kaju.model.scene import Scene
from kaju.model.scene.description import HistoryTable
from kaju.stepping import Until

from .creep_result import CreepState
from .creeping import AnyTimeResult, Moment, Rheology, SchemeName, TimeTask


class CreepModel(SteppedModel):
    """What creeps as a Mesa model: it steps in time, is watched, saved, and stepped back.

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
    step, tolerance, scheme, rheology, drive, mass, most_steps
        As for `creep`.
    rng, seed : int, optional
        Seed of the model's random numbers; creep draws none.

    Attributes
    ----------
    moment : float
        The time reached (s).
    running : bool
        Whether a time is left.
    datacollector : mesa.DataCollector
        After every step: time (s), factor of the history, largest displacement (m), and the
        energies (J): work from outside, stored in springs, dissipated in dampers, set free at
        jumps of the load, and what the time stepping itself makes of energy.

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
    >>> model.back()
    >>> model.moment
    5.0
    """

    def __init__(
        self,
        subject: Scene | SpringNetwork | ThreeElement,
        history: History | Mapping[str, Any] | None = None,
        duration: float | None = None,
        *,
        times: ArrayLike | None = None,
        step: float | None = None,
        tolerance: float = 1e-3,
        scheme: SchemeName = "sdirk2",
        rheology: Rheology = None,
        drive: Drives = "both",
        mass: ArrayLike | None = None,
        most_steps: int = 100_000,
        rng: Any = None,
        seed: int | None = None,
    ) -> None:
        super().__init__(rng, seed)
        if not isinstance(subject, (Scene, SpringNetwork, ThreeElement)):
            raise ParameterError(
                "subject: a Scene, a SpringNetwork or a ThreeElement is needed, "
                f"got {subject!r:.80}"
            )
        self.subject = subject
        self.task = TimeTask(
            subject,
            HistoryTable(**history).build() if isinstance(history, Mapping) else history,
            duration,
            times=times,
            control=StepControl(step, tolerance, most_steps),
            scheme=scheme,
            rheology=rheology,
            drive=drive,
            mass=mass,
        )
        self._rheology = rheology
        self._options: dict[str, Any] = {
            "duration": duration,
            "step": step,
            "tolerance": tolerance,
            "scheme": scheme,
            "drive": drive,
            "most_steps": most_steps,
        }
        if mass is not None:
            self._options["mass"] = np.asarray(mass).tolist()
        self.reset()

    @property
    def scene(self) -> Scene | None:
        """The scene that creeps, if it is one."""
        return self.subject if isinstance(self.subject, Scene) else None

    @property
    def network(self) -> SpringNetwork | None:
        """The spring network that creeps, if it is one."""
        return self.subject if isinstance(self.subject, SpringNetwork) else None

    def reset(self) -> None:
        """Go back to the start."""
        self._start_again()
        self.seconds = 0.0
        self._moments: list[Moment] = []
        self._states = [self.task.first]
        self._ahead = self.task.states(self.task.first)
        if self.task.asked[0] == self.task.first.time:
            self._moments.append(self.task.moment(next(self._ahead)))

    def step(self) -> None:
        """Go on to the next of the times asked for."""
        began = perf_counter()
        state = next(self._ahead)
        self._moments.append(self.task.moment(state))
        self._states.append(state)
        self.running = state.time < self.task.asked[-1]
        self.seconds += perf_counter() - began

    def back(self, count: int = 1) -> None:
        """Take back so many steps, and their data.

        Raises
        ------
        ParameterError
            If fewer were made.
        """
        if not 1 <= count < len(self._states):
            raise ParameterError(
                f"count: 1 to {len(self._states) - 1} steps can be taken back, got {count}"
            )
        del self._states[-count:], self._moments[-count:]
        self._ahead = self.task.states(self._states[-1])
        if self._moments and self.task.asked[0] <= self.moment:
            next(self._ahead)  # where it stands already
        self.steps_taken -= count
        self.steps = self.steps_taken
        self.running = True
        self._forget(count)

    @property
    def state(self) -> CreepState:
        """Where it stands, to be given to `creep` as ``resume``."""
        return self._states[-1]

    @property
    def moment(self) -> float:
        """The time reached (s)."""
        return self.state.time

    def figures(self) -> dict[str, float]:
        """Return what is noted after every step: time (s), length (m), energies (J)."""
        now = self.task.result(self._moments[-1:], self.state, self.seconds)
        return {
            "time": self.moment,
            "factor": float(now.factors[-1]),
            "largest_displacement": float(now.largest_displacement()[-1]),
            "work": float(now.work[-1]),
            "stored": float(now.stored[-1]),
            "dissipated": float(now.dissipated[-1]),
            "set_free_at_jumps": float(now.at_jumps[-1]),
            "numerical": float(now.numerical[-1] - now.at_jumps[-1]),
        }

    def run(self, until: Until | None = None) -> AnyTimeResult:
        """Step to the last of the times, or until a question is answered with yes."""
        return self._run(until, self.result)

    def result(self) -> AnyTimeResult:
        """Return what has been seen so far.

        Raises
        ------
        ResultError
            Before the first step, unless the start is among the times asked for.
        """
        if not self._moments:
            raise ResultError("result: no time has passed yet; take a step first")
        return self.task.result(self._moments, self.state, self.seconds)

    def checkpoint_options(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the model's plain arguments, and those that no file can hold."""
        history = self.task.history
        corners = {"times": list(history.times), "factors": list(history.factors)}
        options = self._options | {"history": corners, "times": self.task.asked.tolist()}
        return options, {"rheology": self._rheology}
