from kaju import MaterialAgent


class Pillar(MaterialAgent):
    """Hands loads straight ahead and to nobody beside."""

    def emissions(self, load):
        return [row for row in super().emissions(load) if row.arm == load.direction]
