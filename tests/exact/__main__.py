"""Print how close the elastic solver comes to known solutions, as the table of the docs.

Every line is one validation problem: the powers of the cell size by which the errors of
displacement and stress fall, and the errors at one resolution. Run it with

    cd tests && python -m exact
"""

from . import CONVERGING_PROBLEMS, EXACT_PROBLEMS, convergence

HEAD = "| problem | order (u; σ) | error (u; σ) | cells | source |\n|---|---|---|---|---|"
SHORT = {
    "Timoshenko & Goodier, Theory of Elasticity": "T&G",
    ", Finite Elements in Analysis and Design 1, 3-20": "",
    ", J. Applied Mechanics 19, 526-528": "",
}
"""What the text below the table says of sources."""


def exact_line(problem):
    """Return the line of a problem whose answer the grid represents, if it does."""
    resolution = max(problem.resolutions)
    result = problem.solve(resolution, tolerance=1e-13)
    error = max(problem.error(result, quantity) for quantity in problem.orders)
    if error < 1e-10:
        return line(problem, "exact", f"{error:.0e}", result.grid.lattice.shape)
    return converging_line(problem, (8, 16, 32))


def converging_line(problem, resolutions=None):
    """Return the line of a problem whose errors fall with the cells."""
    studies = convergence(problem, resolutions)
    shape = problem.scene(next(iter(studies.values())).resolutions[-1]).lattice.shape
    both = [studies.get(quantity) for quantity in ("displacement", "stress")]
    orders = "; ".join(f"{study.order:.2f}" if study else "–" for study in both)
    errors = "; ".join(f"{study.errors[-1]:.1e}" if study else "–" for study in both)
    return line(problem, orders, errors, shape)


def line(problem, order, error, shape):
    source = problem.source
    for whole, short in SHORT.items():
        source = source.replace(whole, short)
    cells = " × ".join(map(str, shape))
    return f"| {problem.title} | {order} | {error} | {cells} | {source} |"


def main():
    print(HEAD)
    for kind in EXACT_PROBLEMS:
        print(exact_line(kind()))
    for kind in CONVERGING_PROBLEMS:
        print(converging_line(kind()))


if __name__ == "__main__":
    main()
