"""Values of the placeholders in commands, variables and files of components, one set for each trial."""

from __future__ import annotations

import os
import random
import socket
import sys
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING

from riot_bus.processes.ros_domains import free_domains
from riot_bus.system.system_file import FREE_PORT

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from riot_bus.system.system_file import RunPace, SystemFile
    from riot_bus.vocabulary.message import Scalar

_PORTS = range(15_000, 32_000)
"""Ports below those that the kernel assigns, so that none is taken before the component listens there."""


class Placeholders:
    """Values of placeholders, and the ports and ROS domains that are reserved for them until `close`."""

    def __init__(self, file: SystemFile, directory: Path, *, slot: int, parameters: Mapping[str, Scalar]) -> None:
        self._file, self._directory, self._parameters = file, directory, parameters
        self._common = {"{python}": sys.executable, "{trial_dir}": str(directory), "{slot}": str(slot)}
        self._ports: dict[str, int] = {}
        self._domains: dict[str, int] = {}
        self._reserved = ExitStack()
        self.close = self._reserved.close

    def of_component(
        self, name: str, endpoint: str, *, segment: str, seed: int, pace: RunPace | None
    ) -> dict[str, str]:
        """Return the values for a component, and copy its files with these filled in."""
        component = self._file.components[name]
        words = self._common | {
            "{endpoint}": endpoint,
            "{segment}": segment,
            "{seed}": str(seed),
            "{duration}": f"{pace.duration if pace else 0:g}",
            "{speed}": f"{pace.speed if pace else 1:g}",
        }
        words |= {f"{{param:{one}}}": _as_word(value) for one, value in self._parameters.items()}
        for text in self._file.texts_of(component):
            words |= self._ports_in(text)
            words |= {"{domain}": str(self.domain(name))} if "{domain}" in text else {}
        copies = {}
        for number, path in enumerate(component.files):
            copy = self._directory / f"{name}.{number}.{os.path.basename(path)}"
            copy.write_text(fill(self._file.text_of(path), words), encoding="utf-8")
            copies[f"{{file:{path}}}"] = str(copy)
        return words | copies

    def of_command(self, command: tuple[str, ...]) -> dict[str, str]:
        """Return the values for a command that belongs to no component."""
        words = dict(self._common)
        for text in command:
            words |= self._ports_in(text)
        return words

    def _ports_in(self, text: str) -> dict[str, str]:
        return {word: str(self.free_port(word)) for word in FREE_PORT.findall(text)}

    def domain(self, name: str) -> int:
        """Return a ROS domain that is reserved until the trial ends: a component's own one if it has a bridge."""
        owner = name if self._file.components[name].dds else ""
        if owner not in self._domains:
            self._domains[owner] = self._reserved.enter_context(free_domains(1))[0]
        return self._domains[owner]

    def free_port(self, word: str) -> int:
        """Return a port of TCP and UDP that was free, for each placeholder its own, the same in all of the trial."""
        while word not in self._ports:
            port = random.SystemRandom().choice(_PORTS)
            with socket.socket() as tcp, socket.socket(type=socket.SOCK_DGRAM) as udp, suppress(OSError):
                tcp.bind(("", port))
                udp.bind(("", port))
                if port not in self._ports.values():
                    self._ports[word] = port
        return self._ports[word]


def fill(text: str, words: Mapping[str, str]) -> str:
    """Return a text with its placeholders replaced."""
    for word, value in words.items():
        text = text.replace(word, value)
    return text


def _as_word(value: Scalar) -> str:
    """Return a parameter as commands take it: `true` rather than `True`."""
    return str(value).lower() if isinstance(value, bool) else str(value)
