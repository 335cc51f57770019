from kaju import MaterialAgent


class OneWay(MaterialAgent):
    """Never hands a load to the left (arm 0)."""

    def emissions(self, load):
        return [row for row in super().emissions(load) if row.arm != 0]
