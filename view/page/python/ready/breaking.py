from kaju import MaterialAgent, Parameter, State


class Breaking(MaterialAgent):
    """Breaks for good when it keeps more than its strength."""

    strength = Parameter(1.2, 0.0, 5.0, "strength (N)")
    broken = State(False, "broken")

    def emissions(self, load):
        if self.kept > self.strength:
            self.broken = True
        return () if self.broken else super().emissions(load)
