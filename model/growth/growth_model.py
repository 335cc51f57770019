"""A body that grows: every step its cells feel, and thicken or thin."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from kaju.arrays import Flags, Floats, spread
from kaju.errors import SceneError, brief, by_name, require
from kaju.model.elastic.arguments import SMALLEST
from kaju.model.elastic.equal import fields
from kaju.model.elastic.equal.grid import grid_of
from kaju.model.elastic.equal.problem import ElasticProblem, FaceFields
from kaju.model.elastic.equal.solver import followed
from kaju.model.elastic.equal.staggered import energy_of_cells, strains
from kaju.model.elastic.moduli import Moduli, equivalent_stress
from kaju.model.scene import Scene
from kaju.model.scene.scene import scene_needed
from kaju.model.stepper import Stepper, counted

from .growth_result import GrowthResult
from .growth_rules import RULES, Felt, GrowthRule, Neighbours

_ROUNDING = 1e-9
"""Share of the largest by which numbers may differ and still be mirror images of each other."""


class GrowthModel(Stepper[GrowthResult]):
    """A body whose cells get denser where they carry load, and thinner where they do not.

    Every cell has a density from 0 to 1, the share of it that is filled; its stiffness is the
    density to the rule's power, as a share of its material's. A step changes all densities by what
    the cells feel, then solves the elastic equations again. Displacements are small.

    Parameters
    ----------
    scene : Scene
        Of squares or cubes, held, and loaded by forces. All of its material may disappear.
    rule : {"compliance", "remodelling", "stress"} or GrowthRule
        How cells grow: to the least compliance of a given volume, towards a given energy stored per
        mass, or towards an allowed stress; see `kaju.model.growth.growth_rules`.
    volume : float
        Share of the body's volume that is filled at first; "compliance" keeps it.
    filter_radius : float
        Radius (cells) over which "compliance" averages; with 1 or less nothing is averaged.
    start : array, optional
        First densities, in the shape of the scene's cells; by default the same everywhere.
    stage : int, optional
        Stage of loading; by default the last.
    most_steps : int
        Steps after which growth ends.
    at_rest : float
        Growth ends when no density changes by more in a step.
    tolerance : float
        Relative error in the energy norm to which the equations are solved; its square is the
        error of the compliance. The last design is solved to 1e-6.

    Raises
    ------
    ParameterError
        If an argument breaks its rule.
    SceneError
        If the scene cannot grow: moved sides, weight, or no forces.

    Examples
    --------
    >>> import kaju
    >>> scene = kaju.Scene(
    ...     body={"cells": [24, 12], "cell_size": 0.01, "material": "steel"},
    ...     sides={"left": "rigid"},
    ...     loads=[{"region": {"box": [[0.22, 0.05], [0.24, 0.07]]}, "force": [0.0, -1.0]}],
    ... )
    >>> grown = kaju.GrowthModel(scene, volume=0.4, filter_radius=1.5, most_steps=20).run()
    >>> bool(grown.compliance < 0.5 * grown.history["compliance_J"][0])
    True
    >>> grown.density.shape, round(float(grown.density.mean()), 12)
    ((24, 12), 0.4)
    """

    @by_name
    def __init__(
        self,
        scene: Scene,
        *,
        rule: str | GrowthRule = "compliance",
        volume: float = 0.5,
        filter_radius: float = 2.4,
        start: ArrayLike | None = None,
        stage: int | None = None,
        most_steps: int = 100,
        at_rest: float = 0.01,
        tolerance: float = 1e-2,
    ) -> None:
        scene_needed(scene)
        known = isinstance(rule, GrowthRule) or (isinstance(rule, str) and rule in RULES)
        require(known, f"rule: a GrowthRule, or {', '.join(map(repr, RULES))}, got {brief(rule)}")
        require(0.0 < volume <= 1.0, f"volume: a share above 0, at most 1, got {volume}")
        across = max(scene.lattice.shape)
        told = f"filter_radius: from 0 to the {across} cells of the body, got {filter_radius}"
        require(0.0 <= filter_radius <= across, told)
        require(most_steps >= 1, f"most_steps: at least 1, got {most_steps}")
        require(at_rest >= 0.0, f"at_rest: 0 or more, got {at_rest}")
        sure = SMALLEST <= tolerance < 1.0
        require(sure, f"tolerance: from {SMALLEST:g} to below 1, got {tolerance}")
        self.scene, self.stage = scene, stage
        self.rule = RULES[rule]() if isinstance(rule, str) else copy(rule)
        self._volume, self._radius = volume, filter_radius
        self._most_steps, self._at_rest, self._tolerance = most_steps, at_rest, tolerance
        self._growing = GrowingBody(scene, stage)
        self._around = Neighbours.within(self._growing.body, filter_radius)
        self._beside = Neighbours.across_faces(self._growing.body)
        self.outcome = ""
        """Why no step is left; "" while one is."""
        self.design = self._first_design(volume, start)
        self._rows: list[tuple[float, ...]] = []
        self._designs: list[Floats] = []
        self._pulled: list[Flags] = []
        self._feel(0.0, tolerance)
        self.rule.prepare(self._felt())

    def _first_design(self, volume: float, start: ArrayLike | None) -> Floats:
        """Return the densities that growth starts from."""
        body = self._growing.body
        if start is None:
            return np.full(np.count_nonzero(body), float(volume))
        field, shape = np.asarray(start, dtype=np.float64), self.scene.lattice.shape
        right = field.shape == shape
        require(right, f"start: densities of shape {shape} are needed, got {field.shape}")
        design: Floats = field[self._growing.box][body]
        inside = bool(np.all((design >= 0.0) & (design <= 1.0)))
        require(inside, "start: densities from 0 to 1 are needed where there is material")
        return design

    @property
    def compliance(self) -> float:
        """F·u: work of the forces on the displacements (J)."""
        return self._growing.compliance

    def advance(self) -> None:
        """Change all densities by what their cells feel, and solve again."""
        grown = np.asarray(self.rule.grow(self._felt()), dtype=np.float64)
        right = grown.shape == self.design.shape
        require(
            right and bool(np.all((grown >= 0.0) & (grown <= 1.0))),
            f"rule: {type(self.rule).__name__}.grow must return {self.design.size} densities "
            f"from 0 to 1, one a cell, got {brief(grown)}",
        )
        change = float(np.abs(grown - self.design).max())
        self.design = grown
        if self.steps >= self.rule.patience and change <= self._at_rest:
            self.outcome = "at rest: no density changes any more"
        elif self.steps == self._most_steps:
            self.outcome = f"ended after {counted(self.steps, 'step')}, as asked"
        self.running = not self.outcome
        self._feel(change, self._tolerance if self.running else 1e-6)  # the last is tight

    def _feel(self, change: float, tolerance: float) -> None:
        """Find what the design's cells feel, and note it."""
        self.density = self.design
        """Of the cells of material, row by row, shape (n,)."""
        if self.rule.smooth:
            self.density = np.minimum(self._around.means(self.design), 1.0)
        least = self.rule.least_stiffness
        self.stiffness = least + (1.0 - least) * self.density ** self.rule.penalty(self.steps)
        self._growing.solve(self.stiffness, min(tolerance, self._tolerance))
        volume = float(self.density.mean())
        self._rows.append((self.compliance, volume, change, self._growing.iterations))
        self._designs.append(self.density.astype(np.float32))
        self._pulled.append(self._growing.pulled())

    def _felt(self) -> Felt:
        """Return what the cells feel."""
        power, least = self.rule.penalty(self.steps), self.rule.least_stiffness
        # Of F·u under given forces: minus twice the energy's derivative at given displacements.
        rise = (1.0 - least) * power * self.density ** (power - 1.0)
        return Felt(
            step=self.steps,
            density=self.density,
            design=self.design,
            energy=self._growing.energy,
            slope=-2.0 * rise * self._growing.energy / self.stiffness,
            von_mises=self._growing.von_mises,
            volume=self._volume,
            around=self._around,
            beside=self._beside,
            cell_volume=self.scene.lattice.cell_volume(self.scene.thickness),
        )

    def progress(self) -> str:
        """Return the line of progress."""
        compliance, volume, change, _ = self._rows[-1]
        return (
            f"step {self.steps} of {self._most_steps}: compliance {compliance:.4g} J, volume "
            f"{volume:.1%}, largest change {change:.2g}"
        )

    def result(self) -> GrowthResult:
        """Return what has grown so far."""
        compliances, volumes, changes, iterations = np.array(self._rows).T
        return GrowthResult(
            scene=self.scene,
            stage=self.stage,
            rule=self.rule.name,
            cells=self.density.copy(),
            stiffness_of_cells=self.stiffness.copy(),
            designs=np.array(self._designs),
            pulled=np.array(self._pulled),
            compliances=compliances,
            volumes=volumes,
            changes=changes,
            iterations=iterations.astype(np.int64),
            volume=self._volume,
            holds_volume=self.rule.holds_volume,
            filter_radius=self._radius,
            outcome=self.outcome,
            seconds=self.seconds,
        )


class GrowingBody:
    """The cells of a scene, how stiff they are, and what they feel under its loads.

    The cells are squares or cubes, the loads forces that do not depend on what has grown.
    `compliance`: F·u, the work (J) of the final forces on the displacements; `energy`, shape (n,):
    stored in every cell (J), with its share of the edges round it.
    """

    def __init__(self, scene: Scene, stage: int | None) -> None:
        if scene.body.gravity is not None:
            raise SceneError(
                "body.gravity: the weight would change as the body grows; leave it out"
            )
        if any(side.displacement is not None for side in scene.sides.values()):
            raise SceneError(
                "sides: a growing body needs forces, because a moved side does more work on a "
                "stiffer body; load it by [[loads]]"
            )
        if not np.any(scene.applied(stage).force):
            raise SceneError("loads: a body grows only under forces; add [[loads]]")
        grid = grid_of(scene, stage, stiffness=np.ones(scene.lattice.shape))
        if grid.division > 1:
            raise SceneError(f"body: {grid.notes[0]}; give smaller cells (scene.refine(2))")
        self._whole = grid.problem
        self.body: Flags = np.asarray(self._whole.kinds[self._whole.inner] >= 0)
        ends = zip(grid.origin, self.body.shape, strict=True)
        self.box = tuple(slice(start, start + size) for start, size in ends)
        self._mirrors = [axis for axis in range(self.body.ndim) if _mirrored(self._whole, axis)]
        self._moved: FaceFields | None = None

    def solve(self, stiffness: Floats, tolerance: float) -> None:
        """Find what cells of a relative stiffness feel, starting from what they felt before."""
        moduli = Moduli(*(modulus * stiffness for modulus in self._whole.moduli))
        problem = replace(self._whole, moduli=moduli)
        solution = followed(problem, self._moved, tolerance)
        self._moved = solution.displacement
        unit = problem.scales.energy
        self.compliance = 2.0 * unit * solution.energy
        # Loose equations are not solved alike on both sides of a mirror, and growth amplifies that.
        self._kept = [axis for axis in self._mirrors if self._same(stiffness, axis)]
        self.energy = self._symmetric(unit * energy_of_cells(problem, self._moved)[self.body])
        self.iterations = solution.iterations

    def von_mises(self) -> Floats:
        """Return the equivalent stress (Pa) of the whole material at the cells' strain."""
        assert self._moved is not None
        problem = self._whole
        parts = fields.stress_parts(replace(problem, surface_shear={}), self._moved)
        stress = fields.cell_tensor(problem, parts, self.body)
        own = problem.kinds[problem.inner][self.body].astype(np.int64)
        equivalent = equivalent_stress(stress, problem.moduli, own, problem.plane)
        return self._symmetric(problem.scales.stress * equivalent)

    def pulled(self) -> Flags:
        """Tell which cells are pulled more than pressed: they grow."""
        assert self._moved is not None
        grown = np.sum(strains(self._moved).cells, axis=0)
        return self._symmetric(grown[self._whole.inner][self.body]) > 0.0

    def _flipped(self, values: Floats, axis: int) -> Floats:
        """Return the values of the cells' mirror images along an axis."""
        return np.asarray(np.flip(spread(values, self.body), axis)[self.body])

    def _same(self, values: Floats, axis: int) -> bool:
        return bool(np.abs(values - self._flipped(values, axis)).max(initial=0.0) <= _ROUNDING)

    def _symmetric(self, values: Floats) -> Floats:
        """Return the means of values and their mirror images."""
        for axis in self._kept:
            values = 0.5 * (values + self._flipped(values, axis))
        return values


def _mirrored(problem: ElasticProblem, axis: int) -> bool:
    """Tell whether body, supports and loads are their own mirror image, loads but for the sign."""
    solid, kind = problem.kinds >= 0, np.maximum(problem.kinds, 0)
    stiff = [np.where(solid, modulus[kind], 0.0) for modulus in problem.moduli]
    whole = (*stiff, *problem.face_states, *problem.spring)
    if not all(np.array_equal(field, np.flip(field, axis)) for field in whole):
        return False
    # A mirror turns round what points along its axis; and shear, which has it as one of two axes.
    loads = [(f, f_axis == axis) for f_axis, f in enumerate(problem.force)]
    loads += [(np.asarray(s), axis in pair) for pair, s in problem.surface_shear.items()]
    images = [(f, -np.flip(f, axis) if turned else np.flip(f, axis)) for f, turned in loads]
    most = max(float(np.abs(f).max(initial=0.0)) for f, _ in images)
    return any(
        all(np.abs(f - sign * image).max(initial=0.0) <= _ROUNDING * most for f, image in images)
        for sign in (1.0, -1.0)
    )
