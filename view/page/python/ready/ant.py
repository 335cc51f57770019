from kaju import MaterialAgent


class Ant(MaterialAgent):
    """Hands the loads beside to the side on which more has been passed already."""

    def emissions(self, load):
        rows = super().emissions(load)
        ahead = [row for row in rows if row.arm == load.direction]
        beside = [row for row in rows if row.arm != load.direction]
        if not beside:
            return ahead
        trail = max(beside, key=lambda row: self.passed.get(row.arm, 0.0) - row.arm * 1e-9)
        return [*ahead, trail._replace(share=sum(row.share for row in beside))]
