"""The commands `kaju compare` and `kaju bench`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from kaju.errors import ParameterError, ResultFileError

if TYPE_CHECKING:
    from kaju.model.compare import Comparison

Stored = "A result or reference (.npz), or the folder of a run."


def compare(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help=f"{Stored} It is judged.")],
    reference: Annotated[
        Path, typer.Argument(metavar="REFERENCE", help=f"{Stored} It is believed.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="Folder for comparison.json and maps."),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace a comparison that is already there.")
    ] = False,
) -> None:
    """Say how far a result is from another one of the same body."""
    from kaju.model.compare import compare as compare_answers
    from kaju.model.compare import load_answer
    from kaju.model.reference import Reference

    for path in (result, reference):
        if path.suffix == ".toml":
            raise ParameterError(
                f"{path}: is a scene; run it first (kaju run {path}), then compare its folder"
            )
    judged = load_answer(result)
    if isinstance(judged, Reference):
        raise ParameterError(f"{result}: is a reference, which is believed; name it second")
    found = compare_answers(judged, load_answer(reference))
    summary = found.summary()
    typer.echo(f"{summary['result']} against {summary['reference']}, {len(found.points)} points")
    typer.echo(f"  {'':14}{'largest error':>14}{'r.m.s. error':>14}{'misfit':>10}")
    for name in ("displacement", "stress"):
        if summary[name]:
            errors = summary[name]
            typer.echo(
                f"  {name:14}{errors['max_error']:14.4g}{errors['l2_error']:14.4g}"
                f"{errors['misfit']:10.4g}"
            )
    if found.energy_error is not None:
        typer.echo(f"  energy norm of the error {found.energy_error:.4g}")
    typer.echo(
        "  errors are shares of the reference's largest value; misfit: |difference| over |it|"
    )
    if out is not None:
        _write(found, out, force)


def _write(found: Comparison, folder: Path, force: bool) -> None:
    from kaju.view.comparison_maps import plot_error
    from kaju.view.files import save
    from kaju.view.style import figure_of

    target = folder / "comparison.json"
    if target.exists() and not force:
        raise ResultFileError(
            f"{target}: exists already; take another folder, or --force to replace it"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        target.write_text(json.dumps(found.summary(), indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise ResultFileError(f"{folder}: cannot be written: {error.strerror}") from error
    typer.echo(target)
    for name in ("displacement", "stress") if found.stress else ("displacement",):
        picture = save(figure_of(plot_error(found, name)), folder / f"error_{name}.png")
        typer.echo(picture)


def bench(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder for table and picture.")
    ] = Path("kaju-bench"),
    quick: Annotated[
        bool, typer.Option("--quick", help="Small sizes only, under a minute.")
    ] = False,
    problem: Annotated[
        list[str] | None,
        typer.Option(help="plate, block or pixels; all of them unless given. May be repeated."),
    ] = None,
) -> None:
    """Measure time and memory against error, for kaju and for finite elements.

    The finite elements are those of scikit-fem; they need the extra fem (pyamg comes with it).
    """
    from kaju.bench.run import run

    run(out, quick, tuple(problem or ()), typer.echo)
    for path in sorted(out.glob("work_precision.*")):
        typer.echo(path)
