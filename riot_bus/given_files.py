"""Files and folders that others may have made: only what lies where it seems to, is a file, and has a bounded size."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from pathlib import Path

from riot_bus.vocabulary.errors import ConfigError

MOST_TOML = 1 << 20
"""Most bytes of a TOML file: the largest of our own has 23 kB, and Python parses 1 MiB in 5 s at the worst."""
MOST_TEXT = 64 << 20
"""Most bytes of a text file that is read whole: 250,000 rows of a permeability.json, at 266 bytes each."""


def leads_out(path: Path, inside: Path) -> bool:
    """Return whether a path, with all links followed, is outside of a folder; that folder itself may be a link."""
    return not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(inside))


def given_file(path: Path, *, inside: Path | None = None) -> Path:
    """Return the path of a file unchanged if it may be opened.

    Args:
        inside: Folder of which no link may lead out.

    Raises:
        FileNotFoundError: It does not exist.
        OSError: It cannot be looked at.
        ConfigError: It is no regular file, such as a pipe or a device, or a link leads out of the folder.
    """
    if inside is not None and leads_out(path, inside):
        hint = "remove it, or copy the file there if you want it to be read"
        raise ConfigError(f"this link leads out of the folder {inside.name or '.'!r}", where=str(path), hint=hint)
    if not stat.S_ISREG(path.stat().st_mode):
        raise ConfigError("this is no regular file", where=str(path), hint="pipes, devices and folders are not read")
    return path


def given_folder(path: Path) -> Path:
    """Return the path of a folder unchanged if it holds files and folders alone, and no link leads out of it.

    What is in its folders is not looked at: programs may have left anything there.

    Raises:
        ConfigError: It holds something else, such as a pipe.
    """
    for each in path.iterdir() if path.is_dir() else ():
        with suppress(FileNotFoundError):  # it is gone meanwhile, or a link to nothing that is inside
            if leads_out(each, path) or not each.is_dir():
                given_file(each, inside=path)
    return path


def given_bytes(path: Path, *, inside: Path | None = None, most: int = MOST_TEXT) -> bytes:
    """Return the content of a file; raises as `given_file`, and ConfigError if it is larger than `most` bytes."""
    with given_file(path, inside=inside).open("rb") as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise ConfigError(
            f"this file has more than {most} bytes", where=str(path), hint="riot reads no larger file of this kind"
        )
    return content


def given_text(path: Path, *, inside: Path | None = None, most: int = MOST_TEXT) -> str:
    """Return the content of a file as text, raising as `given_bytes`, and UnicodeDecodeError if it is not UTF-8."""
    return given_bytes(path, inside=inside, most=most).decode()


def private_folder(path: Path) -> Path:
    """Return the path of a folder that only this user can enter or change; it is made if there is none.

    Raises:
        ConfigError: Others may write there, it is a link, or it cannot be made.
    """
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = path.lstat()
    except OSError as error:
        raise ConfigError(f"cannot be made: {error.strerror}", where=str(path)) from error
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise ConfigError(
            "others may write there",
            where=str(path),
            hint="remove it, or set XDG_RUNTIME_DIR and TMPDIR to folders of yours",
        )
    return path
