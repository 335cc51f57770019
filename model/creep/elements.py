"""Elements that creep each under its own load: one element, or one for every agent."""

from __future__ import annotations

import numpy as np

from kaju.agents.rheology_steps import (
    Energy,
    Laws,
    Stretch,
    force_at_rate,
    rates,
    stage_energy,
    stored_energy,
)
from kaju.arrays import Floats

from .march import Fields, Push


class Elements:
    """Any number of three-element materials that do not feel each other.

    Its state is the stretches of both parts, the force in each element, and the velocity of
    its end (which stays 0 without mass).

    Parameters
    ----------
    laws : Laws
        The elements, arrays of shape (n,).
    share : (n,) floats
        Force (N) or, if `stretched`, elongation (m) of each at a factor of 1.
    stretched : bool
        Whether the elongations are given rather than the forces.
    mass : (n,) floats, optional
        Mass at the loaded end of each (kg).
    """

    def __init__(
        self, laws: Laws, share: Floats, *, stretched: bool = False, mass: Floats | None = None
    ) -> None:
        self.laws = laws
        self.share = share
        self.stretched = stretched
        self.mass = mass

    def start(self) -> Fields:
        """Return the state at time 0: nothing stretched, nothing moving."""
        return tuple(np.zeros((4, len(self.share))))

    def rates(self, fields: Fields, push: Push) -> tuple[Fields, Energy]:
        """Return the rates in an implicit step, and what it adds to the balance."""
        q, d, force, velocity = fields
        state, substep = Stretch(q, d), push.substep
        applied = push.factor * self.share
        velocity_rate = np.zeros_like(velocity)
        if self.stretched:
            speed = (push.displacement_factor * self.share - q - d) / substep
            after = force_at_rate(self.laws, substep, state, speed)
            applied = after
        elif self.mass is None:
            after = applied
        else:
            after, velocity_rate = self._with_mass(state, velocity, applied, substep)
        rate = rates(self.laws, substep, state, after)
        energy = stage_energy(self.laws, push.method, push.step, push.weight, after, rate)
        energy = self._moving(energy, push, rate, applied, velocity_rate)
        return (rate.q, rate.d, (after - force) / substep, velocity_rate), energy

    def _with_mass(
        self, state: Stretch, velocity: Floats, applied: Floats, substep: float
    ) -> tuple[Floats, Floats]:
        """Solve (M/h + damping) v' = M v/h + loads for the force and the acceleration."""
        inertia = self.mass / substep  # type: ignore[operator]
        at_rest = force_at_rate(self.laws, substep, state, 0.0)
        damping = force_at_rate(self.laws, substep, Stretch(0.0 * state.q, state.d), 1.0)
        after = (inertia * velocity + applied - at_rest) / (inertia + damping)
        return at_rest + damping * after, (after - velocity) / substep

    def _moving(
        self, energy: Energy, push: Push, rate: Stretch, applied: Floats, acceleration: Floats
    ) -> Energy:
        """Count the work of the load rather than of the element, and the moving mass."""
        if self.mass is None:
            return energy
        work = push.weight * push.step * float(np.sum(applied * (rate.q + rate.d)))
        own = 0.5 * push.weight * (2.0 * push.method.gamma - push.weight)
        lost = own * float(np.sum(self.mass * np.square(push.step * acceleration)))
        return Energy(work, energy.dissipated, energy.numerical + lost)

    def gauge(self, fields: Fields) -> Floats:
        """Return the stretches of both parts."""
        return np.stack(fields[:2])

    def stored(self, fields: Fields) -> float:
        """Return the energy of the springs and of the moving mass (J)."""
        energy = stored_energy(self.laws, Stretch(fields[0], fields[1]))
        if self.mass is not None:
            energy += float(np.sum(0.5 * self.mass * np.square(fields[3])))
        return energy

    def record(self, fields: Fields) -> tuple[Floats, ...]:
        """Return elongation (m) and force (N) of each element."""
        return fields[0] + fields[1], fields[2]
