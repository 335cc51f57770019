"""Scenes that are their own mirror images: their agents and answers are made so exactly.

Agents and blocks are smoothed one after the other, so an iteration that ends early is not quite
symmetric, and of two agents that leave alike only one might spawn. Where body, supports and
loads are symmetric, a displacement and its image are therefore replaced by their mean.
"""

from __future__ import annotations

import numpy as np

from kaju.arrays import Floats, Ints

from . import block_kernels as kernels
from .blocks import BlockBalance
from .forest import ACROSS, Forest, ways
from .leaves import morton
from .pages import PLACES

ROUNDING = 1e-12
"""Loads that differ by less from their images, of the largest, are alike."""


def mirrors(blocks: BlockBalance) -> tuple[int, ...]:
    """Return the axes along which body, supports and loads of the first blocks are symmetric."""
    forest = blocks.forest
    found, step = [], ways(forest.dimension)
    largest = float(np.abs(blocks.load).max(initial=0.0))
    for axis in range(forest.dimension):
        partner = partners(forest, axis)
        turned = step.copy()
        turned[:, axis] *= -1
        way = (turned + 1) @ 3 ** np.arange(forest.dimension)
        if (partner < 0).any():
            continue
        alike = np.array_equal(forest.kinds[forest.leaves][:, way], forest.kinds[partner])
        off = np.abs(_image(blocks, blocks.load, axis, partner) - blocks.load[forest.leaves])
        off *= blocks.pages.mask[blocks.page[1, forest.leaves]]
        if alike and float(off.max(initial=0.0)) <= ROUNDING * largest:
            found.append(axis)
    return tuple(found)


def partners(forest: Forest, axis: int) -> Ints:
    """Return the images of the leaf blocks along an axis, -1 where there is none."""
    lower, size = forest.lower[forest.leaves], forest.size[forest.leaves] * ACROSS
    image = lower.copy()
    ends = lower[:, axis] + size
    image[:, axis] = lower[:, axis].min() + ends.max() - ends
    code = morton(lower)
    at = np.minimum(np.searchsorted(code, morton(image)), len(code) - 1)
    alike = np.all(lower[at] == image, axis=1) & (size[at] == size)
    return np.where(alike, forest.leaves[at], -1)


def symmetrise(blocks: BlockBalance, u: Floats, axes: tuple[int, ...]) -> None:
    """Replace a displacement by the mean of itself and its images: in place."""
    leaves = blocks.forest.leaves
    for axis in axes:
        partner = partners(blocks.forest, axis)
        if (partner < 0).any():
            continue
        mean = 0.5 * (u[leaves] + _image(blocks, u, axis, partner))
        u[leaves] = mean * blocks.pages.mask[blocks.page[1, leaves]]


def _image(blocks: BlockBalance, u: Floats, axis: int, partner: Ints) -> Floats:
    """Return the leaf blocks' image, shape (leaves, dimension, places)."""
    d = blocks.forest.dimension
    u = u.copy()
    kernels.borrow_all(u, blocks.forest.beside, blocks.layout.layer)
    own = u[partner].reshape(len(partner), d, *(PLACES,) * d)
    image = np.flip(own, axis=axis + 2).copy()
    # A cell's lower face is its image's upper one, and moves the other way.
    normal = np.roll(image[:, axis], 1, axis=axis + 1)
    image[:, axis] = -normal
    return image.reshape(len(partner), d, -1)
