"""Which array engine would run the block sweep, and what its smoother has to become.

A sweep over 1024² cells in blocks of 16² with one layer of ghosts, as flat padded arrays: every
face takes its damped share of what is unbalanced (Jacobi), all blocks alike. It is written once in
NumPy and once for each engine that is installed (numba, JAX, Warp); all must agree to rounding.
Then, on one block of 64² cells: how much of a rough error one sweep of each order takes away.
Processor time, the least of five: `python benchmarks/array_engines.py`.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from time import process_time
from typing import Any

import numpy as np

CELLS, EDGE = 1024, 16
NU = 0.3
C11, C12, MU = 1.0 / (1.0 - NU**2), NU / (1.0 - NU**2), 0.5 / (1.0 + NU)
K = 2.0 * (C11 + MU)
"""Stiffness of an inner face, per thickness."""
OMEGA = 0.6
"""Below 2/λmax = 0.675 of D⁻¹K at ν = 0.3."""


def unbalanced(u: Any, v: Any, p: Any, q: Any) -> tuple[Any, Any]:
    """Return what is unbalanced on the inner faces of padded arrays (..., EDGE + 2, EDGE + 2)."""
    c, w, e = slice(1, -1), slice(None, -2), slice(2, None)
    cross = C12 + MU
    r = p[..., c, c] - K * u[..., c, c]
    r = r + C11 * (u[..., w, c] + u[..., e, c]) + MU * (u[..., c, w] + u[..., c, e])
    r = r + cross * (v[..., c, e] - v[..., c, c] - v[..., w, e] + v[..., w, c])
    s = q[..., c, c] - K * v[..., c, c]
    s = s + C11 * (v[..., c, w] + v[..., c, e]) + MU * (v[..., w, c] + v[..., e, c])
    s = s + cross * (u[..., e, c] - u[..., c, c] - u[..., e, w] + u[..., c, w])
    return r, s


def with_numpy(u: Any, v: Any, p: Any, q: Any) -> Callable[[], Any]:
    def sweep() -> Any:
        r, s = unbalanced(u, v, p, q)
        return u[:, 1:-1, 1:-1] + OMEGA / K * r, v[:, 1:-1, 1:-1] + OMEGA / K * s

    return sweep


def with_numba(u: Any, v: Any, p: Any, q: Any) -> Callable[[], Any]:
    from numba import njit

    a, b = np.empty_like(u), np.empty_like(v)

    @njit(fastmath=True)  # type: ignore[untyped-decorator]
    def run(u, v, p, q, a, b):  # type: ignore[no-untyped-def]
        cross = C12 + MU
        for k in range(u.shape[0]):
            for i in range(1, u.shape[1] - 1):
                for j in range(1, u.shape[2] - 1):
                    r = p[k, i, j] - K * u[k, i, j]
                    r += C11 * (u[k, i - 1, j] + u[k, i + 1, j])
                    r += MU * (u[k, i, j - 1] + u[k, i, j + 1])
                    r += cross * (v[k, i, j + 1] - v[k, i, j] - v[k, i - 1, j + 1] + v[k, i - 1, j])
                    s = q[k, i, j] - K * v[k, i, j]
                    s += C11 * (v[k, i, j - 1] + v[k, i, j + 1])
                    s += MU * (v[k, i - 1, j] + v[k, i + 1, j])
                    s += cross * (u[k, i + 1, j] - u[k, i, j] - u[k, i + 1, j - 1] + u[k, i, j - 1])
                    a[k, i, j] = u[k, i, j] + OMEGA / K * r
                    b[k, i, j] = v[k, i, j] + OMEGA / K * s

    def sweep() -> Any:
        run(u, v, p, q, a, b)
        return a[:, 1:-1, 1:-1], b[:, 1:-1, 1:-1]

    return sweep


def with_jax(u: Any, v: Any, p: Any, q: Any) -> Callable[[], Any]:
    import jax

    jax.config.update("jax_enable_x64", True)

    @jax.jit
    def run(u, v, p, q):  # type: ignore[no-untyped-def]
        r, s = unbalanced(u, v, p, q)
        return u[:, 1:-1, 1:-1] + OMEGA / K * r, v[:, 1:-1, 1:-1] + OMEGA / K * s

    there = [jax.numpy.asarray(field) for field in (u, v, p, q)]

    def sweep() -> Any:
        a, b = run(*there)
        return a.block_until_ready(), b.block_until_ready()

    return sweep


def with_warp(u: Any, v: Any, p: Any, q: Any) -> Callable[[], Any]:
    import warp as wp

    wp.config.quiet = True
    wp.init()
    from array_engines_warp import face_sweep

    there = [wp.array(field, dtype=wp.float64, device="cpu") for field in (u, v, p, q, u, v)]
    numbers = [wp.float64(x) for x in (C11, C12, MU, K, OMEGA)]
    inner = (u.shape[0], u.shape[1] - 2, u.shape[2] - 2)

    def sweep() -> Any:
        wp.launch(face_sweep, dim=inner, inputs=[*there, *numbers], device="cpu")
        return there[4].numpy()[:, 1:-1, 1:-1], there[5].numpy()[:, 1:-1, 1:-1]

    return sweep


def speeds() -> None:
    rng = np.random.default_rng(0)
    shape = ((CELLS // EDGE) ** 2, EDGE + 2, EDGE + 2)
    fields = [rng.standard_normal(shape) for _ in range(4)]
    truth = with_numpy(*fields)()
    ways = {"NumPy": with_numpy, "numba": with_numba, "jax": with_jax, "warp": with_warp}
    print(f"| engine | ns a cell and sweep ({CELLS}², blocks of {EDGE}², float64) |")
    print("|---|---|")
    for name, way in ways.items():
        if name != "NumPy" and find_spec(name) is None:
            print(f"| {name} | not installed |")
            continue
        sweep = way(*fields)
        found = sweep()
        for ours, theirs in zip(truth, found, strict=True):
            np.testing.assert_allclose(np.asarray(theirs), ours, rtol=1e-12, atol=1e-12)
        best = np.inf
        for _ in range(5):
            began = process_time()
            sweep()
            best = min(best, process_time() - began)
        print(f"| {name} | {best / CELLS**2 * 1e9:.1f} |", flush=True)


def one_by_one(u: Any, v: Any, n: int, colours: int) -> None:
    """Relax faces in place: colour by colour, all of a colour at once (0: each after the other)."""
    nothing = np.zeros_like(u)
    if colours == 0:
        for i in range(1, n + 1):
            for j in range(1, n + 1):
                for field, which in ((u, 0), (v, 1)):
                    box = (slice(i - 1, i + 2), slice(j - 1, j + 2))
                    r = unbalanced(u[box], v[box], nothing[box], nothing[box])[which]
                    field[i, j] += r[0, 0] / K
        return
    i, j = np.indices((n, n))
    for field, which in ((u, 0), (v, 1)):
        for colour in range(colours):
            chosen = (i + j) % colours == colour
            r = unbalanced(u, v, nothing, nothing)[which]
            field[1:-1, 1:-1][chosen] += r[chosen] / K


def smoothing() -> None:
    """Print how much of the rough part of an error four sweeps leave, on average a sweep."""
    n, sweeps = 64, 4

    def rough(field: Any) -> float:
        modes = np.fft.fft2(field[1:-1, 1:-1])
        low = np.minimum(np.arange(n), n - np.arange(n)) < n // 4
        modes[np.ix_(low, low)] = 0.0
        return float(np.linalg.norm(modes))

    def left(sweep: Callable[[Any, Any], None]) -> float:
        rng = np.random.default_rng(1)
        u, v = (np.pad(rng.standard_normal((n, n)), 1) for _ in range(2))
        before = np.hypot(rough(u), rough(v))
        for _ in range(sweeps):
            sweep(u, v)
        return float((np.hypot(rough(u), rough(v)) / before) ** (1 / sweeps))

    def jacobi(u: Any, v: Any) -> None:
        r, s = unbalanced(u, v, np.zeros_like(u), np.zeros_like(v))
        u[1:-1, 1:-1] += OMEGA / K * r
        v[1:-1, 1:-1] += OMEGA / K * s

    print("\n| order | rough error left, a sweep | passes over memory |\n|---|---|---|")
    orders = (
        ("one after the other (today)", lambda u, v: one_by_one(u, v, n, 0), 1),
        ("two colours for each kind of face", lambda u, v: one_by_one(u, v, n, 2), 4),
        (f"Jacobi, damped by {OMEGA}", jacobi, 1),
    )
    for name, sweep, passes in orders:
        print(f"| {name} | {left(sweep):.2f} | {passes} |")


if __name__ == "__main__":
    speeds()
    smoothing()
