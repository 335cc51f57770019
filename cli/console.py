"""How the command speaks: words with units for people, JSON for programs, or nothing."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import typer

from kaju.errors import ParameterError
from kaju.view.units import grouped, quantity

UNITS = {
    key: unit
    for unit, keys in {
        "N": "threshold load_taken load_dropped load_applied reaction residual_load",
        "m": "max_displacement smallest_agent largest_agent displacement_left",
        "J": "potential_energy strain_energy energy_bounds",
        "s": "duration seconds",
    }.items()
    for key in keys.split()
}
"""Units of key figures; a key that ends in _N, _m, _J, _s or _Pa says its own."""

WORDS = {
    "spectral_radius": "growth_if_added_up",
    "seconds": "time_taken",
    "largest_stress_Pa": "largest_mean_von_Mises_Pa",  # over an agent
}
"""Keys that say more to a reader under another name."""


@dataclass(frozen=True)
class Console:
    """Where the command prints: all, the key figures as one JSON object, or nothing but errors."""

    as_json: bool = False
    quiet: bool = False

    def __post_init__(self) -> None:
        if self.as_json and self.quiet:
            raise ParameterError("--quiet: prints nothing, so --json would be lost; take one")

    def say(self, words: object) -> None:
        """Print a line for people."""
        if not (self.as_json or self.quiet):
            typer.echo(words)

    def figures(self, summary: Mapping[str, Any]) -> None:
        """Print key figures: as a table with units, or as JSON."""
        if self.as_json:
            typer.echo(json.dumps(summary, indent=2, allow_nan=False))
        for name, text in _rows(summary):
            self.say(f"  {name.replace('_', ' '):28} {text.replace('_', ' ')}")
        for note in summary.get("notes", ()):
            self.say(f"  note: {note}")

    def files(self, paths: Iterable[object]) -> None:
        """Print what was written, a path a line."""
        for path in paths:
            self.say(path)


def _rows(summary: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield key figures as people read them, but for the notes and what is not known."""
    for key, value in summary.items():
        if key == "notes" or (value is None and key not in WORDS):
            continue
        name, unit = WORDS.get(key, key), UNITS.get(key, "")
        stem, _, ending = name.rpartition("_")
        if stem and ending in ("N", "m", "J", "s", "Pa"):
            name, unit = stem, ending
        if isinstance(value, Mapping):
            yield from ((f"{name} {part}", text_of(v, unit)) for part, v in value.items())
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            for number, entry in enumerate(value, start=1):
                own = {"relative_error": ""}.get
                unit = entry.get("unit", "")
                told = {k: v for k, v in entry.items() if v is not None and k != "unit"}
                parts = [f"{part} {text_of(v, own(part, unit))}" for part, v in told.items()]
                yield f"{name} {number}", ", ".join(parts)
        else:
            yield name, text_of(value, unit)


def text_of(value: object, unit: str = "") -> str:
    """Return a key figure as people read it: four digits, and its unit."""
    if value is None:
        return "not known"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return grouped(value)
    if isinstance(value, float):
        return quantity(value, unit) if unit else f"{value:.4g}"
    if isinstance(value, (list, tuple)):
        numbers = [abs(part) for part in value if isinstance(part, float)]
        least = 1e-9 * max(numbers, default=0.0)  # beside the others, rounding is nothing
        parts = [0.0 if isinstance(v, float) and abs(v) < least else v for v in value]
        return ", ".join(text_of(part, unit) for part in parts) or "none"
    return str(value)
