"""The code of a system under test: the files that determine its behaviour, and how long stored outcomes are valid."""

from __future__ import annotations

import functools
import logging
import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from riot_bus.system.system_file import Component, SystemFile

_LOG = logging.getLogger(__name__)
_CODE = (".py", ".so", ".pyd")
_PROGRAM = (b"\x7fELF", b"#!")
_NO_CODE = frozenset({"__pycache__", "site-packages", "node_modules", "trials", "findings"})
_MOST = 5000
"""Files that are looked for without `sources`; a working folder with more is more than a system."""


def source_files(file: SystemFile) -> list[Path]:
    """Return the files of a system's code: those that `sources` names, else those that its components may load.

    These are the programs and files that commands name, and all Python modules, shared libraries, programs and scripts
    below the folder of riot.toml and the working folders of components; environments and caches are left out. Files of
    message definitions and of monitors are always among them.
    """
    if file.system.sources:
        found = [path for pattern in file.system.sources for path in sorted(file.root.glob(pattern))]
    else:
        folders = {(file.root / component.cwd).resolve() for component in file.programs}
        found = [path for folder in _outermost({file.root.resolve(), *folders}) for path in _below(folder)]
        found += [path for component in file.programs for path in _named(component, file.root)]
        if file.system.reset is not None:
            found += _files_of(file.system.reset.command, file.root)
    named = [
        *file.monitor_files,
        *file.system.messages,
        *(name for component in file.programs for name in component.files),
    ]
    return [path for path in dict.fromkeys([*found, *(file.root / name for name in named)]) if path.is_file()]


def _outermost(folders: set[Path]) -> list[Path]:
    return sorted(each for each in folders if not any(other in each.parents for other in folders))


def _below(folder: Path) -> Iterator[Path]:
    count = 0
    for parent, names, files in os.walk(folder):
        names[:] = sorted(each for each in names if not each.startswith(".") and each not in _NO_CODE)
        if "pyvenv.cfg" in files:
            names.clear()
            continue
        for name in sorted(files):
            path = Path(parent) / name
            if name.endswith(_CODE) or ".so." in name or _is_program(path):
                count += 1
                if count > _MOST:
                    _tell_more(folder)
                    return
                yield path


def _is_program(path: Path) -> bool:
    """Return whether a file is executable and not data: on some file systems, all files are executable."""
    with suppress(OSError):
        if os.access(path, os.X_OK) and path.is_file():
            with path.open("rb") as stream:
                return stream.read(4).startswith(_PROGRAM)
    return False


@functools.cache
def _tell_more(folder: Path) -> None:
    hint = "name the system's code in [system] sources"
    _LOG.warning(
        "more than %d files of code are below %s: changes of the others are not noticed; %s", _MOST, folder, hint
    )


def _named(component: Component, root: Path) -> Iterator[Path]:
    box = component.container
    started = component.command if box is None else (box.compose or "",)
    for command in (started, component.setup, component.ready.command, component.stop_command, component.teardown):
        yield from _files_of(command, root / component.cwd)


def _files_of(command: Sequence[str], folder: Path) -> Iterator[Path]:
    for number, word in enumerate(command):
        path = (folder / word).resolve()
        if number == 0 and os.sep not in word:
            path = Path(shutil.which(word) or path)
        if "{" not in word and path.is_file():
            yield path
