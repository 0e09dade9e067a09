"""Stores of logs: folders of this machine, and how a place is opened; object stores are in `objects`."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Protocol

from riot_bus.given_files import given_file
from riot_bus.vocabulary.errors import ConfigError
from riot_bus_fleet.logs.entry import ENDING, StoredLog


class Store(Protocol):
    """A place that holds logs.

    Attributes:
        partial: Whether an excerpt may lack what its summary does not need.
        refused: Lines about what is named like a log, but is none of this place: pipes, and links that lead out of it.
    """

    root: str
    partial: bool
    refused: list[str]

    def logs(self, failed: Callable[[str], None]) -> Iterator[StoredLog]:
        """Yield all logs; call `failed` with a line about what could not be looked at."""

    def excerpt(self, log: StoredLog) -> AbstractContextManager[Path]:
        """Return a local file with at least the summary of a log, and of the same size."""

    def whole(self, log: StoredLog) -> AbstractContextManager[Path]:
        """Return a local file with all of a log."""


class FolderStore:
    """A folder of this machine, without links that lead out, or a log; raises ConfigError if it is none of these."""

    partial = False

    def __init__(self, root: Path) -> None:
        if not root.exists():
            raise ConfigError("there is no such folder or log", where=str(root))
        self.refused: list[str] = []
        self.root = str(root.resolve() if root.is_dir() else given_file(root).resolve())

    def logs(self, failed: Callable[[str], None]) -> Iterator[StoredLog]:
        """Yield all logs, folder by folder; call `failed` with a line about what could not be looked at."""
        root = Path(self.root)
        if root.is_file():
            details = root.stat()
            yield StoredLog(self.root, details.st_size, str(details.st_mtime_ns), root.parent.name)
            return
        pending = [(self.root, "")]
        while pending:
            path, below = pending.pop()
            try:
                with os.scandir(path) as entries:
                    for entry in entries:
                        try:
                            if entry.is_dir(follow_symlinks=False):
                                pending.append((entry.path, below or entry.name))
                            elif entry.name.endswith(ENDING) and not entry.is_dir():
                                given_file(Path(entry.path), inside=root if entry.is_symlink() else None)
                                entry.path.encode()
                                details = entry.stat()
                                stamp = str(details.st_mtime_ns)
                                yield StoredLog(entry.path, details.st_size, stamp, below or root.name)
                        except UnicodeEncodeError:
                            failed(f"{os.fsencode(entry.path)!r}: the name is not UTF-8")
                        except ConfigError as error:
                            self.refused.append(f"{entry.path}: {error.message}")
                        except OSError as error:
                            failed(f"{entry.path}: {error.strerror}")
            except OSError as error:
                failed(f"{path}: {error.strerror}")

    @contextmanager
    def excerpt(self, log: StoredLog) -> Iterator[Path]:
        """Yield the log itself."""
        yield Path(log.place)

    whole = excerpt


def open_store(root: str) -> Store:
    """Open a folder, a log, or the URL of an object store; raises ConfigError if it cannot."""
    if "://" in root and not root.startswith("file://"):
        from riot_bus_fleet.logs.objects import ObjectStore

        return ObjectStore(root)
    return FolderStore(Path(root.removeprefix("file://")).expanduser())


@contextmanager
def copied(place: str) -> Iterator[Path]:
    """Yield a local file with all of a log, perhaps a copy that is deleted afterwards; raises ConfigError."""
    store = open_store(place)
    problems: list[str] = []
    log = next(store.logs(problems.append), None)
    if log is None:
        raise ConfigError(problems[0] if problems else "there is no such log", where=place)
    with store.whole(log) as path:
        yield path
