from kaju import Parameter, RigidBoundaryAgent


class LeakingWall(RigidBoundaryAgent):
    """Gives back a part of what reaches it and keeps the rest."""

    part = Parameter(0.3, 0.0, 1.0, "what it gives back of each newton")

    def give_back(self, load, arm):
        back = self.turn(load, arm)
        return back._replace(magnitude=self.part * back.magnitude)
