from kaju import MaterialAgent, State


class Random(MaterialAgent):
    """Draws once how much of the side loads goes left."""

    left = State(0.0, "part that goes to the first side")

    def __init__(self, *start):
        super().__init__(*start)
        self.left = self.random.random()

    def emissions(self, load):
        rows = super().emissions(load)
        return [
            row._replace(share=row.share * 2.0 * (self.left if row.arm == 0 else 1.0 - self.left))
            if row.arm < 2 and load.direction > 1
            else row
            for row in rows
        ]
