"""The block sweep as a kernel of Warp, whose decorator reads the file that it stands in."""

import warp as wp

Field = wp.array3d(dtype=wp.float64)


@wp.kernel  # type: ignore[untyped-decorator]
def face_sweep(
    u: Field,
    v: Field,
    p: Field,
    q: Field,
    a: Field,
    b: Field,
    along: wp.float64,
    lateral: wp.float64,
    shear: wp.float64,
    stiffness: wp.float64,
    share: wp.float64,
) -> None:
    """Let the faces below and left of a cell yield by their share of what is unbalanced."""
    k, row, column = wp.tid()
    i, j = row + 1, column + 1
    cross = lateral + shear
    r = p[k, i, j] - stiffness * u[k, i, j]
    r += along * (u[k, i - 1, j] + u[k, i + 1, j]) + shear * (u[k, i, j - 1] + u[k, i, j + 1])
    r += cross * (v[k, i, j + 1] - v[k, i, j] - v[k, i - 1, j + 1] + v[k, i - 1, j])
    s = q[k, i, j] - stiffness * v[k, i, j]
    s += along * (v[k, i, j - 1] + v[k, i, j + 1]) + shear * (v[k, i - 1, j] + v[k, i + 1, j])
    s += cross * (u[k, i + 1, j] - u[k, i, j] - u[k, i + 1, j - 1] + u[k, i, j - 1])
    a[k, i, j] = u[k, i, j] + share / stiffness * r
    b[k, i, j] = v[k, i, j] + share / stiffness * s
