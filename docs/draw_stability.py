"""Draw the map of stable coefficients (a minute).

Run from the repository's root: ``python docs/draw_stability.py``.
"""

from pathlib import Path

from kaju.model.trials.coefficients import stability_map
from kaju.view.trials import plot_stability

RULES = [(1.0, 0.3), (0.5, 0.3), (0.5, 0.45), (0.0, 0.49)]


def main() -> None:
    """Draw the map, and say how often a run contradicts its certificate."""
    maps = [stability_map(beta, ratio) for beta, ratio in RULES]
    print(plot_stability(maps, Path(__file__).parent / "pictures" / "stability_map.png"))
    runs = sum(one.radius.size for one in maps)
    print(f"{runs} rules, {sum(m.contradicted for m in maps)} of them not as certified")


if __name__ == "__main__":
    main()
