"""Recordings of a running router: begun, ended and split while messages pass, in one folder, over no existing file."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

from riot_bus.control.graph_notes import GraphNotes
from riot_bus.control.log_paths import claim
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.vocabulary.selector import key_matches
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.publisher_tokens import Announcements

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from riot_bus.interceptors.recorder import Recorder
    from riot_bus.log.writer import LogWriter
    from riot_bus.router.bus import Bus
    from riot_bus.types.registry import TypeRegistry


class Recordings:
    """The present recording of a bus; thread-safe, except that there must be only one `start` or `settle` at a time.

    Attributes:
        path: Path of the present file; None if there is none.
    """

    def __init__(
        self,
        bus: Callable[[], Bus],
        *,
        registry: TypeRegistry,
        folder: Path,
        name: str,
        metadata: Callable[[], Mapping[str, str]],
        profile: str | None,
    ) -> None:
        self.folder = folder
        self.path: Path | None = None
        self.graph_notes = GraphNotes(self._write_note)
        self._bus = bus
        self._registry = registry
        self._name = name
        self._metadata = metadata
        self._profile = profile
        self._announcements = Announcements(registry, wanted=self._wanted, learnt=self._learnt)
        self._lock = threading.RLock()  # never held while a change of the bus is waited for
        self._recorder: Recorder | None = None
        self._stem = name
        self._since = 0.0

    def begin(self, path: Path) -> Recorder:
        """Open a file, replacing an existing one; the caller hands the recorder to the bus."""
        from riot_bus.interceptors.recorder import Recorder

        recorder = Recorder(self._writer(path), topic=self._registry.topic)
        with self.graph_notes.new_log():
            self._recorder, self._stem = recorder, path.stem
            self.path, self._since = path, time.monotonic()
        return recorder

    def start(self, text: str | None = None) -> Path:
        """Begin a recording; return once natively routed messages are observed as well.

        Args:
            text: Path as requested, relative to the folder; None for one with the present time.

        Raises:
            ConfigError: There is a recording already, or the path is refused.
            EnvironmentFaultError: It was stopped meanwhile.
        """
        recorder, path = self._claimed(text)
        self.settle()
        self._await_observation()
        if self._recorder is not recorder:
            self.settle()
            raise EnvironmentFaultError(f"record/stop ended {path.name} before it had begun", where="record/start")
        return path

    def _claimed(self, text: str | None) -> tuple[Recorder, Path]:
        with self._lock:
            if self._recorder is not None:
                hint = "split it (riot ctl record split), or stop it first (riot ctl record stop)"
                raise ConfigError(f"this router is recording already, to {self.path}", where="record/start", hint=hint)
            path = claim(self.folder, text, f"{self._name}-{time.strftime('%Y%m%d-%H%M%S')}")
            return self.begin(path), path

    def settle(self) -> None:
        """Let the bus use the present recorder, or none; waits until the bus can be changed."""
        self._bus().set_recorder(self._recorder)

    def split(self, text: str | None = None) -> tuple[Path, Path]:
        """Continue in another file, each message in one of the two; return the former and the new path.

        Args:
            text: As for `start`; None for the present name with a number.
        """
        with self._lock:
            recorder, former = self._present("record/split")
            path = claim(self.folder, text, self._stem)
            with self.graph_notes.new_log():
                recorder.switch(self._writer(path))
                self.path, self._since = path, time.monotonic()
            return former, path

    def stop(self) -> tuple[Path, dict[str, Any]]:
        """End the recording, whatever the bus does, and return its path and figures; call `settle` afterwards."""
        with self._lock:
            recorder, path = self._present("record/stop")
            recorder.close()
            figures = self.status() or {}
            self._recorder, self.path = None, None
            return path, figures

    def close(self) -> None:
        """Finish the file, after the bus has closed; safe to call twice."""
        self._announcements.close()
        if self._recorder is not None:
            self._recorder.close()

    def watch(self) -> None:
        """Start to track publishers' announcements (liveliness tokens) in all segments; wait for none."""
        for session in self._bus().sessions.values():
            self._announcements.watch(session, wait=False)

    def _write_note(self, name: str, mapping: Mapping[str, str]) -> bool:
        return self._recorder is not None and self._recorder.note(name, mapping)

    def _wanted(self, key: str) -> bool:
        return self._recorder is not None or any(key_matches(each, key) for each in self._bus().intercepted)

    def _learnt(self, key: str) -> None:
        self._bus().renew()
        recorder = self._recorder
        if recorder is not None:
            recorder.renew(key)

    def status(self) -> dict[str, Any] | None:
        """Return file, messages, lost and seconds of the present recording, and why it has failed if it has."""
        recorder, path = self._recorder, self.path
        if recorder is None or path is None:
            return None
        account = recorder.present()
        return {
            "file": str(path),
            "messages": sum(account.recorded.values()),
            "lost": account.total(),
            "seconds": round(time.monotonic() - self._since, 3),
            "problem": recorder.problem,
        }

    def _present(self, where: str) -> tuple[Recorder, Path]:
        if self._recorder is None or self.path is None:
            raise ConfigError("this router does not record", where=where, hint="begin with: riot ctl record start")
        return self._recorder, self.path

    def _writer(self, path: Path) -> LogWriter:
        from riot_bus.log.rosbag2 import bag_epilogue
        from riot_bus.log.run import run_facts
        from riot_bus.log.writer import LogSettings, LogWriter

        profile = self._profile or ("ros2" if self._announcements else None)
        return LogWriter(
            path,
            LogSettings(threaded=True, durable=True),
            registry=self._registry,
            metadata={**run_facts(), **self._metadata()},
            profile=profile,
            channel_metadata=self._announcements.details,
            epilogue=bag_epilogue if profile == "ros2" else None,
        )

    def _await_observation(self) -> None:
        """Wait until what is published in any segment would be observed; routes take about 100 ms."""
        from riot_bus.zenoh.session import wait_until

        sessions = self._bus().sessions
        if len(sessions) < 2:
            return
        # Only those who subscribe to everything subscribe to this key.
        key = f"riot_bus/{next(iter(sessions.values())).info.zid()}"
        publishers: list[Any] = [
            each.declare_publisher(key, allowed_destination=library_of(each).Locality.REMOTE)
            for each in sessions.values()
        ]
        # Two seconds are 20 times the usual 100 ms; a recording then begins all the same.
        wait_until(lambda: all(each.matching_status.matching for each in publishers), 2.0)
        for each in publishers:
            each.undeclare()
