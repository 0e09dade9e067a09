"""Where a recording requested over the network may be written: below one folder, and over no existing file."""

from __future__ import annotations

import itertools
import os
import re
from pathlib import Path

from riot_bus.vocabulary.errors import ConfigError

_LONGEST_NAME = 240  # leaves 15 of the 255 bytes of NAME_MAX for numbers and extensions that are added


def claim(folder: Path, text: str | None, stem: str) -> Path:
    """Create an empty file for a recording.

    Raises:
        ConfigError: The path is refused, or the file exists already.
    """
    if text is not None:
        return _create(safe_path(folder, text))
    for number in itertools.count(1):
        path = folder / (f"{stem}.mcap" if number == 1 else f"{stem}-{number}.mcap")
        if not os.path.lexists(path):
            return _create(path)
    raise AssertionError


def file_stem(name: str) -> str:
    """Return a name from any source as a file name without extension."""
    return re.sub(r"[^\w.-]+|^\.", "_", name)[: _LONGEST_NAME // 4] or "_"


def safe_path(folder: Path, text: str) -> Path:
    """Return a path inside a folder, whatever was requested.

    Args:
        folder: Folder in which files may be.
        text: Path relative to the folder, or absolute and inside it.

    Raises:
        ConfigError: It leads elsewhere, is not an `.mcap` file, or its folder does not exist.
    """
    where = "record"
    if not text.isprintable() or not text or len(text) > _LONGEST_NAME * 4:
        raise ConfigError(f"{text[:80]!r} is not a path", where=where, hint="such as run.mcap")
    root = folder.resolve()
    path = (root / text).resolve()
    if not path.is_relative_to(root):
        raise ConfigError(f"{text!r} is outside of {root}", where=where, hint=f"choose a path below {root}")
    if path.suffix != ".mcap" or len(path.name.encode()) > _LONGEST_NAME:
        raise ConfigError(f"{text!r} is not a name of a log", where=where, hint="names end with .mcap")
    if not path.parent.is_dir():
        raise ConfigError(f"there is no folder {path.parent}", where=where, hint="create it first")
    return path


def _create(path: Path) -> Path:
    """Create a file that did not exist, so that no file of another program is overwritten."""
    try:
        os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_NOFOLLOW, 0o600))
    except FileExistsError:
        raise ConfigError(f"{path} exists already", where="record", hint="choose another name") from None
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}", where="record") from None
    return path
