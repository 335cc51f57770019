"""Will the loads end? A certificate that is stated before a run.

The transfer operator T takes the loads of one generation, one number per cell and direction,
to those of the next. All its entries are shares, hence not negative, and boundaries give
back all they get; so every column of T sums up to what an agent of that cell's material
emits per newton. Where all agents emit the same, that sum *is* the spectral radius, because
1ᵀT = c 1ᵀ; where materials differ it lies between the smallest and the largest sum.

These sums know nothing of γ, up to which loads end. So a scene of which they do not say that its
loads end is tried: more than its own run tells, nobody can know.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import floor, inf, log

from kaju.arrays import first_largest
from kaju.model.scene import Scene
from kaju.model.stepper import counted

from .array_engine import ArrayEngine
from .transfer import Transfer, split_force

MOST_GROWN = 1e12
"""A run stops when its loads are more than so many times the applied ones."""


@dataclass(frozen=True)
class Certificate:
    """What is known of a run before it starts."""

    lower: float  # bounds of the spectral radius of the transfer operator, boundaries included
    upper: float
    spectral_radius: float | None  # growth per generation of loads that are all added up, if known
    largest_share: float  # of a load that is passed on in one piece
    generations: int | None  # after which every load has ended, if known; not with an order
    stable: bool  # whether the run is sure to end
    verdict: str  # the same in words, with a remedy if the run is unstable
    known: bool = True  # not of agents of your own, nor where a trial has told nothing


def not_known(agents: list[str]) -> Certificate:
    """Return the certificate of agents of your own, which pass on what they like."""
    verdict = (
        f"not known whether loads end: agents of your own ({', '.join(agents)}) decide; the run "
        "stops if the loads grow to 1000 times the applied ones"
    )
    return Certificate(0.0, inf, None, inf, None, stable=False, verdict=verdict, known=False)


def stability(scene: Scene) -> Certificate:
    """Return the certificate of a scene: whether its loads end under its prescribed rule.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    Certificate
        `stable`, and in words the `verdict`, with what to do if loads do not end.

    Examples
    --------
    >>> import kaju
    >>> kaju.stability(kaju.load_scene("plate.toml")).verdict
    'every load ends after at most 8 generations'
    """
    return certify(Transfer(scene))


def certify(transfer: Transfer, ordered: bool = False) -> Certificate:
    """Do the work of `stability` for a rule in tables; `ordered`: an order decides who acts."""
    scene, emitted = transfer.scene, transfer.emitted
    # Without what rounding adds: shares that sum up to 1 neither grow nor end.
    lower, upper = (float(f"{sums:.12g}") for sums in (emitted.min(), emitted.max()))
    radius = upper if lower == upper else None
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
        generations, grown = _tried(transfer)
        known_to_end = generations is not None or (grown if transfer.rule.accumulate else surely)
        verdict = f"{growth}: {remedy}"
        if generations is not None:
            after = "" if ordered else f" after {counted(generations, 'generation')}"
            verdict = (
                f"the loads come to rest{after}, because loads up to the threshold end; with a "
                f"much lower threshold {growth}"
            )
        elif not known_to_end:
            verdict = f"{growth}, unless the threshold ends them: only the run can tell"
    elif generations == 0:
        verdict = "no load exceeds the threshold: nothing happens"
    else:
        soon = f" after at most {counted(generations, 'generation')}"
        soon = "; an order of your own decides how soon" if ordered else soon
        verdict = f"every load ends{soon}"
        if upper > 1.0 and generations * log(upper) > log(MOST_GROWN):
            verdict += (
                f", but there may be more and more loads: their sum grows by up to "
                f"{100.0 * (upper - 1.0):.3g} % a generation, and a run stops when it is 1e12 "
                "times the applied loads"
            )
    stable, latest = generations is not None, None if ordered else generations
    return Certificate(lower, upper, radius, largest_share, latest, stable, verdict, known_to_end)


def _tried(transfer: Transfer) -> tuple[int | None, bool]:
    """Run a scene for a while, as pages do; return when it came to rest, and whether loads grew."""
    scene, engine, rows, last = transfer.scene, ArrayEngine(transfer), 0, 0
    for stage in range(1, scene.stages + 1):
        live_on = stage > 1 and scene.loading == "continue"
        engine.start(*transfer.loads(stage), live_on=live_on)
        begun = engine.generation
        while engine.pending != 0.0:
            rows += len(engine.waiting.place)
            grown = not engine.pending <= 1e3 * engine.applied
            if grown or rows > 300_000 or engine.generation - begun >= 300:
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
            "lower α₂ (passed ahead), α₃ (to each side) and α₁ below 1",
        )
    way = transfer.lattice.way(0, 0).beside
    beside = sum(each.friction for each in way)
    sideways = beside * shares.friction + sum(each.poisson for each in way) * shares.poisson
    if upper == 1.0:
        growth = "loads stay as they are"
    elif lower <= 1.0:
        growth = f"loads may grow by up to {100.0 * (upper - 1.0):.3g} % a generation in {name!r}"
    else:
        growth = f"loads grow by {100.0 * (lower - 1.0):.3g} % a generation"
    forward = 1.0 - sideways
    friction = (1.0 - shares.forward - (sideways - beside * shares.friction)) / beside
    remedies = [
        f"{word} below {limit:.4g}"
        for word, limit in (("α₂ (passed ahead)", forward), ("α₃ (to each side)", friction))
        if limit > 0.0
    ]
    remedy = f"lower {' or '.join(remedies)}" if remedies else "lower all shares of it"
    return growth, f"{remedy}, or judge each load by itself (accumulate = false)"
