"""The ledger as bars: where every newton came from and what became of it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from kaju.model.transfer.transfer_result import TransferResult

from .style import INK, caption, figure_of, label_axis, new_axes
from .units import quantity

_COLOURS = ("#3b6a8f", "#e2c14d", "#9fbfcf", "#b9b9b9")
_HATCHES = ("", "///", "...", "xx")


def plot_ledger(result: TransferResult, ax: Axes | None = None) -> Axes:
    """Draw the ledger of the last stage: two bars of equal length, and what was passed on."""
    ledger = result.last.ledger
    small = ledger.emitted - ledger.passed - ledger.returned
    bars = {
        "what entered": {"applied": ledger.applied, "sent out by agents": ledger.emitted},
        "what became of it": {
            "taken": ledger.taken,
            "dropped (up to γ)": ledger.dropped,
            "still on its way": ledger.pending,
        },
        "sent out": {
            "passed to agents": ledger.passed,
            "returned by boundaries": ledger.returned,
            "too small": max(small, 0.0),
        },
        "of it kept": {"as strain": ledger.kept},
    }
    ax = new_axes(ax, (7.6, 3.8))
    longest = max(ledger.applied + ledger.emitted, 1e-300)
    for row, parts in enumerate(bars.values()):
        _draw_bar(ax, row, parts, longest)
    ax.set_yticks(np.arange(len(bars)), list(bars), fontsize=9)
    ax.set_ylim(len(bars) - 0.4, -0.6)
    ax.set_xlim(0.0, longest)
    label_axis(ax.xaxis, "load", [longest], "N")
    for name in ("top", "right", "left"):
        ax.spines[name].set_visible(False)
    ax.tick_params(axis="y", length=0)
    lost = ledger.imbalance
    balance = f"to {lost:.0e} of all loads" if lost else "exactly"
    notes = [f"the books balance {balance}"]
    if ledger.applied > 0.0:
        often = f"{ledger.taken / ledger.applied:.3g} times"
        notes.append(
            f"{quantity(ledger.applied, 'N')} applied are taken {often} over: every agent that a "
            "load passes counts it anew"
        )
    caption(ax, "Ledger", notes)
    return ax


def _draw_bar(ax: Axes, row: int, parts: dict[str, float], longest: float) -> None:
    left = 0.0
    room = figure_of(ax).get_figwidth() * 0.82
    for number, (name, load) in enumerate(parts.items()):
        if load <= 0.0:
            continue
        ax.barh(row, load, left=left, height=0.5, color=_COLOURS[number], hatch=_HATCHES[number],
                edgecolor="white", linewidth=0.6)  # fmt: skip
        words = f"{name}\n{quantity(load, 'N')}"
        middle = left + 0.5 * load
        if room * load / longest > 0.085 * max(map(len, words.split("\n"))):
            box = {"fc": "white", "ec": "none", "pad": 1.0, "alpha": 0.85}
            ax.text(middle, row, words, ha="center", va="center", fontsize=7.5, color=INK, bbox=box)
        else:
            side = "right" if left > 0.5 * longest else "left"
            ax.annotate(
                words.replace("\n", " "),
                (middle, row + 0.25),
                (0, -3),
                textcoords="offset points",
                ha=side,
                va="top",
                fontsize=7.5,
                color=INK,
            )
        left += load
