"""Files that get their name when they are complete, with the mode that the user's umask gives to any new file."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError

_STATUS = Path("/proc/self/status")


@contextmanager
def whole_file(path: Path, *, mode: int | None = None, sync: bool = True) -> Iterator[Path]:
    """Yield the path of a temporary file that gets its final name at the end, and is removed if an error occurs.

    A reader never sees half of it, and the file that had the name before is there until then. Raises OSError.

    Args:
        mode: Mode of the file; None for that of any new file. Until it is complete, only this user can read it.
        sync: Whether to wait until it is on the disk, so that this holds even in case of a power failure.
    """
    handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        if sync:
            with temporary.open("rb") as written:
                os.fsync(written.fileno())
        temporary.chmod(new_file_mode() if mode is None else mode)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_whole(path: Path, content: str | bytes, *, mode: int | None = None, sync: bool = True) -> None:
    """Write a file in one step, as by `whole_file`; text as UTF-8."""
    with whole_file(path, mode=mode, sync=sync) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def new_file(path: Path, *, source: Path, force: bool) -> Iterator[Path]:
    """Yield the path of a temporary file, as `whole_file` does, for the output of a command.

    Args:
        source: File that it is made from, which must not be overwritten.

    Raises:
        ConfigError: The file exists, or is the source.
        EnvironmentFaultError: The file cannot be created.
    """
    if path.exists() and not force:
        raise ConfigError("the file exists", where=str(path), hint="choose another name, or --force")
    if path.exists() and source.exists() and os.path.samefile(source, path):
        raise ConfigError("this is the input itself", where=str(path), hint="choose another name")
    with ExitStack() as stack:
        try:
            temporary = stack.enter_context(whole_file(path))
        except OSError as error:
            raise EnvironmentFaultError(f"cannot write: {error.strerror or error}", where=str(path)) from error
        yield temporary


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
