"""The agents where the body ends: they give a load back to the agent it came from."""

from __future__ import annotations

from kaju.errors import brief

from .material_agent import PlacedAgent
from .shares import Load


class BoundaryAgent(PlacedAgent):
    """A cell beside the body that a load has woken.

    Subclass one of the three kinds to make a boundary of your own: `give_back` returns what goes
    back of a load, `turn` where that points. What is not given back counts as absorbed. A model
    takes your classes as ``boundary_agents={"free": ..., "rigid": ..., "roller": ...}``.

    Attributes
    ----------
    taken, passed : dict of int to float
        Loads that arrived (N), by direction; loads given back (N), by the arm to who takes them.
    kept, returned : float
        What was not given back (N), and what was.
    index, position, spawn_step : tuple of int, array, int
        As of a `MaterialAgent`; an index of -1 is beside the first cell.

    Examples
    --------
    >>> import kaju
    >>> class Felt(kaju.RigidBoundaryAgent):
    ...     def give_back(self, load, arm):
    ...         return self.turn(load, arm)._replace(magnitude=0.5 * load.magnitude)
    >>> scene = kaju.load_scene("plate.toml").replace(sides={"top": "rigid"})
    >>> result = kaju.LoadModel(scene, boundary_agents={"rigid": Felt}).run()
    >>> round(result.last.ledger.absorbed, 4)  # N
    0.0675
    """

    goes_into = 'LoadModel, boundary_agents={{"rigid": {}}}'
    name: str  # "free", "rigid" or "roller"
    returned = property(lambda agent: sum(agent.passed.values()))

    def answer(self, load: Load, arm: int) -> Load | None:
        """Take a load that came over `arm`, return what goes back of it, and add up both."""
        engine = self.model.engine
        back = self.give_back(load, arm)
        if back is not None and engine.own_boundaries:
            back = engine.guard.load(self, "give_back", back, 0)
        came, given = load.total, 0.0 if back is None else back.total
        if given > came * (1.0 + 1e-12) and engine.own_boundaries:
            told = f"gives back {given:g} N of {came:g} N; a boundary cannot add load: describe"
            raise engine.guard.wrong(self, "give_back", f"{told} that as a load of the scene")
        self.taken[load.direction] += came
        self.passed[engine.opposite[arm]] += given
        self.kept += came - given
        return back

    def give_back(self, load: Load, arm: int) -> Load | None:
        """Return the load that goes back to its sender.

        Parameters
        ----------
        load : Load
            What arrived: `direction`, `magnitude` (N), number of `copies`, and `sense`.
        arm : int
            The face normal over which it left the body.

        Returns
        -------
        Load or None
            No more than arrived, as ``self.turn(load, arm)._replace(magnitude=0.1)``; None is none.
        """
        back = self.turn(load, arm)
        if not isinstance(back, Load):
            told = "must return the load on its way back (give_back may return None), got"
            raise self.model.engine.guard.wrong(self, "turn", f"{told} {brief(back)}")
        return back

    def turn(self, load: Load, arm: int) -> Load:
        """Return the load on its way back."""
        told = "has no such method; write it, or subclass a kind, such as kaju.RigidBoundaryAgent"
        raise self.model.engine.guard.wrong(self, "turn", told)


class FreeBoundaryAgent(BoundaryAgent):
    """Air, water, gas or vacuum: nothing is ahead, so the load comes back with its force.

    Where loads have a sense, what arrives straight travels back: a push comes back as a pull,
    a pull as a push, as a wave does at a free end.

    Examples
    --------
    >>> import kaju
    >>> model = kaju.LoadModel(kaju.load_scene("plate.toml"))  # that `kaju new plate.toml` writes
    >>> result = model.run()
    >>> walls = model.agents_by_type[kaju.FreeBoundaryAgent]
    >>> round(sum(wall.returned for wall in walls), 3)  # N
    0.135
    """

    name = "free"

    def turn(self, load: Load, arm: int) -> Load:
        """Keep the force; change the sense of a load along the normal."""
        straight = self.model.transfer.rule.sense and self.model.heading(load) == arm
        return load.turned() if straight else load


class RigidBoundaryAgent(BoundaryAgent):
    """Ground, a wall or a punch: it pushes or pulls back, so the load comes back reversed.

    Examples
    --------
    >>> import kaju
    >>> model = kaju.LoadModel(kaju.load_scene("plate.toml").replace(sides={"top": "rigid"}))
    >>> result = model.run()
    >>> wall = next(iter(model.agents_by_type[kaju.RigidBoundaryAgent]))  # above the body
    >>> wall.turn(kaju.Load(direction=3, magnitude=0.5), arm=3)  # upwards; it comes back downwards
    Load(direction=2, magnitude=0.5, copies=1.0, sense='push')
    """

    name = "rigid"

    def turn(self, load: Load, arm: int) -> Load:
        """Reverse the force and keep the sense."""
        return load._replace(direction=self.model.engine.opposite[load.direction])


class RollerBoundaryAgent(BoundaryAgent):
    """A smooth wall: it gives back the component of a load along its normal reversed, the rest not.

    Examples
    --------
    >>> import kaju
    >>> model = kaju.LoadModel(kaju.load_scene("plate.toml").replace(sides={"top": "roller"}))
    >>> result = model.run()
    >>> wall = next(iter(model.agents_by_type[kaju.RollerBoundaryAgent]))  # above the body
    >>> [wall.turn(kaju.Load(way, magnitude=0.5), arm=3).direction for way in (3, 1)]  # +y, +x
    [2, 1]
    """

    name = "roller"

    def turn(self, load: Load, arm: int) -> Load:
        """Mirror the force at the wall, whose normal is the arm, and keep the sense."""
        return load._replace(direction=int(self.model.lattice.mirrored[arm, load.direction]))


BOUNDARIES: dict[str, type[BoundaryAgent]] = {
    each.name: each for each in (FreeBoundaryAgent, RigidBoundaryAgent, RollerBoundaryAgent)
}
