from kaju import MaterialAgent


class Mine(MaterialAgent):
    """What every agent does: it keeps a share of each load and passes the others on."""

    def take(self, load):
        super().take(load)

    def emissions(self, load):
        return super().emissions(load)

    def pass_on(self, load):
        super().pass_on(load)
