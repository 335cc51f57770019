"""By which share may all agents yield at once? A certificate, stated before a run.

A wave, a damped Jacobi step, changes the loads left by the factor I − ω D⁻¹K, with K the stiffness
matrix and D its diagonal. It calms down if ω < 2/λmax(D⁻¹K). Cell by cell and corner by corner K
and D are sums of small matrices, and the largest eigenvalue of the sum is at most the largest of
the parts: 4 for a corner, 2(1 + (dimension − 1)·C₁₂/C₁₁) for a cell, so never above 4 in the plane
and 6 in space. Below this bound the scene's own eigenvalue is found by Lanczos iteration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from kaju.model.elastic.relaxation.push_table import PushTable

SAFETY = 0.9  # How close to the limit the share is set by itself

MOST_FACES_TO_ITERATE = 200_000  # Above this many faces the bound is taken for the eigenvalue


@dataclass(frozen=True)
class WaveCertificate:
    """By which share waves on a scene calm down."""

    largest_eigenvalue: float  # λmax(D⁻¹K) of the scene's agents; its bound if they are too many
    bound: float  # What no body of these materials exceeds
    limit: float  # Waves calm down for every share below: 2/λmax
    share: float  # ω, the share that is used
    stable: bool  # Whether it lies below the limit
    verdict: str  # The same in words, with a remedy if waves would grow


def certify_waves(table: PushTable, share: float | None = None) -> WaveCertificate:
    """State by which share agents may yield at once; without a share ω, nine tenths of that."""
    problem = table.problem
    used = np.unique(problem.kinds[problem.kinds >= 0])
    ratio = problem.moduli.lateral[used] / problem.moduli.stretch[used]
    # What no body of these materials exceeds.
    bound = max(4.0, 2.0 * float((1.0 + (problem.dimension - 1) * ratio).max()))
    largest = min(bound, largest_eigenvalue(table))
    limit = 2.0 / largest
    chosen = SAFETY * limit if share is None else share
    stable = chosen < limit
    growth = abs(1.0 - chosen * largest)
    reason = f"the largest eigenvalue of D⁻¹K is {largest:.4f} (no such body exceeds {bound:.4g})"
    if stable:
        verdict = (
            f"waves calm down: {reason}, so any share below {limit:.4f} does; ω = {chosen:.4f}"
        )
    else:
        verdict = (
            f"waves would grow by a factor of up to {growth:.3f} each: {reason}; "
            f"set share (ω) below {limit:.4f}, or leave it out"
        )
    return WaveCertificate(largest, bound, limit, chosen, stable, verdict)


def largest_eigenvalue(table: PushTable) -> float:
    """Return λmax(D⁻¹K) of a scene's agents, by Lanczos iteration."""
    finest = table.levels[0]
    n = finest.size
    if n > MOST_FACES_TO_ITERATE:
        return float("inf")
    root = np.sqrt(finest.stiffness)
    # D^(1/2) (D⁻¹K) D^(-1/2) is symmetric and has the same eigenvalues.
    own = sp.eye_array(n) - finest.shares[:, :n]
    matrix = sp.csr_array(sp.diags_array(root) @ own @ sp.diags_array(1.0 / root))
    if n <= 200:
        return float(np.linalg.eigvalsh(matrix.toarray())[-1])
    from scipy.sparse.linalg import eigsh

    # The sharpest pattern is the one sought: it makes a good start, and the same every time.
    start = np.where(finest.place[1].sum(axis=1) % 2, 1.0, -1.0) + 0.01 * np.cos(np.arange(n))
    return float(eigsh(matrix, k=1, which="LA", v0=start, tol=1e-8)[0][0])
