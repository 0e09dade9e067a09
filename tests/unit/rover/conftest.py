"""Puts the example on the path: it is a program of its own, not a part of the package."""

import os
import sys
from pathlib import Path

os.environ.setdefault("ZENOH_RUNTIME", "(rx: (worker_threads: 16), tx: (worker_threads: 4))")
ROVER = Path(__file__).parents[3] / "examples" / "rover"
if str(ROVER) not in sys.path:
    sys.path.insert(0, str(ROVER))
