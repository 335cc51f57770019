"""Every trial that has ever failed, with why: they run first, and must not fail again."""

from __future__ import annotations

CORPUS: dict[tuple[int, str], str] = {
    (732, "tolerance"): "a solid on which 10,000 agents were given millions of cells",
    (1262, "tolerance"): "forces beside those of a moved side, which left them hardly any digits",
    (2962, "tolerance"): "a solid next to ν = -1 that hardly balanced",
    (5162, "tolerance"): "forces that did not balance, without a word",
    (5219, "tolerance"): "leftovers that no side passes on: a proof without end",
    (6589, "tolerance"): "forces that nobody passes on",
    (8529, "tolerance"): "a solid given to millions of cells",
    (1124, "equal cells"): "factors of a part on a soft bed",
    (287, "equal cells"): "rounding that leaves nothing of an answer",
    (753, "described, tolerance"): "an error that no bound holds, as an infinite number",
    (792, "described, tolerance"): "the same, of loads that a wall bears where they act",
    (1770, "described, equal"): "the truth of other cells than those that were solved",
    (4738, "misbehaving agents"): "True as a direction, which masked an array",
    (4954, "goals"): "a share of loads that move nothing, by which it was divided",
    (335, "saved"): "a run on halved cells, which was not read again",
    (796, "network"): "a network that crept for ever",
    (5036, "network"): "a network that buckled while it crept",
    (945, "elastic agents"): "next to ν = 1/2, newtons that rounding lost, as if none may be",
    (3748, "true outlines"): "corners in line but for rounding, a pocket of itself without end",
    (20068, "true outlines"): "next to ν = 1/2, bounds that rounding put the wrong way round",
}
"""By number and kind, as `trials` takes them."""
