"""Time and memory against error, for kaju and for finite elements.

python benchmarks/work_precision.py [--quick] [--resume] [--problem=plate] [--publish] [FOLDER]

--quick takes about a minute. --resume keeps the rows that the folder has and measures the others.
--publish makes it the record in docs (table, page, picture) that README and docs/comparison.md
quote; a test compares them.

The finite elements are those of scikit-fem; they need the extra fem (pyamg comes with it).
"""

from __future__ import annotations

import sys
from pathlib import Path

from peers.report import publish
from peers.run import run

if __name__ == "__main__":
    folders = [Path(word) for word in sys.argv[1:] if not word.startswith("-")]
    folder = (folders or [Path(__file__).parent / "results"])[0]
    named = [word.removeprefix("--problem=") for word in sys.argv if "--problem=" in word]
    run(folder, "--quick" in sys.argv, tuple(named), print, resume="--resume" in sys.argv)
    if "--publish" in sys.argv:
        publish(folder, Path(__file__).parents[1])
