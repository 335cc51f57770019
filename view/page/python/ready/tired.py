from kaju import MaterialAgent, Parameter, State


class Tired(MaterialAgent):
    """Every load that it takes makes it softer."""

    wear = Parameter(0.05, 0.0, 1.0, "softening by each load")
    count = State(0.0, "loads taken so far")

    def take(self, load):
        super().take(load)
        self.count += load.copies

    def shortening(self, axis):
        return (1.0 + self.wear * self.count) * super().shortening(axis)
