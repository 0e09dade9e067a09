"""A folder for the Unix sockets of a router, which no other user may enter.

A router keeps its folder locked. The kernel releases the lock however the process ends, so a folder without lock was
left by a router that was killed, and the next router removes it.
"""

from __future__ import annotations

import fcntl
import os
import random
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_PREFIX = "riot-sockets-"
_OPEN = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
_LOCK = fcntl.LOCK_EX | fcntl.LOCK_NB
_MOST = 16
"""Number of folders that one router checks, chosen at random, so that folders that stay do not hide others."""
_MOST_INSIDE = 64  # the sockets of eight segments, with their locks; later routers remove the rest


@contextmanager
def socket_folder() -> Iterator[Path]:
    """Make a folder, and remove it at the end; first, remove the folders of routers that were killed."""
    _remove_abandoned(Path(tempfile.gettempdir()))
    folder, lock = _make()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def _make() -> tuple[Path, int]:
    """Make a folder and lock it; retry if another router removed it as abandoned before it was locked."""
    while True:
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
        try:
            lock = os.open(folder, _OPEN)
        except FileNotFoundError:
            continue
        try:
            fcntl.flock(lock, _LOCK)
            if os.path.samestat(os.fstat(lock), folder.stat()):
                return folder, lock
        except (BlockingIOError, FileNotFoundError):
            pass
        except OSError:  # a file system without locks: there, no router removes it
            return folder, lock
        os.close(lock)


def _remove_abandoned(parent: Path) -> None:
    with suppress(OSError):
        place = os.open(parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            found = [each for each in os.listdir(place) if each.startswith(_PREFIX)]
            for name in random.SystemRandom().sample(found, min(len(found), _MOST)):
                with suppress(OSError):  # it is in use, or not ours, or another router removes it
                    _remove(name, place)
        finally:
            os.close(place)


def _remove(name: str, place: int) -> None:
    """Remove a folder with its sockets and their lock files; one with anything else in it stays.

    Raises:
        OSError: It is in use, is not a folder, or cannot be removed.
    """
    folder = os.open(name, _OPEN, dir_fd=place)
    try:
        if os.fstat(folder).st_uid != os.getuid():
            return
        fcntl.flock(folder, _LOCK)
        for each in os.listdir(folder)[:_MOST_INSIDE]:
            if each.endswith(".lock") or stat.S_ISSOCK(os.stat(each, dir_fd=folder, follow_symlinks=False).st_mode):
                os.unlink(each, dir_fd=folder)
        os.rmdir(name, dir_fd=place)
    finally:
        os.close(folder)
