"""Opens the place where logs are: a folder, a log, or the URL of an object store."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.fleet.stores import FolderStore, is_remote
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from riot_bus.fleet.stores import Store

__all__ = ["copied", "open_store"]


def open_store(root: str) -> Store:
    """Open a folder, a log, or the URL of an object store.

    Raises:
        ConfigError: The place does not exist, or a package needed to open it is missing.
    """
    if is_remote(root):
        from riot_bus.fleet.objects import ObjectStore

        return ObjectStore(root)
    return FolderStore(Path(root.removeprefix("file://")).expanduser())


@contextmanager
def copied(place: str) -> Iterator[Path]:
    """Yield a local file with all of a log, wherever the log is; a copy on disk is deleted afterwards.

    Raises:
        ConfigError: The log cannot be read.
    """
    store = open_store(place)
    problems: list[str] = []
    log = next(store.logs(problems.append), None)
    if log is None:
        raise ConfigError(problems[0] if problems else "there is no such log", where=place)
    with store.whole(log) as path:
        yield path
