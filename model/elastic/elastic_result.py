"""The answer of linear elasticity, on equal cells or on agents that spawned."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from kaju import __version__
from kaju.arrays import Flags, Floats, Ints, first_largest, nearest, spread
from kaju.errors import KajuError, ParameterError, ResultError, suggestion
from kaju.model.elastic.arguments import check_numbers
from kaju.model.elastic.caveats import caveats_of, doubt_of, is_stepped, refuse_singular, unproved
from kaju.model.elastic.corners import sharp_places
from kaju.model.elastic.equal.cell_agents import CellAgents
from kaju.model.elastic.goals.duals import goal_of, without_outline
from kaju.model.elastic.goals.quantities import (
    HOOP,
    VON_MISES,
    Goal,
    Place,
    Quantity,
    described,
    plain,
    quantities_of,
    unit_of,
)
from kaju.model.elastic.intensity import intensity
from kaju.model.elastic.moduli import equivalent_stress, least_equivalent, strain_of
from kaju.model.elastic.pair.answer import PairAgents
from kaju.model.elastic.pair.cut_agents import CutAgents
from kaju.model.elastic.pair.history import Family
from kaju.model.elastic.pair.loop import PairLoop
from kaju.model.elastic.posed_body import PosedBody
from kaju.model.results.cuts import Carrying, Cuts
from kaju.model.results.mesh import corner_order, write_vtk
from kaju.model.results.result import (
    BALANCE,
    ROUNDING,
    BodyResult,
    Check,
    Named,
    finite,
    in_columns,
)
from kaju.model.scene import Scene
from kaju.model.solid.solid_agents import SolidAgents
from kaju.stepping import interrupt_requested

if TYPE_CHECKING:
    import pandas


MOST_LOOKED_AT = 20_000  # agents whose corners are looked at, those of the largest means


class LargestStress(NamedTuple):
    """The largest equivalent (von Mises) stress of an answer.

    It is looked for at the corners of agents, and that far round the places where stress has no
    limit; nearer ones are left out, unless all are. All stresses of the agent reach it, for one
    alone is wild at the corners of thin parts. It is no less than the largest along an outline that
    has a name.
    """

    value: float  # Pa
    at: tuple[float, ...]  # m
    left_out: float  # How far (m) round places without a limit it leaves out; 0 if there are none


@dataclass(frozen=True, eq=False, repr=False)
class ElasticResult(BodyResult):
    """Linear elasticity of a scene: equal cells, or agents of many sizes.

    Arrays over agents have one row for each, in the order of `lower`: equal cells row by row,
    agents that spawned along a space-filling curve. `cells` gives arrays over equal cells.

    Attributes
    ----------
    found : PairAgents, CutAgents, CellAgents or SolidAgents
        The question, the agents and what they have found, in the solver's units.
    seconds : float
    tolerance : float or None
        Relative error that was asked for: in the energy norm, or in the `goal`.

    Examples
    --------
    >>> import kaju
    >>> answer = kaju.solve(kaju.load_scene("plate.toml"))
    >>> answer.agents, answer.stress.shape
    (400, (400, 2, 2))
    """

    kind: ClassVar[str] = "elastic"
    found: PairAgents | CutAgents | CellAgents | SolidAgents
    seconds: float
    tolerance: float | None = None

    # What the agents say as it is.
    name = property(lambda r: r.found.name, doc="What it is where it is compared with another.")
    films = property(lambda r: r.found.films, doc="Names of its animations, the usual one first.")
    stage = property(lambda r: r.found.stage, doc="Stage of loading; None is the last.")
    spawned = property(lambda r: r.found.storage == "tree", doc="Whether agents spawned.")
    agents = property(lambda r: r.found.count, doc="Number of agents.")
    material = property(lambda r: r.found.material, doc="Index of each in `scene.cell_materials`.")
    stiffness = property(lambda r: r.found.stiffness, doc="Factor of the moduli of each, or None.")
    no_bound = property(lambda r: r.found.no_bound, doc="Why nothing is proved; else empty.")
    residuals = property(lambda r: tuple(r.found.solution.residuals), doc="Before each iteration.")
    generations = property(lambda r: tuple(r.found.generations), doc="Every step of spawning.")

    @property
    def cut_agents(self) -> CutAgents | None:
        """The agents, if they are cut by true outlines in the plane."""
        return self.found if isinstance(self.found, CutAgents) else None

    @property
    def scene(self) -> Scene:
        """The scene that was computed."""
        return self.found.scene

    @property
    def grid(self) -> Scene:
        """The scene on the cells that say where the body is; none of the agents crosses one."""
        return self.found.grid

    @property
    def subdivision(self) -> int:
        """How many cells of `grid` there are per cell of the scene, along each axis."""
        return round(self.scene.lattice.cell_size / self.grid.lattice.cell_size)

    @cached_property
    def lower(self) -> Floats:
        """Lower corners (m) of the agents, shape (agents, dimension)."""
        return self.found.lower * self.grid.lattice.cell_size

    @cached_property
    def size(self) -> Floats:
        """Edges (m) of the agents, shape (agents,)."""
        return self.found.size * self.grid.lattice.cell_size

    @property
    def middle(self) -> Floats:
        """Middles (m) of the agents, of cut ones of what is body; shape (agents, dimension)."""
        cut, half = self.cut_agents, 0.5 * self.size[:, None]
        return self.lower + half if cut is None else cut.ground.edge * cut.middle

    @property
    def level(self) -> Ints:
        """How often the largest of the first agents would be halved to give each agent."""
        largest = (self.family if self.spawned else self).size.max()
        return np.asarray(np.rint(np.log2(largest / self.size)), dtype=np.int64)

    @property
    def spawn_step(self) -> Ints:
        """Step in which each agent spawned; 0 for the first."""
        if not self.spawned:
            return np.zeros_like(self.material)
        return np.asarray(self.family.rows["spawn_step"][self.family.working])

    @cached_property
    def displacement(self) -> Floats:
        """Displacement (m) of agents: a row for each; of equal cells, the mean of their sides."""
        return self.found.scales.displacement * self.found.moved

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors (Pa) of the agents, shape (agents, dimension, dimension).

        Of equal cells, and in space, those in their middles; of agents that spawned in the plane
        the mean of both opinions over each agent.
        """
        return self.found.scales.stress * self.found.stress

    @cached_property
    def strain(self) -> Floats:
        """Strain tensors of the agents, shape (agents, dimension, dimension)."""
        stress = self.stress / self.found.scales.modulus
        return strain_of(stress, self.found.moduli, self.found.law)

    @cached_property
    def von_mises(self) -> Floats:
        """Equivalent stress (Pa) of the agents."""
        return equivalent_stress(self.stress, self.found.moduli, self.found.law, self.scene.plane)

    @cached_property
    def reactions(self) -> dict[str, Floats]:
        """Force (N) of each support on the body: sides, named regions, "rigid" cells without name.

        Their sum is that of the loads. How supports share what statics cannot tell has no error of
        its own: a goal makes agents small where it needs them, and leaves shares as they come.
        """
        unit, d = self.found.scales.force, self.scene.lattice.dimension
        return Named("reactions", {name: unit * b[:d] for name, b in self._borne.items()})

    @cached_property
    def couples(self) -> dict[str, Any]:
        """Couple (N·m) of each support on the body, about the middle of where it holds.

        In the plane above 0 to the left, in space about x, y and z.
        """
        unit, lattice = self.found.scales.force * self.found.scales.length, self.scene.lattice
        d, least = lattice.dimension, ROUNDING * self._forces * max(lattice.extent)
        found = {name: unit * borne[d:] for name, borne in self._borne.items()}
        told = {name: plain(c * (np.abs(c) > least) + 0.0) for name, c in found.items()}
        return Named("couples", told)

    @cached_property
    def _borne(self) -> dict[str, Floats]:
        """What supports bear in the solver's units: of each a force, then a couple."""
        return self.found.reactions()

    @cached_property
    def _forces(self) -> float:
        """The sum (N) of what loads and supports exert, by amount."""
        borne = sum(float(np.abs(force).sum()) for force in self.reactions.values())
        return float(np.abs(self.found.applied(self.stage)).sum()) + borne

    @property
    def strain_energy(self) -> float:
        """Energy (J) stored in the body, and in beds.

        Of agents that spawned, in the plane the middle of `energy_bounds`, in space no more than is
        true where no side is moved.
        """
        return self.found.solution.energy * self.found.scales.energy

    @property
    def energy(self) -> Floats:
        """Energy (J) stored in each agent, shape (agents,); together that of the body without beds.

        On equal cells -2 `energy` / `stiffness` is the derivative of the compliance F·u with
        respect to the stiffness of each cell, under given forces.

        Raises
        ------
        ResultError
            If agents spawned in space.
        """
        if self.found.energies is None:
            raise ResultError(
                "energy: is not known of single agents in space; solve without a tolerance, for "
                "equal cells"
            )
        return np.asarray(self.found.scales.energy * self.found.energies)

    @property
    def gap(self) -> Floats:
        """Squared difference of the two stresses of each agent (J), shape (agents,).

        It is twice the energy of the difference. If only forces act, its sum is twice the distance
        of `energy_bounds`. In space it is the estimated squared error of each agent.

        Raises
        ------
        ResultError
            If agents did not spawn.
        """
        return self._pair("gap").generations[-1].gap

    @property
    def error_estimate(self) -> float:
        """Relative error in the energy norm: `error_bound` if there is one, else an estimate.

        On equal cells it is the difference to cells twice as large and what an iteration left, or
        half of what the energy of the corners' displacement differs by, if that is more.
        """
        return self.found.error

    @cached_property
    def energy_bounds(self) -> tuple[float, float] | None:
        """Energies (J) below and above the true one; None where there are none.

        From a stress that balances and a displacement without gaps (Prager and Synge 1947). For
        equal cells of the plane agents that spawn find them when they are first asked for, as
        close as `error_estimate`; the cells' own energy may lie outside.
        """
        found: Any = self.found
        if not self.spawned:
            if self.scene.lattice.dimension == 3 or self.stiffness is not None:
                return None
            try:
                body = PosedBody(self.grid, self.stage)
                # No closer: on a plate with a hole that takes a second or two.
                found = PairLoop(body, max(self.error_estimate, 1e-3))
                while not found.finished and not (found.last and interrupt_requested()):
                    found.step()
            except KajuError:  # agents cannot stand on it, or its energy has no limit
                return None
        last = found.generations[-1]
        return None if last.lower is None else (last.lower, last.upper)

    @property
    def error_bound(self) -> float | None:
        """Largest error of `stress_at`, in the energy norm, proved; None if nothing is."""
        return None if self.no_bound else self.error_estimate

    def checks(self) -> list[Check]:
        """Return whether the reactions of the supports balance the loads."""
        missing = sum(self.reactions.values(), self.found.applied(self.stage).sum(axis=0))
        # What moved supports strain may leave more rounding than small loads have force.
        lost = max(float(np.abs(missing).max()) - 1e-12 * self.found.scales.force, 0.0)
        off = lost / self._forces if self._forces > 0.0 else 0.0
        said = any("unbalanced" in note for note in self.notes)
        # Solvers let forces be off by a hundredth of the error that is stated.
        allowed = 1.0 if said else max(BALANCE, 0.01 * self.error_estimate)
        return [Check("supports bear the loads", off, allowed)]

    @property
    def tolerance_kept(self) -> str | None:
        """Whether the tolerance is kept; None without one.

        "proved": `error_bound` is within it; "estimated": there is no bound (`no_bound`), and the
        estimated error is within it; "missed": the one or the other is above it. With a `goal`
        it is the error of this that counts.
        """
        if self.tolerance is None:
            return None
        if self.goal_error > self.tolerance:
            return "missed"
        doubts = [goal.no_bound for goal in self.found.goals] or [self.no_bound]
        return "estimated" if any(doubts) else "proved"

    def _pair(self, name: str) -> PairAgents:
        """Return the agents if they spawned: only such have what is asked."""
        if isinstance(self.found, PairAgents):
            return self.found
        raise ResultError(f"{name}: only agents that spawned can tell it; solve with a tolerance")

    @property
    def goal_error(self) -> float:
        """Error that the tolerance is about, relative: the largest of its goals."""
        errors = (goal.relative_error for goal in self.goals)
        return max(errors, default=self.error_estimate)

    @property
    def goals(self) -> tuple[Goal, ...]:
        """Value and error of every quantity that the tolerance is about."""
        return tuple(goal.in_units(self.found.scales) for goal in self.found.goals)

    @cached_property
    def family(self) -> Family:
        """All agents, retired ones too, each with its parent, step and cause."""
        metre = self.grid.lattice.cell_size / self._pair("family").ground.cell
        return Family.of(self.generations, self.scene.lattice.dimension, metre)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the solver decided, and the `caveats`."""
        ours = *self.found.solution.notes, *self.caveats, *unproved(self)
        peak = self.largest_stress
        kind = max(int(self.material_at(np.array([peak.at]))[0]), 0)
        solved = self.scene if self.scene.outlined else self.grid  # of the cells that were solved
        asked = solved.notes_on(self.max_displacement, peak.value, kind)
        return tuple(dict.fromkeys((*ours, *asked)))

    stepped = cached_property(is_stepped)
    caveats = cached_property(caveats_of)
    intensity = intensity

    @property
    def caveats_in_brief(self) -> tuple[str, ...]:
        """The `caveats` in a few words each."""
        return tuple(caveat.split(": ")[0] for caveat in self.caveats)

    @cached_property
    def largest_stress(self) -> LargestStress:
        """Largest equivalent stress, where it is, and how far from places without a limit."""
        most = np.argsort(-self.von_mises, kind="stable")[:MOST_LOOKED_AT]
        _, points, value = self._at_corners(most)
        sharp, left_out = self._left_out
        if left_out and self.spawned and points.shape[1] == 2:
            # that far round them, too, for large agents have no corners there
            ways = np.array([*product((-2.0, -1.0, 0.0, 1.0, 2.0), repeat=2)])
            ways = ways[np.abs(ways).max(axis=1) == 2.0]
            ways *= left_out / np.hypot(*ways.T)[:, None]
            around = (sharp[:, None] + ways).reshape(-1, 2)
            around, cells = self.found.located(around[self.holds(around)])
            told, law = self.found.stresses_at(around, cells), self.found.law_at(around, cells)
            points = np.concatenate([points, around])
            value = np.append(value, self._least(told, law))
        if left_out:
            away = nearest(sharp, points)[0] > 0.999 * left_out
            value *= away | (not away.any())
            left_out *= bool(away.any())
        # Along outlines it is known better than at the corners there, and in spite of corners near.
        if along := [*self.largest_along(VON_MISES).values()]:
            near = nearest(points, np.array([place for _, place in along]))[1]
            np.maximum.at(value, near, [stress for stress, _ in along])
        at = first_largest(value)
        return LargestStress(float(value[at]), tuple(points[at].tolist()), left_out)

    @property
    def _left_out(self) -> tuple[Floats, float]:
        """Places (m) without a limit of stress, and how far round them the largest leaves out.

        A tenth of how thick the body is, but a cell at most: it should hang on the body, not on
        cells. Equal cells and steps tell no more than a cell away.
        """
        lattice, sharp = self.scene.lattice, self.sharp_corners
        d, h, own = lattice.dimension, lattice.cell_size, self.grid.lattice.cell_size
        if not len(sharp) or self.stepped:
            return sharp, own * bool(len(sharp))
        volume = self.area.sum() if d == 2 else (self.size**3).sum()
        far = min(0.1 * volume / np.prod(np.sort(lattice.extent)[1:]), h)
        far = float(far if self.spawned else max(far, own))
        if d == 3:  # of edges all, not their middles alone
            steps = (np.arange(n := ceil(2.0 * own / far)) + 0.5) / n - 0.5
            along = np.rint(2.0 * sharp / own) % 2.0
            sharp = (sharp[:, None] + own * steps[:, None] * along[:, None]).reshape(-1, d)
        return sharp, far

    @cached_property
    def largest_von_mises(self) -> Floats:
        """Largest equivalent stress (Pa) of each agent: that at one of its corners, or of its mean.

        A bent agent bears far more at its corners than in the mean, `von_mises`. Corners at which
        stress has no limit do not count.
        """
        own, points, value = self._at_corners(np.arange(self.agents))
        if len(self.sharp_corners):
            value = value * (nearest(self.sharp_corners, points)[0] > 1e-6 * self.size[own])
        largest = self.von_mises.copy()
        np.maximum.at(largest, own, value)
        return largest

    def _at_corners(self, agents: Ints) -> tuple[Ints, Floats, Floats]:
        """Return whose corners these are, where (m), and the equivalent stress (Pa) there.

        Of two opinions the lower one counts; within true outlines all agents are looked at.
        """
        cut, h, d = self.cut_agents, self.grid.lattice.cell_size, self.scene.lattice.dimension
        if cut is not None:
            own, points, told = cut.at_corners()
        else:
            own, ends = np.repeat(agents, 2**d), np.tile(corner_order(d), (len(agents), 1))
            points = self.lower[own] + self.size[own, None] * ends
            inside = points + 1e-6 * (self.middle[own] - points)
            told = self.found.stresses_at(inside, np.floor(inside / h).astype(np.int64))
        return own, points, self._least(told, self.found.law[own])

    def _least(self, told: tuple[Floats, ...], law: Ints) -> Floats:
        """Return the equivalent stress (Pa) that all stresses of some points reach."""
        found = self.found
        return found.scales.stress * least_equivalent(told, found.moduli, law, self.scene.plane)

    @cached_property
    def sharp_corners(self) -> Floats:
        """Points (m) at which stresses grow without limit; in space middles of edges of cells."""
        cut = self.cut_agents
        return self.sharp_cells[0] if cut is None else cut.ground.without_limit

    @cached_property
    def sharp_cells(self) -> tuple[Floats, list[str]]:
        """Where (m) cells have no limit of stress, and why: `sharp_places`."""
        return sharp_places(self.grid)

    def holds(self, points: Floats) -> Flags:
        """Tell which points (m), shape (n, dimension), lie in the body or on its surface."""
        return self.found.holds(points)

    def material_at(self, points: Floats) -> Ints:
        """Return which of the scene's materials is at points (m), below 0 outside of the body."""
        return self.found.material_at(points)

    @property
    def area(self) -> Floats:
        """Area (m²) of a plane body in each agent; with true outlines the least it can be."""
        cut, unit = self.cut_agents, self.grid.lattice.cell_size**2
        return self.size**2 if cut is None else unit * cut.area

    def outline_stress(self, name: str) -> tuple[Floats, Floats]:
        """Return positions (m) along a named true outline, and the hoop stress (Pa) there.

        Each is the mean along one agent, of the stress of the displacement; it is not proved. If
        two materials meet there, it is the stress of the outer one. Where the outline meets a held
        side, or has a corner, stress need not have a limit (see `notes`); the largest hoop stress
        of `summary` leaves such places out.

        Raises
        ------
        ResultError
            If no region with a true outline in the plane has that name.
        """
        known, units = self.found.along, self.found.scales
        regions = [region.name for region in self.scene.body.regions]
        if self.cut_agents is None and name in regions:
            raise ResultError(f"outline_stress: {without_outline(name, self.scene)}")
        if name not in known:
            told = f"outline_stress: there is no outline {name!r}{suggestion(str(name), known)}"
            raise ResultError(f"{told}; there is {', '.join(known) or 'none with a name'}")
        return units.length * known[name].place, units.stress * known[name].hoop

    def largest_along(self, component: str = HOOP) -> dict[str, tuple[float, list[float]]]:
        """Return the largest stress (Pa) by amount, and where (m), of named outlines with one."""
        units, found = self.found.scales, {}
        for name, every in self.found.along.items():
            if (along := every.counted()).largest is not None:
                values = getattr(along, component)
                at = int(np.abs(values).argmax())
                place = units.length * along.place[at]
                found[name] = float(units.stress * values[at]), place.tolist()
        return found

    @property
    def max_displacement(self) -> float:
        """Largest displacement (m): of corners, sides and middles of agents."""
        return self.found.scales.displacement * self.found.farthest

    def displacement_at(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m), both of shape (n, dimension)."""
        moved = self.found.displacement_at(*self.found.located(points))
        return self.found.scales.displacement * moved

    def displacement_near(self, points: Floats) -> Floats:
        """Return the displacement (m) at points (m); just outside the body, of what is nearest."""
        if self.cut_agents is None:
            return super().displacement_near(points)
        moved = self.cut_agents.displacement_at(points, np.arange(0))  # in no cells
        return self.found.scales.displacement * moved

    def stress_at(self, points: Floats) -> Floats:
        """Return stress tensors (Pa) at points (m), shape (n, dimension, dimension).

        Of agents that spawned in the plane the mean of both opinions, of which `error_bound` is
        proved; it jumps a little from agent to agent. Of others `stress`, running from each to the
        next. The error is that of the whole body: at a point within a large agent stress is rather
        a mean, in a beam of few agents over its depth a shear stress off by a fifth. A smaller
        tolerance, or a `Stress` there as the goal, tells it more exactly.
        """
        told = self.found.stresses_at(*self.found.located(points))
        return np.asarray(self.found.scales.stress * np.mean(told, axis=0))

    def strain_at(self, points: Floats) -> Floats:
        """Return strain tensors at points (m), shape (n, dimension, dimension)."""
        stress = self.stress_at(points) / self.found.scales.modulus
        return strain_of(stress, self.found.moduli, self.found.law_at(*self.found.located(points)))

    def cuts(self, axis: str | None = None) -> Cuts:
        """Return the force (N) through every cut across an axis; see `BodyResult.cuts`."""
        return super().cuts(axis) if self.cut_agents is None else self.cut_agents.cuts(axis)

    def _carrying(self, axis: int) -> Carrying:
        thick = self.scene.thickness if self.scene.lattice.dimension == 2 else self.size
        # The opinion that balances bears the loads layer by layer.
        stress = self.found.scales.stress * self.found.balanced
        return Carrying(self.middle, self.size, self.size**2 * thick, stress)

    def value_of(self, quantity: Quantity | Place) -> float | Floats:
        """Return a quantity (m, Pa or N), as in `goals` if it is one; for a place its displacement.

        Raises
        ------
        ParameterError
            If it is unknown, of another dimension, outside of the body, or without a limit there.
        ResultError
            If it is the stress along an outline at which the body does not end, or has no limit.
        """
        (asked,) = quantities_of(quantity)
        for goal in self.goals:
            if goal.quantity == asked:
                return goal.value
        at, component = (getattr(asked, name, None) for name in ("at", "component"))
        named = self.scene.outlined and at in [region.name for region in self.scene.body.regions]
        if component == HOOP or (named and component == VON_MISES):
            places, _ = self.outline_stress(name := str(at))  # refuses other names
            if found := self.largest_along(component).get(name):
                return found[0]
            why = "the body does not end, and no two materials meet, so nothing is known there"
            if len(self.found.along[name].counted().place):
                why = "agents are too large to tell (take a smaller tolerance, or it as the goal)"
            elif len(places):
                why = "stress has no limit, and no part is rounded away from where it has none"
            raise ResultError(f"value_of: along {name!r} {why}; ask for the stress at a point")
        if named:
            told = f"value_of: along the outline {at!r} only the stresses {HOOP!r} and 'von_mises'"
            raise ParameterError(f"{told} are known; for others give a point, a box or a side")
        if not self.scene.outlined:
            refuse_singular(self.scene, [asked], "value_of")
        return plain(unit_of(asked, self.found.scales) * goal_of(asked, self.grid).read(self.found))

    def cells(self, resolution: int | None = None) -> EqualArrays:
        """Return the answer as arrays over equal cells, worked out when they are first asked for.

        There are `resolution` cells per cell of the scene along each axis, by default those of
        `grid`, which are the agents themselves where these are equal.

        Raises
        ------
        ParameterError
            If the resolution is not a whole number, 1 or more.
        ResultError
            If there would be too many cells.
        """
        check_numbers(None, resolution)
        return EqualArrays(self, int(resolution or self.subdivision))

    def summary(self) -> dict[str, Any]:
        """Return the key figures as plain numbers and strings."""
        size, least, found = self.size, ROUNDING * self._forces, self.largest_stress
        told = {name: f * (np.abs(f) > least) + 0.0 for name, f in self.reactions.items()}
        along = [(name, peak) for name, peak in self.largest_along().items() if name not in told]
        figures: dict[str, Any] = {
            "rule": "elastic",
            "plane": self.scene.plane,
            "agents": self.agents,
            "levels": len(np.unique(size)),
            "smallest_agent": float(size.min()),
            "largest_agent": float(size.max()),
            "strain_energy": self.strain_energy,
            "error_estimate": finite(self.error_estimate),
            "max_displacement": self.max_displacement,
            "largest_stress_Pa": found.value,
            "largest_stress_at_m": list(found.at),
            "largest_stress_Pa_doubt": doubt_of(self),
            "largest_hoop_stress_Pa": {name: one for name, (one, _) in along} or None,
            "largest_hoop_stress_at_m": {name: at for name, (_, at) in along} or None,
            "reaction": {name: force.tolist() for name, force in told.items()},
            "couple_Nm": {name: np.asarray(c).tolist() for name, c in self.couples.items()},
            "method": self.found.solution.method,
            "iterations": max(len(self.residuals) - 1, 0),
            "residual": self.residuals[-1] if self.residuals else 0.0,
            "subdivision": self.subdivision,
        }
        if self.tolerance is not None:
            asked = [described(goal.quantity) for goal in self.goals] or None
            figures |= {"tolerance": self.tolerance, "goal": asked}
            figures["tolerance_kept"] = self.tolerance_kept
        if self.goals:
            figures["goal_error"] = finite(self.goal_error)
            figures["goals"] = [goal.figures() for goal in self.goals]
        if self.spawned:
            figures["error_bound"] = finite(self.error_bound)
            figures["energy_bounds"] = self.energy_bounds
        figures |= {"generations": max(len(self.generations), 1), "notes": list(self.notes)}
        return figures | {"seconds": self.seconds, "kaju_version": __version__}

    def to_dataframe(self) -> pandas.DataFrame:
        """Return one row per agent: place, size, material, displacement, strain and stress."""
        import pandas as pd

        names = np.array([material.name for material in self.grid.cell_materials])
        found: dict[str, Any] = in_columns("{} (m)", self.middle)
        found |= {"size (m)": self.size, "level": self.level, "spawn_step": self.spawn_step}
        if self.cut_agents is not None:
            found["area (m²)"] = self.area
        elif self.scene.outlined:
            found["volume (m³)"] = self.stiffness * self.size**3  # the share of each that is body
        found |= {"material": names[self.material]}
        found |= in_columns("displacement_{} (m)", self.displacement)
        found |= in_columns("strain_{}", self.strain) | in_columns("stress_{} (Pa)", self.stress)
        found["von_mises (Pa)"] = self.von_mises
        return pd.DataFrame(found | {"largest_von_mises (Pa)": self.largest_von_mises})

    def to_vtk(self, path: str | Path) -> Path:
        """Write agents as an unstructured grid for ParaView (.vtu, .vtk), cut ones as polygons.

        Raises
        ------
        MissingExtraError
            If meshlane is not installed.
        """
        d, near = self.scene.lattice.dimension, float(self.size.min())
        names = ("size", "level", "spawn_step", "material", "von_mises", "largest_von_mises")
        values: dict[str, Any] = {name: getattr(self, name) for name in names}
        values |= {"stress": self.stress.reshape(-1, d * d)}
        values |= {"strain": self.strain.reshape(-1, d * d)}
        parts = [self.lower[:, None] + corner_order(d) * self.size[:, None, None]]
        if self.cut_agents is not None:
            agent, parts = self.cut_agents.pieces()
            values = {name: value[agent] for name, value in values.items()} | {"agent": agent}
            near = 1e-8 * self.found.scales.length
        return write_vtk(path, parts, near, values, self.displacement_near)


class EqualArrays:
    """Arrays over the box around the body, indexed [x, y(, z)]; NaN where there is no body.

    The first cell's lower corner lies at ``origin × cell_size`` (m).
    """

    def __init__(self, result: ElasticResult, division: int) -> None:
        """Lay out cells by their number per cell of the scene, along each axis."""
        (lower, upper), own = result.grid.bounds(), result.subdivision
        # Cells of the grid that are not whole cells of the arrays round the box up.
        first = np.floor_divide(lower * division, own)
        last = -np.floor_divide(-upper * division, own)
        self.origin, self.shape = tuple(first.tolist()), tuple((last - first).tolist())
        count = float(np.prod(np.asarray(self.shape, dtype=np.float64)))
        most = 4e7  # In space stress alone takes 72 bytes of each: 3 GB.
        if count > most:
            raise ResultError(
                f"cells: {count:.2g} cells are more than the {most:.0e} that fit into "
                "arrays; take a smaller resolution, or the arrays of the agents"
            )
        self.cell_size = result.grid.lattice.cell_size * (own / division)
        self._result = result
        # Where the agents are these very cells, row by row, nothing is interpolated.
        self._own = division == own and not result.spawned

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return len(self.shape)

    @cached_property
    def body(self) -> Flags:
        """Which cells have their middle in the body."""
        found = self._result.found
        if self._own and isinstance(found, CellAgents):
            return found.body
        return found.holds(self._middles(np.ones(self.shape, np.bool_))).reshape(self.shape)

    @cached_property
    def middle(self) -> Floats:
        """Middles (m) of the cells of the body, shape (cells, dimension), row by row."""
        return self._middles(self.body)

    @cached_property
    def material(self) -> Ints:
        """Index into `scene.cell_materials` of each cell, -1 where there is no body."""
        return spread(self._result.material_at(self.middle), self.body, -1)

    @cached_property
    def displacement(self) -> Floats:
        """Displacement (m) of the cells' middles, shape (n, ..., dimension)."""
        found = self._result
        return self._spread(found.displacement if self._own else found.displacement_at(self.middle))

    @cached_property
    def stress(self) -> Floats:
        """Stress tensors (Pa) of the cells, shape (n, ..., dimension, dimension)."""
        found = self._result
        return self._spread(found.stress if self._own else found.stress_at(self.middle))

    @cached_property
    def strain(self) -> Floats:
        """Strain tensors of the cells, shape (n, ..., dimension, dimension)."""
        found = self._result
        return self._spread(found.strain if self._own else found.strain_at(self.middle))

    @cached_property
    def von_mises(self) -> Floats:
        """Equivalent stress (Pa) of the cells."""
        found, stress = self._result.found, self.stress[self.body]
        law = found.law_at(*found.located(self.middle))
        return self._spread(equivalent_stress(stress, found.moduli, law, found.grid.plane))

    def _spread(self, values: Floats) -> Floats:
        """Return values of the body's cells as an array over all cells."""
        return spread(values, self.body, np.nan)

    def _middles(self, chosen: Flags) -> Floats:
        return np.asarray((np.argwhere(chosen) + np.asarray(self.origin) + 0.5) * self.cell_size)
