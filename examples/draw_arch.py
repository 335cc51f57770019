"""Draw arch.png: a half ring of stone on two pieces of ground, one pixel a cell."""

from pathlib import Path

import numpy as np
from PIL import Image

COLUMNS, ROWS = 65, 36
OUTER, INNER = 28.5, 20.5  # cells
AIR, STONE, GROUND = (255, 255, 255), (140, 123, 107), (0, 0, 0)


def draw() -> Image.Image:
    """Return the picture; its top row is the top of the body."""
    row, column = np.indices((ROWS, COLUMNS))
    height = ROWS - 1 - row
    radius = np.hypot(column - COLUMNS // 2, height - 3)
    pixels = np.full((ROWS, COLUMNS, 3), AIR, dtype=np.uint8)
    pixels[(radius < OUTER) & (radius > INNER) & (height >= 3)] = STONE
    beside = np.abs(column - COLUMNS // 2)
    pixels[(height < 3) & (beside > INNER - 1) & (beside < OUTER + 1)] = GROUND
    return Image.fromarray(pixels)


if __name__ == "__main__":
    draw().save(Path(__file__).with_name("arch.png"))
