"""Facts about its run that every recording contains."""

from __future__ import annotations

import platform
import time
from importlib.metadata import version

from riot_bus import __version__


def run_facts() -> dict[str, str]:
    """Return versions, host and time, for the metadata of a log."""
    return {
        "riot_bus": __version__,
        "zenoh": version("eclipse-zenoh"),
        "mcap": version("mcap"),
        "python": platform.python_version(),
        "host": platform.node(),
        "system": platform.platform(),
        "began": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
