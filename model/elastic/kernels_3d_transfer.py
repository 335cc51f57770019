"""The way between a block and its parents, row by row: three dimensions, compiled."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from kaju.model.compiling import part

from .kernels_rows import (
    add_row,
    gather_across,
    gather_normal,
    parents_across,
    parents_normal,
    spread_across,
    spread_normal,
)


@part
def add_tensor(field, buffer, first, second):
    """Add a row to the (up to four) parent rows."""
    p, a, q, b = first
    r, c, s, d = second
    add_row(field[p, r], buffer, a * c)
    if d != 0.0:
        add_row(field[p, s], buffer, a * d)
    if b != 0.0:
        add_row(field[q, r], buffer, b * c)
        if d != 0.0:
            add_row(field[q, s], buffer, b * d)


@part
def restrict_row(axis, row, i, j, coarse, own, far, buffer):
    """Hand a row of loads to the parents."""
    if axis == 2:
        gather_normal(row, buffer)
    else:
        gather_across(row, buffer, own[4], far[4], own[5], far[5])
    nx, ny = coarse[1].shape[0], coarse[0].shape[1]
    if axis == 0:
        first = parents_normal(i)
    else:
        first = parents_across(i, nx, own[0], far[0], own[1], far[1])
    if axis == 1:
        second = parents_normal(j)
    else:
        second = parents_across(j, ny, own[2], far[2], own[3], far[3])
    field = coarse[0] if axis == 0 else coarse[1] if axis == 1 else coarse[2]
    add_tensor(field, buffer[: field.shape[2]], first, second)


@part
def spread_row(axis, parents, row, own, far, weight):
    """Add weight times a row of parents to the children's row."""
    if axis == 2:
        spread_normal(parents, row, weight)
    else:
        spread_across(parents, row, own[4], far[4], own[5], far[5], weight)


@part
def prolong_row(axis, u, coarse, i, j, own, far):
    """Add the parents' displacement to a row of faces."""
    nx, ny = coarse[1].shape[0], coarse[0].shape[1]
    if axis == 0:
        p, a, q, b = parents_normal(i)
    else:
        p, a, q, b = parents_across(i, nx, own[0], far[0], own[1], far[1])
    if axis == 1:
        r, c, s, d = parents_normal(j)
    else:
        r, c, s, d = parents_across(j, ny, own[2], far[2], own[3], far[3])
    field = coarse[0] if axis == 0 else coarse[1] if axis == 1 else coarse[2]
    row = u[0][i, j] if axis == 0 else u[1][i, j] if axis == 1 else u[2][i, j]
    spread_row(axis, field[p, r], row, own, far, a * c)
    if d != 0.0:
        spread_row(axis, field[p, s], row, own, far, a * d)
    if b != 0.0:
        spread_row(axis, field[q, r], row, own, far, b * c)
        if d != 0.0:
            spread_row(axis, field[q, s], row, own, far, b * d)


@part
def prolong_plane(u, coarse, i, own, far):
    """Add the parents' displacement to plane i."""
    nx, ny = u[1].shape[0], u[0].shape[1]
    for axis in range(3):
        if i < nx + (axis == 0):
            for j in range(ny + (axis == 1)):
                prolong_row(axis, u, coarse, i, j, own, far)
