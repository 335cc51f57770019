"""Random plane bodies: pixels, holes and members of three materials, however held and loaded."""

import numpy as np
from scipy.ndimage import label
from spawning_bodies import drawn, laws


def _codes(rng):
    kind = rng.integers(6)
    if kind == 0:  # pixels
        shape = rng.integers(3, 10, 2)
        return (rng.random(shape) < rng.uniform(0.6, 1.0)) * rng.integers(1, 4, shape)
    codes = np.ones(rng.integers(5, 12, 2), dtype=int) * rng.integers(1, 4)
    low = rng.integers(1, 3, 2)
    high = low + rng.integers(1, np.array(codes.shape) - low)
    if kind == 1:  # a hole, or a notch
        codes[low[0] : high[0], low[1] : high[1]] = 0
    elif kind == 2:  # an inclusion
        codes[low[0] : high[0], low[1] : high[1]] = rng.integers(1, 4)
    elif kind == 3:  # a rigid inclusion with a hole beside it
        codes[low[0] : low[0] + 1, low[1] : high[1]] = -1
        codes[-2, -2] = 0
    elif kind == 4:  # a comb
        codes[1::2, 2:] = 0
    else:  # layers
        codes[:, ::2] = rng.integers(1, 4)
    return codes


def plane_body(seed):
    """Return a scene made from a number alone."""
    rng = np.random.default_rng(seed)
    codes = np.asarray(_codes(rng))
    parts, _ = label(codes > 0)
    largest = np.bincount(parts[parts > 0]).argmax()
    codes[(parts != largest) & (codes > 0)] = 0
    filled = np.argwhere(codes > 0)
    low, high = filled.min(axis=0), filled.max(axis=0) + 1
    codes = codes[low[0] : high[0], low[1] : high[1]]
    contrast = 10.0 ** rng.uniform(0, 4, 3)
    ratios = [rng.uniform(0, 0.48) if (codes == k).any() else 0.0 for k in (1, 2, 3)]
    materials = [law | {"density": 2e3} for law in laws(*zip(1e9 * contrast, ratios, strict=True))]
    h = 0.01
    width, height = codes.shape[0] * h, codes.shape[1] * h
    sides = [
        {"bottom": "rigid"},
        {"left": "roller", "bottom": "roller"},
        {"left": "rigid", "right": {"displacement": [1e-6, 0.0]}},
        {"bottom": {"stiffness": 1e11}, "left": "roller"},
        {"bottom": "rigid", "right": "roller"},
    ][rng.integers(5)]
    side = str(rng.choice([s for s in ("top", "right") if s not in sides]))
    loads = [
        [{"side": side, "force": rng.normal(size=2).tolist()}],
        [{"side": side, "pressure": 1e3}],
        [{"cell": filled[rng.integers(len(filled))] - low, "force": rng.normal(size=2)}],
        [{"region": {"box": [[0.3 * width, height], [0.71 * width, height]]}, "force": [0.2, -1]}],
    ][rng.integers(4) if side == "top" else rng.integers(3)]
    for load in loads:
        for key, value in load.items():
            load[key] = value.tolist() if isinstance(value, np.ndarray) else value
    plane, gravity = str(rng.choice(["stress", "strain"])), [0.0, -9.81 * rng.integers(2)]
    of = {"plane": plane, "sides": sides, "gravity": gravity if rng.random() < 0.2 else None}
    codes[codes < 0] = 4
    return drawn(codes, materials, loads, cell_size=h, thickness=0.01, **of)
