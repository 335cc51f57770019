from kaju import MaterialAgent


class OneWay(MaterialAgent):
    """Never hands a load to one arm: 0 left, 1 right, 2 down, 3 up."""

    def emissions(self, load):
        return [row for row in super().emissions(load) if row.arm != 0]
