"""Triangles: quadratics, and Clough and Tocher's stress functions.

The unknowns are those of the squares of `elements`: the displacement at vertices and how far it
bulges in the middle of an edge; φ, its slopes at vertices, and the bulge of its normal slope.
"""

from __future__ import annotations

import numpy as np

from kaju.arrays import Floats


def slopes(at: Floats) -> tuple[Floats, Floats]:
    """Return the slopes of the three linear functions on triangles, (n, 3, 2), and areas."""
    a, b, c = at[:, 0], at[:, 1], at[:, 2]
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    across = np.stack([c - b, a - c, b - a], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.stack([-across[..., 1], across[..., 0]], axis=2) / twice[:, None, None]
    return np.asarray(slope), np.asarray(0.5 * twice)


def middles(rows: Floats, axis: int) -> Floats:
    """Return what is linear on triangles in the middles of their edges, by that at corners."""
    return np.asarray(0.5 * (rows + np.roll(rows, -1, axis)))


def quadratic_strain(at: Floats) -> tuple[Floats, Floats]:
    """Return the strain (xx, yy, 2 xy) at the corners of triangles, (n, 3, 3, 12), and areas.

    The unknowns are both components at the three corners, then on the three edges.
    """
    slope, area = slopes(at)
    gradient = np.zeros((len(at), 3, 6, 2))
    gradient[:, :, :3] = slope[:, None]
    for k in range(3):
        a, b = k, (k + 1) % 3
        gradient[:, a, 3 + k] = 4.0 * slope[:, b]
        gradient[:, b, 3 + k] = 4.0 * slope[:, a]
    out = np.zeros((len(at), 3, 3, 12))
    out[..., 0, 0::2] = out[..., 2, 1::2] = gradient[..., 0]
    out[..., 1, 1::2] = out[..., 2, 0::2] = gradient[..., 1]
    return out, area


def stress_rows(at: Floats, normal: Floats) -> tuple[Floats, Floats, Floats]:
    """Return stresses (xx, yy, xy) of Clough and Tocher's triangles, by thirds.

    At the corners of each third, (n, 3, 3, 3, 12), these corners (n, 3, 3, 2), and the areas of
    thirds (n,). The unknowns are φ and its slopes at the corners, then the bulges on the edges
    along `normal`, (n, 3, 2).

    φ is cubic on each third, given by its values at Bézier points: those beside the corners follow
    from slopes, those within a third from the slope in the middle of its edge, the inner ones
    are means, for that makes slopes go on (R. W. Clough, J. L. Tocher, 1965).
    """
    n, middle = len(at), at.mean(axis=1)

    def beside(corner: int, towards: Floats) -> Floats:
        out = np.zeros((n, 12))
        out[:, 3 * corner] = 1.0
        out[:, 3 * corner + 1 : 3 * corner + 3] = (towards - at[:, corner]) / 3.0
        return out

    own = [beside(k, at[:, k]) for k in range(3)]
    inward = [beside(k, middle) for k in range(3)]
    there = [beside(k, at[:, (k + 1) % 3]) for k in range(3)]
    back = [beside((k + 1) % 3, at[:, k]) for k in range(3)]
    corners = np.stack(
        [np.stack([at[:, k], at[:, (k + 1) % 3], middle], axis=1) for k in range(3)], axis=1
    )
    slope, area = slopes(corners.reshape(-1, 3, 2))
    slope = slope.reshape(n, 3, 3, 2)
    within = []
    for k in range(3):
        b = (k + 1) % 3
        p, q, r = np.einsum("ncd,nd->cn", slope[:, k], normal[:, k])[:, :, None]
        asked = np.zeros((n, 12))
        for corner in (k, b):
            asked[:, 3 * corner + 1 : 3 * corner + 3] = 0.5 * normal[:, k]
        asked[:, 9 + k] = 1.0
        known = 0.25 * (p * own[k] + q * there[k] + r * inward[k])
        known += 0.5 * (p * there[k] + q * back[k])
        known += 0.25 * (p * back[k] + q * own[b] + r * inward[b])
        within.append((asked / 3.0 - known) / (0.5 * r))
    inner = [(inward[k] + within[k] + within[k - 1]) / 3.0 for k in range(3)]
    core = sum(inner) / 3.0
    rows = np.zeros((n, 3, 3, 3, 12))
    for k in range(3):
        b = (k + 1) % 3
        # Bézier points round each corner of the third, as a symmetric table of barycentric steps
        tables = (
            (own[k], there[k], inward[k], back[k], within[k], inner[k]),
            (there[k], back[k], within[k], own[b], inward[b], inner[b]),
            (inward[k], within[k], inner[k], inward[b], inner[b], core),
        )
        for c, (aa, ab, ac, bb, bc, cc) in enumerate(tables):
            table = np.stack([aa, ab, ac, ab, bb, bc, ac, bc, cc], axis=1).reshape(n, 3, 3, 12)
            bent = 6.0 * np.einsum("nia,nijm,njb->nabm", slope[:, k], table, slope[:, k])
            rows[:, k, c] = np.stack([bent[:, 1, 1], bent[:, 0, 0], -bent[:, 0, 1]], axis=1)
    return rows, corners, area.reshape(n, 3)[:, 0]
