"""Work on one row of faces, shared by the sweeps in two and three dimensions."""
# ruff: noqa: D103
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from kaju.model.compiling import part


@part
def relax_row(row, pull, couple, low, own, high, back):
    """Let the faces of a row yield until they balance: every second one, then the others.

    `pull` is what they feel from elsewhere, `couple` the stiffness between neighbours in the
    row, `low`, `own` and `high` a face's own stiffness at the row's ends (0 if held) and inside.
    """
    ease = 1.0 / own
    last = len(row) - 1
    for phase in range(2):
        colour = 1 - phase if back else phase
        for j in range(2 - colour, last, 2):
            row[j] = ease * (pull[j] + couple * (row[j - 1] + row[j + 1]))
        if colour == 0 and low > 0.0:
            row[0] = (pull[0] + couple * row[1]) / low
        if last % 2 == colour and high > 0.0:
            row[last] = (pull[last] + couple * row[last - 1]) / high


@part
def finish_row(row, out, couple, low, own, high):
    """Turn what a row feels from elsewhere into what is left unbalanced on it."""
    last = len(row) - 1
    for j in range(1, last):
        out[j] += couple * (row[j - 1] + row[j + 1]) - own * row[j]
    out[0] += couple * row[1] - low * row[0]
    out[last] += couple * row[last - 1] - high * row[last]
    if low == 0.0:
        out[0] = 0.0
    if high == 0.0:
        out[last] = 0.0


@part
def gather_across(row, out, own_low, far_low, own_high, far_high):
    """Restrict a row across the normal: the transpose of (3/4, 1/4)."""
    count = len(row) // 2
    for j in range(count):
        out[j] = 0.75 * (row[2 * j] + row[2 * j + 1])
    for j in range(1, count):
        out[j] += 0.25 * row[2 * j - 1]
    for j in range(count - 1):
        out[j] += 0.25 * row[2 * j + 2]
    last = len(row) - 1
    out[0] += (own_low - 0.75) * row[0]
    out[1] += far_low * row[0]
    out[count - 1] += (own_high - 0.75) * row[last]
    out[count - 2] += far_high * row[last]


@part
def gather_normal(row, out):
    """Restrict a row along the normal: the transpose of (1; 1/2, 1/2)."""
    count = len(row) // 2
    out[0] = row[0] + 0.5 * row[1]
    for j in range(1, count):
        out[j] = row[2 * j] + 0.5 * (row[2 * j - 1] + row[2 * j + 1])
    out[count] = row[2 * count] + 0.5 * row[2 * count - 1]


@part
def spread_across(parents, row, own_low, far_low, own_high, far_high, weight):
    """Add weight times a row of parents, interpolated across the normal."""
    near, away = 0.75 * weight, 0.25 * weight
    last = len(parents) - 1
    for j in range(1, last):
        row[2 * j] += near * parents[j] + away * parents[j - 1]
        row[2 * j + 1] += near * parents[j] + away * parents[j + 1]
    row[0] += weight * (own_low * parents[0] + far_low * parents[1])
    row[1] += near * parents[0] + away * parents[1]
    row[2 * last] += near * parents[last] + away * parents[last - 1]
    row[2 * last + 1] += weight * (own_high * parents[last] + far_high * parents[last - 1])


@part
def spread_normal(parents, row, weight):
    """Add weight times a row of parents, interpolated along the normal."""
    last = len(parents) - 1
    for j in range(last):
        row[2 * j] += weight * parents[j]
        row[2 * j + 1] += 0.5 * weight * (parents[j] + parents[j + 1])
    row[2 * last] += weight * parents[last]


@part
def add_row(out, row, weight):
    for j in range(len(out)):
        out[j] += weight * row[j]


@part
def parents_normal(i):
    """Return the two parents of face i along its normal, and their weights."""
    if i % 2 == 0:
        return i // 2, 1.0, i // 2, 0.0
    return i // 2, 0.5, i // 2 + 1, 0.5


@part
def parents_across(i, count, own_low, far_low, own_high, far_high):
    """Return the two parents of face i across its normal, and their weights."""
    if i == 0:
        return 0, own_low, 1, far_low
    if i == 2 * count - 1:
        return count - 1, own_high, count - 2, far_high
    return i // 2, 0.75, i // 2 - 1 + 2 * (i % 2), 0.25
