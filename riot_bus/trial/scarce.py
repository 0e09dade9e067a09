"""Limited resources, such as simulators: trials that need one wait until it is free.

Each piece is a file that its holder locks. So all processes of riot that test a system share the resources, and those
of a process are free as soon as it ends, for whatever reason.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import tempfile
import time
from collections import Counter
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING

from riot_bus.given_files import private_folder

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from riot_bus.system.system_file import SystemFile


def needed(file: SystemFile, names: Iterable[str]) -> Mapping[str, int]:
    """Return how many of which resource components need that run together; an address to attach to is one, too."""
    components = [file.components[name] for name in names]
    addresses = Counter({each.attach.replace("/", "-"): 1 for each in components if each.attach is not None})
    return sum((Counter(each.resources) for each in components), addresses)


@contextmanager
def held(file: SystemFile, names: Iterable[str]) -> Iterator[None]:
    """Wait until the resources that components need are free, and hold them.

    Resources are taken in the order of their names, and only one trial at a time takes pieces of a resource, so that no
    two trials wait for each other.
    """
    needs = needed(file, names)
    if not needs:
        yield
        return
    system = hashlib.sha256(os.fsencode(file.path)).hexdigest()[:16]
    folder = private_folder(private_folder(Path(tempfile.gettempdir()) / f"riot-resources-{os.getuid()}") / system)
    with ExitStack() as stack:
        for name, count in sorted(needs.items()):
            pieces = [folder / f"{name}.{number}" for number in range(file.resources.get(name, 1))]
            with (folder / f"{name}.queue").open("ab") as queue:
                fcntl.flock(queue, fcntl.LOCK_EX)
                while count:
                    for piece in list(pieces):
                        if count and (taken := _taken(piece)):
                            stack.enter_context(taken)
                            pieces.remove(piece)
                            count -= 1
                    if count:
                        time.sleep(0.05)  # how long a free piece may stay unused; a look locks a few files
        yield


def _taken(piece: Path) -> IO[bytes] | None:
    """Return a file locked, which lasts until it is closed; None if another one has it."""
    stream = piece.open("ab")
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        stream.close()
        return None
    return stream
