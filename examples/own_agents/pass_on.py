"""`pass_on`: agents that decide themselves whom they hand what. Nothing goes beside."""

from kaju import LoadModel, MaterialAgent, Parameter, Scene


class OnlyAhead(MaterialAgent):
    """Hands everything straight on, a little less each time."""

    loss = Parameter(0.1, 0.0, 0.9, "what is lost from cell to cell")

    def pass_on(self, load):
        ahead = load._replace(magnitude=(1.0 - self.loss) * load.magnitude)
        if ahead.magnitude > self.model.threshold:
            self.model.hand_over(self, load.direction, ahead)
        else:
            self.dropped += ahead.total


def reaches(loss, height=20):
    """Return how many cells below the load are reached."""
    plate = Scene(
        body={"cell_size": 0.01, "cells": [5, height], "material": "steel"},
        sides={"bottom": "rigid"},
        loads=[{"cell": [2, height - 1], "force": [0.0, -2.0]}],
    )
    return len(
        LoadModel(plate, material_agent=OnlyAhead, loss=loss, threshold=0.1).run().last.cells
    )


if __name__ == "__main__":
    for loss in (0.1, 0.3, 0.5):
        print(f"{loss:.0%} lost from cell to cell: {reaches(loss)} cells are reached")
