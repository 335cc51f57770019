"""How the command speaks: words for people, JSON for programs, or nothing; and what a run writes.

A folder of results is written whole or not at all, and never over something else.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from kaju.errors import ResultFileError
from kaju.files import check_writable, hidden_folder, is_there
from kaju.view import PICTURES
from kaju.view.units import grouped, quantity

if TYPE_CHECKING:
    from kaju.model.results.result import Result

UNITS = {
    key: unit
    for unit, keys in {
        "N": "threshold load_taken load_dropped reaction residual_load",
        "m": "max_displacement displacement_left",
        "length": "smallest_agent largest_agent",  # m, as in scenes, whatever its size
        "J": "potential_energy strain_energy energy_bounds",
        "s": "duration seconds",
    }.items()
    for key in keys.split()
}
"""Units of key figures; a key that ends in _N, _m, _J, _s or _Pa says its own."""

MEANINGS = {
    "avalanches": "breaks that follow without more load are one",
    "boundary_agents": "places beside the body that loads reached",
    "compliance_J": "work of the loads: the lower, the stiffer the body",
    "couple_Nm": "of the support on the body, about its middle; in the plane > 0 turns left",
    "energy_bounds": "the true energy lies between them",
    "error_bound": "of the whole body, in the energy norm; the true error is not larger",
    "error_estimate": "a share, in the energy norm: 0.05 is 5 %",
    "free_boundary_agents": "in the air, which hands loads back as they came",
    "generations": "rounds in which agents acted; if they spawned, pages call the first one 0",
    "goal_error_bound": "the true error is not larger: proved",
    "goal_error_estimate": "of the arithmetic, not of how the part is held and loaded",
    "goal_relative_error": "a share: 0.05 is 5 %; of a vector, of its length",
    "grey": "0: every cell is full or empty; 1: all are half full",
    "largest_change": "of a density, in the last step",
    "largest_hoop_stress_Pa": "the largest by amount along that outline; below 0 it is pressed",
    "largest_load_factor": "times the loads of the scene",
    "largest_stress_Pa": "away from where it has no limit (see notes), and along outlines",
    "load_dropped": "not above γ, so it woke nobody",
    "load_taken": "by all agents; a load counts again in each that passes it on",
    "material_agents": "cells of the body that a load above γ woke",
    "numerical_J": "lost by steps in time that are not small",
    "plane": "stress: a thin plate; strain: a slice of a long body",
    "reaction": "force of the support on the body, along each axis",
    "rigid_boundary_agents": "in the ground, which hands loads back reversed",
    "set_free_at_jumps_J": "by loads that are put on or taken off at once",
    "spectral_radius": "times as much load a generation, if loads that meet were added",
    "tolerance": "of the goal, if there is one; else of the error bound",
    "tolerance_kept": "of the goal or the energy norm, not of the stresses above",
}
"""What key figures mean, if their names do not say it."""

NAMES = {
    "spectral_radius": "growth_if_added_up",
    "seconds": "time_taken",
    "largest_stress_Pa": "largest_von_Mises_Pa",
    "largest_stress_at_m": "largest_von_Mises_at_m",
    "load_dropped": "load_ended",
    "goals": "goal",
}
"""Keys that say more to a reader under another name."""

SAID = {"notes", "outcome", "model", "kaju_version", "iterations", "residual", "subdivision"}
SAID |= {"goal", "goal_error", "load_returned", "load_absorbed", "load_waiting"}
"""Keys that stand in other lines, as in those of goals, or are for files."""


@dataclass(frozen=True)
class Console:
    """Where the command prints: all, the key figures as one JSON object, or nothing but errors."""

    as_json: bool = False
    quiet: bool = False  # but for the figures, if these are asked for

    def say(self, *lines: object) -> None:
        """Print lines for people."""
        for line in () if self.as_json or self.quiet else lines:
            typer.echo(line)

    def figures(self, summary: Mapping[str, Any]) -> None:
        """Print key figures: as a table with units, or as JSON."""
        if self.as_json:
            typer.echo(json.dumps(summary, indent=2, allow_nan=False))
        rows = [*_rows(summary)]
        width = max([28, *(len(name) for name, _, _ in rows)])
        notes = [f"  note: {note}" for note in summary.get("notes", ())]
        self.say(*(note for note in notes if "?" in note))
        for name, text, meaning in rows:
            self.say(f"  {name:{width}} {text.replace('_', ' '):12}  {meaning}".rstrip())
        self.say(*(note for note in notes if "?" not in note))


def _rows(summary: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield key figures as people read them, goals first, with what they mean, if it is known."""
    for key, value in sorted(summary.items(), key=lambda item: item[0] != "goals"):
        # Of a goal its own error counts, and of an answer with a bound the bound.
        other = "goals" in summary or value == summary.get("error_bound")
        said = key in SAID or key.endswith("_doubt") or (key == "error_estimate" and other)
        if said or value is None:
            continue
        name, unit, meaning = NAMES.get(key, key), UNITS.get(key, ""), MEANINGS.get(key, "")
        meaning = summary.get(f"{key}_doubt") or meaning
        stem, _, ending = name.rpartition("_")
        if stem and ending in ("N", "Nm", "m", "J", "s", "Pa"):
            name, unit = stem, "length" if stem.endswith("_at") else ending
        name = name.replace("_", " ")
        if isinstance(value, Mapping):
            beside = [part for each in value.values() if isinstance(each, list) for part in each]
            for part, v in value.items():  # names of the user's own are quoted
                called = repr(part) if key.startswith("largest_hoop") else part
                yield f"{name} {called}", text_of(v, unit, beside=beside), meaning
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            for number, entry in enumerate(value, start=1):
                told = {k.removesuffix("_m"): v for k, v in entry.items() if v is not None}
                own, units = told.pop("unit", ""), {"at": "length", "relative_error": ""}
                called = f"{name} {number}" if len(value) > 1 else name
                if "error_bound" in told:
                    del told["error_estimate"]
                yield called, told.pop("quantity"), meaning
                for k, v in told.items():
                    text = text_of(v, units.get(k, own), named=True)
                    yield f"{called} {k.replace('_', ' ')}", text, MEANINGS.get(f"goal_{k}", "")
        else:
            yield name, text_of(value, unit), meaning


def text_of(value: object, unit: str = "", named: bool = False, beside: Sequence[Any] = ()) -> str:
    """Return a key figure as people read it: four digits, its unit, and perhaps its axes."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return grouped(value)
    if isinstance(value, float):
        plain = {"": "", "length": " m"}.get(unit)
        return quantity(value, unit) if plain is None else f"{value:.4g}{plain}"
    if isinstance(value, (list, tuple)):
        numbers = [abs(part) for part in (*value, *beside) if isinstance(part, float)]
        least = 1e-5 * max(numbers, default=0.0)  # nothing beside four digits of the largest
        parts = [0.0 if isinstance(v, float) and abs(v) < least else v for v in value]
        axes = ("x ", "y ", "z ") if named else [""] * len(parts)
        return ", ".join(a + text_of(v, unit) for a, v in zip(axes, parts, strict=False)) or "none"
    return str(value)


class Folder:
    """A place for results, made or replaced (`force`) when these are there; other files stay."""

    def __init__(self, path: Path, force: bool = False) -> None:
        self.path, self.force = path, force
        if is_there(path) and not path.is_dir():
            raise ResultFileError(f"{path}: is a file; --out needs a folder")
        if Path.cwd().is_relative_to(path.resolve()):
            told = "is the working folder or holds it, and results need a folder of their own"
            raise ResultFileError(f"{path}: {told}; take a new one, as {Path.cwd() / 'result'}")
        if is_there(path) and any(path.iterdir()) and not force:
            told = "is not empty; take another folder, or --force to replace the results in it"
            raise ResultFileError(f"{path}: {told}")
        check_writable(path, ResultFileError)

    def fill(self, write: Callable[[Path], object]) -> list[Path]:
        """Let files be written aside, and give them their places; return these.

        A new folder appears in one step; with `force` whole files replace those of their names,
        one by one, and results that are not written again go.
        """
        with hidden_folder(self.path, ResultFileError) as scratch:
            write(scratch)
            names = sorted(file.name for file in scratch.iterdir())
            if self.force and is_there(self.path):
                for name in names:
                    (scratch / name).replace(self.path / name)
                for name in {"summary.json", "result.npz", *PICTURES}.difference(names):
                    (self.path / name).unlink(missing_ok=True)
            else:
                scratch.replace(self.path.resolve())  # refused where it is not empty
        return [self.path / name for name in names]

    def write(self, result: Result, pictures: str) -> list[Path]:
        """Write summary.json, result.npz and "one", "all" or "none" of the pictures."""

        def parts(scratch: Path) -> None:
            result.save(scratch / "result.npz")
            write_json(scratch / "summary.json", result.summary())
            if pictures == "all":
                from kaju.view.plots import plot_all

                plot_all(result, scratch)
            elif pictures == "one":
                from kaju.view.plots import plot
                from kaju.view.style import save

                save(plot(result), scratch / f"{result.pictures[0]}.png")

        return self.fill(parts)


def write_json(path: Path, figures: Mapping[str, Any]) -> None:
    """Write key figures as JSON."""
    path.write_text(json.dumps(figures, indent=2, allow_nan=False) + "\n", encoding="utf-8")
