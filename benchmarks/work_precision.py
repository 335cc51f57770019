"""Time and memory against error, for kaju and for finite elements; `kaju bench` does the same.

python benchmarks/work_precision.py [--quick] [FOLDER]
"""

from __future__ import annotations

import sys
from pathlib import Path

from kaju.bench.run import run

if __name__ == "__main__":
    folders = [Path(word) for word in sys.argv[1:] if not word.startswith("-")]
    folder = (folders or [Path(__file__).parent / "results"])[0]
    run(folder, quick="--quick" in sys.argv, tell=print)
