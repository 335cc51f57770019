"""Will the loads end? A certificate that is stated before a run.

The transfer operator T takes the loads of one generation, one number per cell and direction,
to those of the next. All its entries are shares, hence not negative, and boundaries give
back all they get; so every column of T sums up to what an agent of that cell's material
emits per newton. Where all agents emit the same, that sum *is* the spectral radius, because
1ᵀT = c 1ᵀ; where materials differ it lies between the smallest and the largest sum, and
power iteration narrows it down (bounds of Collatz and Wielandt).

These sums know nothing of γ, up to which loads end. So a scene of which they do not say that its
loads end is tried: more than its own run tells, nobody can know.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, inf, log
from typing import TYPE_CHECKING

import numpy as np

from kaju.arrays import Floats, first_largest
from kaju.model.scene import Scene

from .array_engine import ArrayEngine
from .transfer import Transfer, split_force

if TYPE_CHECKING:
    from scipy.sparse import csr_array

MOST_CELLS_FOR_OPERATOR = 200_000
"""Above this many cells the operator is bounded but not iterated on."""

MOST_TRIED, MOST_ROWS, GROWN = 300, 300_000, 1e3
"""A scene is tried for so many generations, and rows of loads, until its loads are so many times
the applied ones; the page does the same."""


@dataclass(frozen=True)
class Certificate:
    """What is known of a run before it starts."""

    lower: float  # bounds of the spectral radius of the transfer operator, boundaries included
    upper: float
    spectral_radius: float | None  # growth per generation of loads that are all added up, if known
    largest_share: float  # of a load that is passed on in one piece
    generations: int | None  # after which every load has ended, at the latest, if known
    stable: bool  # whether the run is sure to end
    verdict: str  # the same in words, with a remedy if the run is unstable
    known: bool = True  # not of agents of your own, nor where a trial has told nothing


def not_known(agents: list[str]) -> Certificate:
    """Return the certificate of agents of your own, which pass on what they like."""
    verdict = (
        f"not known: agents of your own ({', '.join(agents)}) decide what they pass on; the run "
        "stops if the loads grow to 1000 times the applied ones"
    )
    return Certificate(0.0, inf, None, inf, None, stable=False, verdict=verdict, known=False)


def stability(scene: Scene) -> Certificate:
    """State whether the loads of a scene will end under its prescribed rule.

    Examples
    --------
    >>> import kaju
    >>> kaju.stability(kaju.load_scene("plate.toml")).verdict
    'every load ends within 8 generations'
    """
    return certify(scene, Transfer(scene))


def certify(scene: Scene, transfer: Transfer) -> Certificate:
    """Do the work of `stability` for a rule that is already in tables."""
    emitted = transfer.emitted
    lower, upper = float(emitted.min()), float(emitted.max())
    if upper - lower <= 1e-12 * upper:
        lower = upper
    if lower < upper and scene.lattice.size <= MOST_CELLS_FOR_OPERATOR:
        lower, upper = bound_spectral_radius(transfer_operator(scene, transfer))
    known = upper - lower <= 1e-6 * upper
    radius = 0.5 * (lower + upper) if known else None
    largest_share = float(transfer.tables.share.max(initial=0.0))
    applied = split_force(scene.lattice, transfer.applied(scene.stages).force)[2]
    if transfer.rule.accumulate:
        generations = _generations(float(applied.sum()), upper, transfer.rule.threshold)
    else:
        largest = float(applied.max(initial=0.0))
        generations = _generations(largest, largest_share, transfer.rule.threshold)
    known_to_end = True
    if generations is None:
        # Undiminished for ever is a load only if it is so wherever it comes.
        surely = float(transfer.tables.share.max(axis=2).min()) >= 1.0
        growth, remedy = _grows(transfer, lower, upper, surely)
        generations, grown = _tried(scene, transfer)
        known_to_end = generations is not None or (grown if transfer.rule.accumulate else surely)
        verdict = f"{growth}: {remedy}"
        if generations is not None:
            verdict = (
                f"the loads come to rest after {generations} generations, as what is not above the "
                f"threshold ends; with a much lower one, {growth}"
            )
        elif not known_to_end:
            verdict = f"{growth}, unless the threshold ends them: only the run can tell"
    elif generations == 0:
        verdict = "no load exceeds the threshold: nothing happens"
    else:
        unit = "generation" if generations == 1 else "generations"
        verdict = f"every load ends within {generations} {unit}"
    stable = generations is not None
    return Certificate(
        lower, upper, radius, largest_share, generations, stable, verdict, known_to_end
    )


def _tried(scene: Scene, transfer: Transfer) -> tuple[int | None, bool]:
    """Run a scene for a while; return when it came to rest, if it did, and whether loads grew."""
    engine, rows, last = ArrayEngine(transfer), 0, 0
    for stage in range(1, scene.stages + 1):
        live_on = stage > 1 and scene.loading == "continue"
        engine.start(*transfer.loads(stage), live_on=live_on)
        begun = engine.generation
        while engine.pending != 0.0:
            rows += len(engine.waiting.place)
            grown = not engine.pending <= GROWN * engine.applied
            if grown or rows > MOST_ROWS or engine.generation - begun >= MOST_TRIED:
                return None, grown
            engine.begin()
            engine.act()
        last = max(last, engine.generation - begun)
    return last, False


def _generations(load: float, decay: float, threshold: float) -> int | None:
    """Return how often `load` can be multiplied by `decay` and still exceed the threshold."""
    if load <= threshold:
        return 0
    if decay >= 1.0:
        return None
    if decay == 0.0:
        return 1
    return floor(log(threshold / load) / log(decay) * (1.0 + 1e-12)) + 1


def _grows(transfer: Transfer, lower: float, upper: float, surely: bool) -> tuple[str, str]:
    """Say why loads do not end, or may not, and which share to lower below what."""
    worst = first_largest(transfer.emitted.max(axis=1)) // transfer.lattice.forms
    shares, name = transfer.shares[worst], transfer.materials[worst].name
    if not transfer.rule.accumulate:
        return (
            f"a load that an agent of {name!r} passes on in one piece is not smaller than the "
            f"load it took, so it {'never ends' if surely else 'may never end'}",
            "lower forward (α₂), friction (α₃) and α₁ below 1",
        )
    way = transfer.lattice.way(0, 0).beside
    beside = sum(each.friction for each in way)
    sideways = beside * shares.friction + sum(each.poisson for each in way) * shares.poisson
    percent = 100.0 * (upper - 1.0)
    if lower < 1.0:
        growth = f"loads may grow by up to {percent:.3g} % a generation in {name!r}"
    else:
        growth = f"loads grow by {100.0 * (lower - 1.0):.3g} % a generation"
    forward = 1.0 - sideways
    friction = (1.0 - shares.forward - (sideways - beside * shares.friction)) / beside
    remedies = [
        f"{word} below {limit:.4g}"
        for word, limit in (("forward (α₂)", forward), ("friction (α₃)", friction))
        if limit > 0.0
    ]
    remedy = f"lower {' or '.join(remedies)}" if remedies else "lower all shares of it"
    return growth, f"{remedy}, or judge each load by itself (accumulate = false)"


def transfer_operator(scene: Scene, transfer: Transfer) -> csr_array:
    """Assemble T over all cells and states: of a load taken (column), what it sends (row)."""
    from scipy.sparse import coo_array

    lattice, states = scene.lattice, transfer.states
    everywhere = np.indices(lattice.shape).reshape(lattice.dimension, -1).T
    kinds = scene.kinds(everywhere)
    cells, material = everywhere[kinds >= 0], kinds[kinds >= 0]
    form = lattice.form(cells)
    # What lies over each arm: its type, and its row among the body's cells.
    neighbours = cells[:, None] + lattice.steps[form]
    beyond = scene.kinds(neighbours.reshape(-1, lattice.dimension)).reshape(len(cells), -1)
    row_of = np.full(int(np.prod(np.asarray(lattice.shape) + 2)), -1, dtype=np.int64)
    row_of[lattice.key(cells)] = np.arange(len(cells))
    row = row_of[lattice.key(neighbours.reshape(-1, lattice.dimension))].reshape(beyond.shape)
    # Every emission of every cell and state; boundaries give theirs back in another state.
    arm, state, share = (table[material * lattice.forms + form] for table in transfer.tables)
    cell = np.arange(len(cells))[:, None, None]
    over = beyond[cell, arm]
    state = np.where(over < 0, transfer.turned[np.minimum(over, -1), arm, state], state)
    target = np.where(over < 0, cell, row[cell, arm]) * states + state
    source = np.broadcast_to(cell * states + np.arange(states)[:, None], target.shape)
    sent, size = share > 0.0, len(cells) * states
    entries = (share[sent], (target[sent], source[sent]))
    return coo_array(entries, shape=(size, size)).tocsr()


def bound_spectral_radius(
    operator: csr_array, iterations: int = 2000, tolerance: float = 1e-9
) -> tuple[float, float]:
    """Bound the spectral radius of a matrix without negative entries, if possible to `tolerance`.

    For every positive x the radius of A lies between the smallest and the largest of (Aᵀx)ᵢ/xᵢ
    (Collatz, Wielandt). Adding half of the identity keeps loads from swinging to and fro.
    """
    transposed = operator.T.tocsr()
    x: Floats = np.ones(operator.shape[0])
    lower, upper = 0.0, float(np.inf)
    for _ in range(iterations):
        image = transposed @ x
        ratio = image / x
        lower, upper = max(lower, float(ratio.min())), min(upper, float(ratio.max()))
        if upper - lower <= tolerance * upper:
            break
        x = image + 0.5 * upper * x
        x /= x.max()
        x = np.maximum(x, 1e-200)
    return lower, upper
