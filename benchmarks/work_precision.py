"""Time and memory against error, for kaju and for finite elements.

python benchmarks/work_precision.py [--quick] [--problem=plate] [FOLDER]

The finite elements are those of scikit-fem; they need the extra fem (pyamg comes with it).
"""

from __future__ import annotations

import sys
from pathlib import Path

from peers.run import run

if __name__ == "__main__":
    folders = [Path(word) for word in sys.argv[1:] if not word.startswith("-")]
    folder = (folders or [Path(__file__).parent / "results"])[0]
    named = [word.removeprefix("--problem=") for word in sys.argv if "--problem=" in word]
    run(folder, "--quick" in sys.argv, tuple(named), print)
