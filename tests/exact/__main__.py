"""Print how close the elastic solver comes to known solutions, as the table of the docs.

Every line is one validation problem: what is compared, the power of the cell size by which
the error falls, and the error at one resolution. Run it with

    cd tests && python -m exact
"""

from __future__ import annotations

from collections.abc import Iterator

from . import (
    CONVERGING_PROBLEMS,
    EXACT_PROBLEMS,
    KnownProblem,
    LCorner,
    SaintVenantDecay,
    convergence,
)
from .eigenfields import DECAY, EXPONENT

HEAD = "| problem | compared | order | error | cells | source |\n|---|---|---|---|---|---|"


def exact_lines(problem: KnownProblem) -> Iterator[str]:
    """Yield the line of a problem whose answer the grid represents, if it does."""
    resolution = max(problem.resolutions)
    result = problem.solve(resolution, tolerance=1e-13)
    error = max(problem.error(result, quantity) for quantity in problem.orders)
    if error < 1e-10:
        compared = " and ".join(problem.orders)
        yield line(problem, compared, "exact", error, result.grid.lattice.shape)
    else:
        yield from converging_lines(problem, (8, 16, 32))


def converging_lines(
    problem: KnownProblem, resolutions: tuple[int, ...] | None = None
) -> Iterator[str]:
    """Yield a line for each quantity that a problem compares."""
    for quantity, study in convergence(problem, resolutions).items():
        shape = problem.scene(study.resolutions[-1]).lattice.shape
        yield line(problem, quantity, f"{study.order:.2f}", study.errors[-1], shape)


def line(
    problem: KnownProblem, compared: str, order: str, error: float, shape: tuple[int, ...]
) -> str:
    cells = " × ".join(map(str, shape))
    shown = f"{error:.0e}" if error < 1e-10 else f"{error:.1e}"
    return f"| {problem.title} | {compared} | {order} | {shown} | {cells} | {problem.source} |"


def exponents() -> Iterator[str]:
    """Yield what two problems tell beside fields: how fast these grow or die away."""
    corner, strip = LCorner(), SaintVenantDecay()
    yield "| cells per metre | corner: λ | strip: γ |"
    yield "|---|---|---|"
    for resolution in (16, 32, 64):
        rate = corner.exponent(corner.solve(resolution))
        decay = strip.decay(strip.solve(resolution))
        yield f"| {resolution} | {rate:.5f} | {decay.real:.5f} + {decay.imag:.5f}i |"
    yield f"| theory | {EXPONENT:.5f} | {DECAY.real:.5f} + {DECAY.imag:.5f}i |"


def main() -> None:
    print(HEAD)
    for kind in EXACT_PROBLEMS:
        for text in exact_lines(kind()):
            print(text)
    for kind in CONVERGING_PROBLEMS:
        for text in converging_lines(kind()):
            print(text)
    print()
    for text in exponents():
        print(text)


if __name__ == "__main__":
    main()
