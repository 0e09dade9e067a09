"""Puts the example on the path: it is a program of its own, not a part of the package."""

import sys
from pathlib import Path

DRONE = Path(__file__).parents[3] / "examples" / "mavlink"
if str(DRONE) not in sys.path:
    sys.path.insert(0, str(DRONE))
