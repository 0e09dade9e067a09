"""The mode of files that are first made under a temporary name: as the user's umask gives it to any new file."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

__all__ = ["new_file_mode"]

_STATUS = Path("/proc/self/status")


@cache
def new_file_mode() -> int:
    """Return the mode of a new file; read once, and if possible without changing the umask for a moment."""
    try:
        lines = _STATUS.read_text(encoding="ascii", errors="replace").splitlines()
        mask = next(int(line.split()[1], 8) for line in lines if line.startswith("Umask:"))
    except (OSError, StopIteration):
        mask = os.umask(0o077)  # another thread that makes a file just now makes it too private, not too open
        os.umask(mask)
    return 0o666 & ~mask
