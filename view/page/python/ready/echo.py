from kaju import Emission, MaterialAgent


class Echo(MaterialAgent):
    """Sends a tenth of every load back to where it came from."""

    def emissions(self, load):
        behind = self.model.lattice.opposite[load.direction]
        return [*super().emissions(load), Emission(int(behind), load.direction, 0.1, load.sense)]
