"""Runs the two ends of a scenario in separate processes and passes messages between them."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from riot_bus.zenoh.session_config import client_config

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus_conformance.end import EndName, Observation
    from riot_bus_conformance.network import ScenarioNetwork
    from riot_bus_conformance.scenario import Scenario

_OTHER: dict[EndName, EndName] = {"left": "right", "right": "left"}
_LEAVE_S = 5.0  # generous, not measured; an end that hangs is killed, and has told what it saw before
_CHILD = "riot_bus_conformance.child"


class EndFailedError(Exception):
    """An end raised an exception, died or did not finish; the text says which end and how."""


class _Child:
    """The process of one end, in one of its lives."""

    def __init__(
        self,
        scenario: Scenario,
        name: EndName,
        life: int,
        config: Mapping[str, Any],
        words: queue.Queue[tuple[_Child, dict[str, Any] | None]],
    ) -> None:
        self.name, self.life = name, life
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - lives as long as the process
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", _CHILD, scenario.name, name, str(life), json.dumps(config)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
        )
        self._words = words
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def tell(self, signal: str, value: Any = None) -> None:
        """Send a signal; nothing happens if the process is dead."""
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps({"signal": signal, "value": value}) + "\n")
            self._process.stdin.flush()

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._end()

    def leave(self) -> None:
        """Let the process end in good order."""
        self.tell("!leave")
        try:
            self._process.wait(_LEAVE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
        self._end()

    def stderr(self) -> str:
        """Return what the process wrote to stderr."""
        self._errors.seek(0)
        return self._errors.read()

    def _end(self) -> None:
        self._process.wait(_LEAVE_S)
        self._thread.join(_LEAVE_S)
        for pipe in (self._process.stdin, self._process.stdout):
            assert pipe is not None
            with suppress(BrokenPipeError):
                pipe.close()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._words.put((self, json.loads(line)))
        self._words.put((self, None))

    def close(self) -> None:
        """Discard the captured stderr."""
        self._errors.close()


class _Conductor:
    def __init__(self, scenario: Scenario, network: ScenarioNetwork, config: Mapping[str, Any]) -> None:
        self._scenario, self._network, self._config = scenario, network, config
        self._words: queue.Queue[tuple[_Child, dict[str, Any] | None]] = queue.Queue()
        self._started: list[_Child] = []
        self._children: dict[EndName, _Child] = {}
        self._observations: dict[str, Observation] = {}

    def run(self, timeout: float) -> dict[str, Observation]:
        deadline = time.monotonic() + timeout
        try:
            for name in _OTHER:
                self._start(name, 0)
            while len(self._observations) < len(_OTHER):
                try:
                    child, word = self._words.get(timeout=max(0.0, deadline - time.monotonic()))
                except queue.Empty:
                    waited = [name for name in _OTHER if name not in self._observations]
                    raise EndFailedError(f"{' and '.join(waited)} did not end within {timeout:g} s") from None
                if child is self._children.get(child.name):
                    self._hear(child, word)
            for child in self._children.values():
                child.leave()
            return self._observations
        finally:
            for child in self._started:
                child.kill()
                child.close()

    def _start(self, name: EndName, life: int) -> None:
        config = client_config(self._network.endpoint(name), extra={**self._config, **self._scenario.settings})
        child = _Child(self._scenario, name, life, config, self._words)
        self._started.append(child)
        self._children[name] = child

    def _hear(self, child: _Child, word: dict[str, Any] | None) -> None:
        if word is None:
            raise EndFailedError(f"the process of {child.name} died\n{child.stderr()}")
        if "error" in word:
            raise EndFailedError(f"{child.name}: {word['error']}{child.stderr()}")
        if "done" in word:
            self._observations[child.name] = word["done"]
        elif "signal" in word:
            if other := self._children.get(_OTHER[child.name]):
                other.tell(word["signal"], word["value"])
        elif word["ask"] == "restart":
            self._network.restart()
            child.tell("!restart")
        else:
            killed = self._children.pop(_OTHER[child.name])
            killed.kill()
            if word["again"]:
                self._start(killed.name, killed.life + 1)
            else:
                self._observations[killed.name] = "killed"
            child.tell("!kill")


def conduct(
    scenario: Scenario, network: ScenarioNetwork, *, config: Mapping[str, Any], timeout: float
) -> dict[str, Observation]:
    """Run both ends and return what they saw, by end; raise EndFailedError if one fails or the seconds are over."""
    return _Conductor(scenario, network, config).run(timeout)
