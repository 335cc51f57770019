"""Material that breaks above a strength: pull ever harder, and less reaches the ground."""

import numpy as np

from kaju import LoadModel, MaterialAgent, PrescribedRule, RigidBoundaryAgent, Scene

STRENGTH = {"weak": 1.0, "middling": 1.5, "strong": 2.0}  # N


class Brittle(MaterialAgent):
    """Breaks when it has taken more than its strength, and then passes nothing on."""

    @property
    def broken(self):
        return sum(self.taken.values()) > STRENGTH[self.material.name]

    def emissions(self, load):
        return () if self.broken else super().emissions(load)


class Anchor(RigidBoundaryAgent):
    """Keeps what reaches it, so that every load goes down its bar only once."""

    def give_back(self, load, arm):
        return None


def scene(force=3.0, stages=24):
    """Three bars side by side that share nothing, pulled up in stages."""
    fibre = {"youngs_modulus": 1e9, "poissons_ratio": 0.0}
    return Scene(
        body={"cell_size": 0.01, "thickness": 0.01, "drawing": "\n".join(["w.m.s"] * 6)},
        legend={"w": "weak", "m": "middling", "s": "strong", ".": "air"},
        materials=dict.fromkeys(STRENGTH, fibre),
        sides={"bottom": "rigid"},
        loads=[
            {"cell": [column, 5], "side": "top", "force": [0.0, force], "steps": stages}
            for column in (0, 2, 4)
        ],
        rule=PrescribedRule(alpha=(0.5, 0.95, 0.0), beta=1.0, threshold=0.01, sense=True),
    )


def load_path():
    """Return the applied load (N) and what the anchors felt of it (N), stage by stage."""
    model = LoadModel(scene(), material_agent=Brittle, boundary_agents={"rigid": Anchor})
    ledgers = [stage.ledger for stage in model.run().stages]
    return np.array([(ledger.applied, ledger.absorbed) for ledger in ledgers]).T


if __name__ == "__main__":
    for applied, felt in load_path().T:
        print(f"{applied:5.2f} N applied, {felt:5.2f} N reach the ground {'#' * round(10 * felt)}")
