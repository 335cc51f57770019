from kaju import MaterialAgent, Parameter


class Yielding(MaterialAgent):
    """Keeps its share only until it holds so much."""

    limit = Parameter(0.2, 0.0, 10.0, "the most that it keeps (N)")

    def take(self, load):
        super().take(load)
        self.kept = min(self.kept, self.limit)
