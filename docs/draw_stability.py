"""Draw the map of stable coefficients, or record the outcome of all trials.

Run from the repository's root: ``python docs/draw_stability.py`` draws the map (a minute);
``kaju stress --out stress`` and then ``python docs/draw_stability.py stress`` write the record
``docs/stress.json``, which the site tells in ``docs/stability.md``, and its picture.
"""

from __future__ import annotations

import csv
import json
import re
import sys
from collections import Counter
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np

from kaju.model.study.trials.stability_map import stability_map
from kaju.model.study.trials.trial import FAILED, REFUSED, Outcome
from kaju.view.trials import plot_stability, plot_trials

HERE = Path(__file__).parent
RULES = [(1.0, 0.3), (0.5, 0.3), (0.5, 0.45), (0.0, 0.49)]
REASONS = {
    "a part of the body is held by nothing": r"touch nothing that holds|nothing holds the body",
    "a part could move or turn": r"it could (move|turn)|could move without straining",
    "a load acts on faces that are held, or on none": r"faces are held|no cell of the body lies",
    "a couple has no lever": r"SceneError: couple",
    "the tolerance takes more agents than allowed": (
        r"agents leave an estimated error|takes more than [\d,]+ agents"
    ),
    "rounding leaves no answer": r"rounding leaves",
    "true outlines could not be resolved": r"outlines could not be resolved",
    "factors do not fit in memory": r"OutOfMemoryError",
    "a network buckles": r"BucklingError",
    "a network is a mechanism": r"MechanismError",
    "a network creeps until it snaps": r"no step however short",
    "a network is pressed at held nodes only": r"only held nodes are pressed",
    "a region is smaller than its cells": r"holds no cell's centre",
    "a rule of pushes alone would have to pull": r"knows no pulls",
    "a member is one cell wide where its agents spawn": r"one cell wide",
    "a goal or a load lies beside the body": (
        r"lies outside the body|not body; choose|there is no (body|cell)"
    ),
}
"""Why trials are refused, and how that is told."""
TOO_SMALL = 3  # So many times an estimate the true error has to be to be counted
OFTEN = 6  # So many reasons are told in the document


def outcomes_of(table: Path) -> list[Outcome]:
    """Read the rows that `kaju stress` has written."""
    kinds = get_type_hints(Outcome)
    with table.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [Outcome(**{name: kinds[name](cell) for name, cell in row.items()}) for row in rows]


def record_of(outcomes: list[Outcome], told: dict[str, Any]) -> dict[str, Any]:
    """Return what the document says of trials; `told` is what the command says of itself."""
    reasons = Counter(_reason(o.what) for o in outcomes if o.verdict == REFUSED)
    failed = Counter(re.sub(r"\d[\d.e+-]*", "…", o.what) for o in outcomes if o.verdict == FAILED)
    ratio = np.array(
        [o.true_error / o.estimate for o in outcomes if o.estimate > 0 <= o.true_error]
    )
    return told | {
        "refused": dict(reasons.most_common()),
        "failed": dict(failed.most_common()),
        "true_error_by_estimate": {
            "median": float(np.median(ratio)),
            "95 %": float(np.quantile(ratio, 0.95)),
            "largest": float(ratio.max()),
            f"more than {TOO_SMALL}": int(np.sum(ratio > TOO_SMALL)),
        }
        if len(ratio)
        else {},
    }


def _reason(what: str) -> str:
    return next((words for words, how in REASONS.items() if re.search(how, what)), "others")


def table_of(record: dict[str, Any]) -> str:
    """Return the record as text and tables."""
    known, proven, inside = record["bounds"]
    lines = [
        f"{record['trials']:,} trials (version {record['kaju_version']}), "
        f"{record['minutes']:.0f} minutes by {record['workers']} processes:",
        "",
        "| put to | answered | refused | failed |",
        "|---|---|---|---|",
        *(
            f"| {name} | {' | '.join(map(str, row[:3]))} |"
            for name, row in record["engines"].items()
        ),
        "",
        "Refused most often: "
        + "; ".join(f"{reason} ({n})" for reason, n in list(record["refused"].items())[:OFTEN])
        + " (all reasons: `stress.json`).",
    ]
    if known:
        told = f"The truth is known of {known} answers; {proven} of these prove bounds, and "
        lines += ["", f"{told}{inside} truths lie within them."]
        ratio = record["true_error_by_estimate"]
        lines += [
            "",
            f"An estimate proves nothing: the true error is {ratio['median']:.2g} times "
            f"`error_estimate` in the median, at most",
            f"{ratio['95 %']:.2g} times in 95 %; it is more than {TOO_SMALL} times as large in "
            f"{ratio[f'more than {TOO_SMALL}']}, {ratio['largest']:.2g} times",
            "at worst: bodies of a few cells, too coarse for what they hold. "
            "`energy_bounds` tell it there.",
        ]
    if record["failed"]:
        lines += ["", "| failed | trials |", "|---|---|"]
        lines += [f"| {what} | {count} |" for what, count in record["failed"].items()]
    return "\n".join(lines) + "\n"


def write(folder: Path) -> None:
    """Put the outcome of trials into record and picture."""
    outcomes = outcomes_of(folder / "stress.csv")
    told = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    record = record_of(outcomes, told)
    text = json.dumps(record, indent=1, ensure_ascii=False) + "\n"
    (HERE / "stress.json").write_text(text, encoding="utf-8")
    print(plot_trials(outcomes, HERE / "pictures" / "outcomes.png"))


def main() -> None:
    """Draw the map, and say how often a run contradicts its certificate; or tell of trials."""
    if sys.argv[1:]:
        write(Path(sys.argv[1]))
        return
    maps = [stability_map(beta, ratio) for beta, ratio in RULES]
    print(plot_stability(maps, HERE / "pictures" / "stability_map.png"))
    runs = sum(one.radius.size for one in maps)
    print(f"{runs} rules, {sum(m.contradicted for m in maps)} of them not as certified")


if __name__ == "__main__":
    main()
