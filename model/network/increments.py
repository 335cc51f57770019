"""A network loaded step by step: forward Euler in the load, or in equilibrium at every step.

*Euler* (the linearised method): solve A(xⁿ) a = ΔF with the tangent A of the present state,
then xⁿ⁺¹ = xⁿ + a. What it misses grows in proportion to the size of the increments.
*Newton*: the same step, then corrections until springs and loads are in balance, so the
state does not depend on how it was reached. Increments that are too large for this are cut
in halves without a word: the states at the ends of the increments stay the same.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kaju.arrays import Floats
from kaju.errors import ConvergenceError, ParameterError, TangentError, require
from kaju.model.stepper import Stepper

from .assembler import Assembler, Geometry, spring_forces, spring_geometry
from .equilibrium import (
    DirectSolver,
    NetworkState,
    SingularTangentError,
    find_balance,
    solve_tangent,
    tangent_error,
)
from .network_result import NetworkResult, Scheme
from .springs import SpringNetwork


class JumpError(ConvergenceError):
    """The balance that was found lies far from where the network was."""


class NetworkModel(Stepper[NetworkResult]):
    """A spring network on its way along its load path: a step takes one increment.

    Parameters
    ----------
    network : SpringNetwork
        What is loaded.
    increments : int
        Number of increments in every stage.
    scheme : {"newton", "euler"}
        With corrections to balance, or the plain linearised step. Of the latter only the states
        that a step starts from are checked for stability, not the last one.
    tolerance : float
        Largest unbalanced force of the Newton scheme, as a share of the largest force.

    Attributes
    ----------
    running : bool
        Whether a step is left.

    Raises
    ------
    ParameterError
        If an argument is outside its rule.
    MechanismError, BucklingError
        If the network gives way; `result` of the error is what was reached before.
    ConvergenceError
        If an increment is too large.

    Examples
    --------
    >>> from kaju import NetworkModel
    >>> from kaju.model.network import triangular
    >>> model = NetworkModel(triangular(5, force=0.1), increments=4)
    >>> model.step()
    >>> model.running
    True
    >>> model.run().increments
    4
    """

    def __init__(
        self,
        network: SpringNetwork,
        increments: int = 20,
        scheme: Scheme = "newton",
        tolerance: float = 1e-12,
    ) -> None:
        require(increments >= 1, f"increments: at least 1 is needed, got {increments}")
        known = scheme in ("newton", "euler")
        require(known, f"scheme: must be 'newton' or 'euler', got {scheme!r}")
        require(tolerance > 0.0, f"tolerance: must be above 0, got {tolerance}")
        self.network, self.increments, self.tolerance = network, increments, tolerance
        self.scheme: Scheme = scheme
        self.assembler, self.solver = Assembler(network), DirectSolver()
        self._force_scale = float(np.abs(network.forces).max())
        self.records: list[NetworkState] = []
        self._settle()

    def advance(self) -> None:
        """Take one increment of the load, unless the network gives way or it is too large."""
        last, taken = self.records[-1], len(self.records)
        try:
            take = self._euler_step if self.scheme == "euler" else self._newton_step
            record = take(last, taken / self.increments)
            at_the_end = taken == self.increments * self.network.stages
            if at_the_end and self.scheme == "newton" and len(self.assembler.free):
                self._check_stable(record)
        except TangentError:
            self.running = False
            raise
        self.records.append(record)
        self.running = not at_the_end

    @property
    def stage(self) -> float:
        """Point of the load path: 1 is the end of the first stage."""
        return self.records[-1].stage

    @property
    def positions(self) -> Floats:
        """Where the nodes are now (m), shape (n, dimension)."""
        return self.network.positions + self.records[-1].displacement

    def progress(self) -> str:
        """Return the line of progress."""
        return f"increment {self.steps}: stage {self.stage:.4g} of {self.network.stages}"

    def result(self) -> NetworkResult:
        """Return what has been computed so far."""
        columns = map(np.array, zip(*self.records, strict=True))
        records: dict[str, Any] = dict(zip(NetworkState._fields, columns, strict=True))
        return NetworkResult(self.network, **records, scheme=self.scheme, seconds=self.seconds)

    def law(self, elongation: Floats) -> tuple[Floats, Floats]:
        """Return tensions K (L − λ) of elongations, and their growth with these."""
        network = self.network
        return network.stiffness * (elongation + network.prestretch), network.stiffness

    def _settle(self) -> None:
        """Let springs that are stretched or pressed from the start come into balance."""
        rest = np.zeros_like(self.network.positions)
        start = NetworkState(rest, self.network.stiffness * self.network.prestretch)
        self.records.append(start)
        try:
            self.records[0] = self._balance(start, 0.0)
        except SingularTangentError as weakness:
            raise self._gives_way(start, weakness) from None
        except ConvergenceError as trouble:
            raise ConvergenceError(
                "rest_length: without any load the springs find no balance near the first "
                f"positions ({trouble}); place the nodes nearer to it"
            ) from trouble

    def _euler_step(self, last: NetworkState, goal: float) -> NetworkState:
        geometry = spring_geometry(self.network, last.displacement)
        tension, stiffness = self.law(geometry.elongation)
        jump = self.network.displacement_at(goal) - self.network.displacement_at(last.stage)
        load = self.network.force_at(goal) - self.network.force_at(last.stage)
        load += self.assembler.force_change(geometry, tension, stiffness, jump)
        answer = self.assembler.restrict(load)
        try:
            step = solve_tangent(self.assembler, self.solver, geometry, tension, stiffness, answer)
        except SingularTangentError as weakness:
            raise self._gives_way(last, weakness) from None
        displacement = last.displacement + jump + step
        if complaint := self._leap(last.displacement, displacement):
            raise ConvergenceError(
                f"between stage {last.stage:.6g} and {goal:.6g} {complaint}: take more than "
                f"{self.increments} increments, or correct them (solve)"
            )
        geometry = spring_geometry(self.network, displacement)
        tension, _ = self.law(geometry.elongation)
        springs = spring_forces(self.network, geometry, tension)
        unbalanced = self.assembler.restrict(self.network.force_at(goal) + springs)
        scale = max(self._force_scale, float(np.abs(tension).max())) or 1.0
        residual = np.abs(unbalanced).max(initial=0.0) / scale
        return NetworkState(displacement, tension, residual, 1, goal)

    def _newton_step(self, last: NetworkState, goal: float) -> NetworkState:
        start, size, corrections = last.stage, goal - last.stage, 0
        finest = 2.0**-10 * size
        while last.stage < goal:
            target = goal if last.stage + 1.001 * size >= goal else last.stage + size
            try:
                last = self._balance(last, target)
            except (SingularTangentError, ConvergenceError) as trouble:
                size /= 2.0
                if size >= finest:
                    continue
                if isinstance(trouble, JumpError):
                    trouble = self._weakest(last)
                if isinstance(trouble, SingularTangentError):
                    raise self._gives_way(last, trouble) from None
                raise ConvergenceError(
                    f"no balance was found beyond stage {last.stage:.6g} (between {start:.6g} "
                    f"and {goal:.6g}): {trouble}"
                ) from trouble
            corrections += last.corrections
            size *= 2.0
        return last._replace(corrections=corrections)

    def _balance(self, last: NetworkState, target: float) -> NetworkState:
        balance = find_balance(
            self.assembler,
            self.solver,
            self.law,
            last.displacement,
            self.network.force_at(target),
            given=self.network.displacement_at(target),
            force_scale=self._force_scale,
            tolerance=self.tolerance,
        )
        if complaint := self._leap(last.displacement, balance.displacement):
            raise JumpError(complaint)
        self._force_scale = max(self._force_scale, float(np.abs(balance.tension).max()))
        return balance._replace(stage=target)

    def _leap(self, start: Floats, end: Floats) -> str:
        """Return what shows that a step was a leap to another branch; empty if it was none.

        On the way from one stable state to a near one the network resists all along.
        """
        before, after = (spring_geometry(self.network, state) for state in (start, end))
        turn = np.einsum("ij,ij->i", before.direction, after.direction)
        ratio = after.length / before.length
        if not ((turn > np.cos(np.pi / 4.0)) & (ratio > 0.5) & (ratio < 2.0)).all():
            return "a spring turns by more than 45° or changes its length by half"
        moved = np.where(self.network.held, 0.0, end - start)
        for share in (0.25, 0.5, 0.75):
            geometry = spring_geometry(self.network, start + share * (end - start))
            if self.assembler.resistance(geometry, *self.law(geometry.elongation), moved) < 0.0:
                return "the network snaps through states that do not resist"
        return ""

    def _check_stable(self, record: NetworkState) -> None:
        """Refuse a state that gives way."""
        geometry, stiffness = self._geometry_and_stiffness(record)
        try:
            self.solver.factorise(self.assembler.tangent(geometry, record.tension, stiffness))
        except SingularTangentError as weakness:
            raise self._gives_way(record, weakness) from None

    def _geometry_and_stiffness(self, record: NetworkState) -> tuple[Geometry, Floats]:
        geometry = spring_geometry(self.network, record.displacement)
        return geometry, self.law(geometry.elongation)[1]

    def _weakest(self, record: NetworkState) -> SingularTangentError:
        """Return the direction that a state resists least, by inverse iteration."""
        geometry, stiffness = self._geometry_and_stiffness(record)
        self.solver.factorise(self.assembler.tangent(geometry, record.tension, stiffness))
        direction = np.random.default_rng(0).standard_normal(len(self.assembler.free))
        for _ in range(6):
            direction = self.solver.solve(direction / np.linalg.norm(direction))
        return SingularTangentError(direction / np.linalg.norm(direction))

    def _gives_way(self, last: NetworkState, weakness: SingularTangentError) -> TangentError:
        """Name the nodes that move, and attach what was computed up to here."""
        geometry, stiffness = self._geometry_and_stiffness(last)
        error = tangent_error(self.assembler, geometry, stiffness, weakness.direction, last.stage)
        if last.stage > self.records[-1].stage:
            self.records.append(last)
        error.result = self.result()
        return error


def solve(
    network: SpringNetwork, increments: int = 10, *, tolerance: float = 1e-12
) -> NetworkResult:
    """Load a network with every increment in equilibrium.

    Increments that are too large are cut in halves, so the answer does not depend on their number.
    Parameters and errors are those of `NetworkModel`.

    Examples
    --------
    >>> from kaju.model.network import solve, triangular
    >>> round(solve(triangular(5, force=0.1)).largest_displacement()[1], 4)
    0.1145
    """
    if not isinstance(network, SpringNetwork):
        raise ParameterError(
            f"network: a SpringNetwork is needed, got {type(network).__name__}; a scene is solved "
            "by kaju.solve"
        )
    return NetworkModel(network, increments, tolerance=tolerance).run(progress=False)
