"""The context that all trials of one system share: its file, its types and its monitors."""

from __future__ import annotations

import functools
import hashlib
import json
import logging
import os
import shutil
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.monitors.liveness import LIVENESS
from riot_bus.processes.containers import image_id
from riot_bus.system.system_file import PARAMETER, SystemFile, load_system
from riot_bus.trial.hangs import Hangs
from riot_bus.types.registry import TypeRegistry, chosen_adapters, load_adapters
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from riot_bus.monitors.model import Invariant, Monitor
    from riot_bus.processes.activity import Idle
    from riot_bus.system.system_file import Component

_JUDGED = b"5"
"""Version of the judgement; change it when the same trial may get another verdict or signature than before."""


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


@dataclass(frozen=True, slots=True)
class Context:
    """A system that is ready to be tested.

    Attributes:
        idle: Activity of components that are ready, measured in trials of this process, by how they were started.
    """

    file: SystemFile
    registry: TypeRegistry
    monitors: tuple[Monitor, ...]
    hangs: Mapping[str, Hangs] = field(default_factory=lambda: defaultdict(Hangs), compare=False)
    idle: Mapping[str, list[Idle]] = field(default_factory=lambda: defaultdict(list), compare=False)

    @property
    def watched(self) -> list[str]:
        """Topics that the invariants of riot.toml observe."""
        return sorted({topic for monitor in self.file.invariants for topic in monitor.topics})

    def alone(self, unit: str) -> Context:
        """Return the context for testing a unit alone, for which the unit may have a separate command."""
        file = self.file.alone(unit)
        return self if file is self.file else replace(self, file=file)

    def monitors_of(self, name: str) -> tuple[Monitor, ...]:
        """Return the monitors that can judge a component alone: all except those of topics that only others publish."""
        own = self.file.components[name].outputs

        def is_elsewhere(monitor: Monitor) -> bool:
            topics = getattr(monitor, "topics", ())
            return bool(topics) and all(
                self.others_publish(topic, name) and not self._matches(topic, own) for topic in topics
            )

        return tuple(monitor for monitor in self.monitors if not is_elsewhere(monitor))

    def others_publish(self, topic: str, name: str) -> bool:
        """Return whether a topic is a declared output of other components than this one."""
        parts = self.file.components.items()
        return self._matches(topic, {each for other, part in parts if other != name for each in part.outputs})

    def _matches(self, topic: str, known: Iterable[str]) -> bool:
        key_of = self.registry.key_expression
        return any(
            topic == each or self.registry.matches(topic, key_of(each)) or self.registry.matches(each, key_of(topic))
            for each in known
        )

    @property
    def profile(self) -> str:
        """MCAP profile of this system's logs."""
        topics = [topic for part in self.file.components.values() for topic in (*part.inputs, *part.outputs)]
        return "ros2" if any(topic.startswith("/") for topic in topics) else ""

    def topics(self, *names: str) -> list[str]:
        """Return the Zenoh key expressions that topic names stand for."""
        return [self.registry.key_expression(name) for name in names]

    def fingerprint(self) -> str:
        """Return a hash of system file, code and judgement; stored outcomes are valid as long as it is the same."""
        return hashlib.sha256(json.dumps(self.parts()).encode()).hexdigest()[:16]

    def parts(self) -> dict[str, str]:
        """Return the hashes behind the fingerprint: of `riot.toml`, of each code file by its path, and of images."""
        judged = self.file.model_dump_json(exclude={"path"}).encode() + _JUDGED
        found, root = {"riot.toml": hashlib.sha256(judged).hexdigest()}, self.file.root.resolve()
        for path in source_files(self.file):
            inside = path.resolve().is_relative_to(root)
            with path.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").hexdigest()
            found[os.path.relpath(path.resolve(), root) if inside else str(path)] = digest
        boxes = {box.image: box for program in self.file.programs if (box := program.container) is not None}
        found |= {f"image {name}": image_id(box) for name, box in boxes.items() if "{" not in name}
        return found


def open_system(path: Path) -> Context:
    """Read a system file and load the monitors, adapters and message types that it names.

    Raises:
        ConfigError: Something in the file is not usable; the error has place and suggestion.
    """
    file = load_system(path)
    for program in file.programs:
        for parameter in (each for text in file.texts_of(program) for each in PARAMETER.findall(text)):
            if why := file.external.why_not_in_commands(parameter):  # only in files: riot.toml was checked when read
                where = f"{file.path}: {', '.join(program.files)}"
                raise ConfigError(why[0], where=where, hint=why[1])
    registry = types_of(file)
    for name, parameter in file.external.in_nodes.items():
        if registry.parameter_adapter(str(parameter.node)) is None:
            hint = "a node of ROS 2 is written like /planner, a component of MAVLink like 1/1 (system/component)"
            where = f"{file.path}: external.parameters.{name}"
            raise ConfigError(f"no adapter knows parameters of {parameter.node!r}", where=where, hint=hint)
    return Context(file, registry, (*(monitor() for monitor in LIVENESS), *file.invariants))


def types_of(file: SystemFile) -> TypeRegistry:
    """Return the registry of the types that a system file declares: installed adapters and codecs alone are loaded.

    Raises:
        ConfigError: An adapter or type is unknown, or a file of definitions cannot be used.
    """
    files = []
    for name in file.system.messages:
        source = (file.root / name).resolve()
        if not source.is_file():
            raise ConfigError(f"no such file: {name!r}", where=f"{file.path}: [system] messages")
        files.append(source)
    adapters = load_adapters(chosen_adapters(file.system.adapters))
    return TypeRegistry(adapters, declared=file.system.types, definitions=files)


def invariants_of(path: Path) -> list[Invariant]:
    """Return the `[[monitors]]` of a system file, for monitoring without a trial; raises as `load_system` does."""
    if not path.exists():
        hint = "write [[monitors]] into a file such as examples/rover/riot.toml"
        raise ConfigError("there is no such system file", where=str(path), hint=hint)
    return list(load_system(path).invariants)
