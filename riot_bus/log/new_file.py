"""Files that get their name when they are complete, with the mode that the user's umask gives to any new file."""

from __future__ import annotations

import os
import tempfile
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["new_file", "new_file_mode"]

_STATUS = Path("/proc/self/status")


@contextmanager
def new_file(path: Path, *, source: Path, force: bool) -> Iterator[str]:
    """Yield the name of a temporary file that gets its final name at the end, and is removed if an error occurs.

    Args:
        path: Final path of the file.
        source: File that it is made from, which must not be overwritten.
        force: Whether an existing file is replaced.

    Raises:
        ConfigError: The file exists, or is the source.
        EnvironmentFaultError: The file cannot be created.
    """
    if path.exists() and not force:
        raise ConfigError("the file exists", where=str(path), hint="choose another name, or --force")
    if path.exists() and source.exists() and os.path.samefile(source, path):
        raise ConfigError("this is the input itself", where=str(path), hint="choose another name")
    try:
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise EnvironmentFaultError(f"cannot write: {error.strerror or error}", where=str(path)) from error
    os.close(handle)
    try:
        yield temporary
        os.chmod(temporary, new_file_mode())
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


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
