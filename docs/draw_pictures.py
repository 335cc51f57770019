"""Draw the pictures that README.md and the pages of docs/ show.

python docs/draw_pictures.py
"""

from __future__ import annotations

from pathlib import Path

from kaju import LoadModel, animate, load_scene

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples"


def main() -> None:
    """Write all pictures into docs/pictures."""
    folder = HERE / "pictures"
    folder.mkdir(exist_ok=True)
    plate = LoadModel(load_scene(EXAMPLES / "plate.toml", {"rule.threshold": 1e-3})).run()
    animate(plate, folder / "spawning.gif")


if __name__ == "__main__":
    main()
