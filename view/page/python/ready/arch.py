from kaju import MaterialAgent, Parameter


class ArchMaker(MaterialAgent):
    """Hands less ahead and more beside: loads go round what is below them."""

    aside = Parameter(0.3, 0.0, 0.9, "part of the load ahead that goes beside")

    def emissions(self, load):
        rows = super().emissions(load)
        ahead = sum(row.share for row in rows if row.arm == load.direction)
        beside = [row for row in rows if row.arm != load.direction]
        along = [row for row in beside if row.direction == load.direction]
        more = self.aside * ahead / max(1, len(along))
        return [
            row._replace(
                share=row.share
                + (
                    more
                    if row in along
                    else -self.aside * ahead
                    if row.arm == load.direction
                    else 0.0
                )
            )
            for row in rows
        ]
