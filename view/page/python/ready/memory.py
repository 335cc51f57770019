from kaju import MaterialAgent, State


class Remembering(MaterialAgent):
    """Hands loads on until loads of three directions have come to it."""

    met = State(0, "directions it has met")

    def __init__(self, *start):
        super().__init__(*start)
        self.known = set()

    def take(self, load):
        super().take(load)
        self.known.add(load.direction)
        self.met = len(self.known)

    def emissions(self, load):
        return super().emissions(load) if len(self.known) < 3 else ()
