"""Recording of a network: start, control, observe, stop; for the command line and for agents."""

from __future__ import annotations

import itertools
import json
import logging
import os
import threading
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from riot_bus import __version__
from riot_bus.control.commands import Command, reporting
from riot_bus.control.graph_notes import GraphNotes
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import registry_of
from riot_bus.control.server import Control, free_name
from riot_bus.log.account import Account
from riot_bus.log.gaps import Gaps
from riot_bus.log.run import run_facts
from riot_bus.record.latched import LatchedCaches
from riot_bus.record.naming import Naming
from riot_bus.record.ring_sink import RingSink
from riot_bus.record.rotating_sink import FileResult, RotatingSink
from riot_bus.record.selection import RecordingSelection
from riot_bus.record.subscriber import RecordingSubscriber
from riot_bus.record.trigger import Trigger
from riot_bus.record.watched_network import WatchedNetwork
from riot_bus.vocabulary.errors import ConfigError, RiotError
from riot_bus.vocabulary.redaction import redacted
from riot_bus.vocabulary.selector import key_matches
from riot_bus.zenoh.batches import Batches
from riot_bus.zenoh.convert import Claims
from riot_bus.zenoh.keyexpr_pins import begin_pinning, end_pinning
from riot_bus.zenoh.publisher_tokens import Announcements
from riot_bus.zenoh.session import open_session, prepare_runtime, release
from riot_bus.zenoh.session_config import OWN_CHUNK, client_config

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from riot_bus.control.commands import CommandRequest
    from riot_bus.record.options import CaptureOptions
    from riot_bus.zenoh import api as zenoh

_LOG = logging.getLogger(__name__)
_LINK_S = 1.0  # a lost link is reported, and a router that does not answer holds up the start, for as long
UNDER = "record/**"
"""The keys of these commands, below the recorder's own."""


@dataclass(frozen=True, slots=True)
class CaptureResult:
    """Result of a recording; true if nothing is lost and there are no problems.

    Attributes:
        files: Files in the order of writing.
        account: Messages by topic: recorded, lost by reason, left out by reason.
        problems: Problems, a line each.
        silent: Requested names and key expressions on which no message came.
    """

    files: Sequence[FileResult] = ()
    account: Account = field(default_factory=Account)
    seconds: float = 0.0
    problems: Sequence[str] = ()
    silent: Sequence[str] = ()

    def __bool__(self) -> bool:
        return not self.account and not self.problems

    def document(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {
            "files": [each.row() for each in self.files],
            "recorded": dict(self.account.recorded),
            "lost": {reason: dict(topics) for reason, topics in self.account.lost.items()},
            "left_out": {reason: dict(topics) for reason, topics in self.account.left_out.items()},
            "seconds": round(self.seconds, 3),
            "problems": list(self.problems),
            "silent": list(self.silent),
        }


class CaptureService:
    """Recording of a network; as a context manager, it starts on entry and stops on exit.

    Its operations may be called by several threads.

    Raises:
        ConfigError: An option is not usable.
    """

    def __init__(self, options: CaptureOptions, *, warn: Callable[[str], None] = _LOG.warning) -> None:
        options.check()
        self.options = options
        self.name = options.name
        self.registry = registry_of(RouterOptions(types=options.types, definitions=options.definitions))
        self._warn = warn
        self._trigger = Trigger(options.dump_on, registry=self.registry, monitors=options.monitors)
        self._announcements = Announcements(self.registry, wanted=self._wanted, learnt=self._learnt)
        self._selection = RecordingSelection(options, registry=self.registry, trigger=self._trigger, warn=warn)
        self._sink: RotatingSink | RingSink | None = None
        self._subscribers: list[RecordingSubscriber] = []
        self._gaps = Gaps()
        self._paused = options.paused
        self._graph_notes = GraphNotes(self._write_note)
        self._problems: list[str] = []
        self._linked = True
        self._looked = 0.0
        self._stack = ExitStack()
        self._stopping, self._done, self._dump = threading.Event(), threading.Event(), threading.Event()
        self._began = self._ended = 0.0
        self._thread = threading.Thread(target=self._run, name="riot-capture", daemon=True)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    # -- life ---------------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Connect and begin; once this returns, everything that is published is recorded.

        Raises:
            ConfigError: The file exists already or cannot be written.
            EnvironmentFaultError: No router answers at the endpoint.
        """
        options = self.options
        with ExitStack() as stack:
            prepare_runtime()
            session = open_session(client_config(options.endpoint, extra=options.config), purpose="recorder")
            begin_pinning(session)
            stack.callback(end_pinning, session)
            stack.callback(release, session)
            self._session = session
            self._announcements.watch(session)
            stack.callback(self._announcements.close)
            self._sink = self._open_sink()
            stack.callback(self._sink.close)
            self._listen(session, stack)
            if options.graph:
                from riot_bus.graph.watch import GraphWatch

                network = WatchedNetwork(session, lambda: self._subscribers)
                watch = GraphWatch(network, self._graph_notes.update, senders=network.senders, registry=self.registry)
                stack.enter_context(watch)
            if options.control:
                self.name = free_name(session, options.name, "record")
                stack.enter_context(Control(self, self.name, {"": session}, commands=CAPTURE_COMMANDS, under=UNDER))
            _await_routes(session)
            self._stack = stack.pop_all()
        self._began = time.monotonic()
        self._thread.start()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the files are finished; return whether they are."""
        return self._done.wait(timeout)

    def close(self) -> None:
        """Finish the files and disconnect; safe to call twice."""
        self.stop()
        if self._thread.is_alive():
            self._thread.join()
        self._stack.close()

    # -- commands -----------------------------------------------------------------------------------------------------

    def pause(self) -> None:
        """Record nothing until `resume`; what comes meanwhile is counted as left out."""
        self._paused = True

    def resume(self) -> None:
        """Resume recording."""
        self._paused = False

    def split(self, path: str | None = None) -> tuple[Path, Path]:
        """Continue in another file; return the former and the new path.

        Raises:
            ConfigError: It is refused, or there is nothing to split.
        """
        return self._running().split(path)

    def dump(self, path: str | None = None) -> Path:
        """Write the ring to a file; recording continues meanwhile.

        Args:
            path: Path relative to the folder; None for the next name in turn.

        Raises:
            ConfigError: It is refused, or there is no ring.
            EnvironmentFaultError: The disk is full or has failed.
        """
        sink = self._running()
        if not isinstance(sink, RingSink):
            hint = "riot record --ring SECONDS keeps one; this recording can be split instead"
            raise ConfigError("there is no ring to be written", where="record/dump", hint=hint)
        return sink.dump(path)

    def cut(self) -> None:
        """Write the ring, or begin another file if there is none, as soon as possible; for signal handlers."""
        self._dump.set()

    def stop(self) -> None:
        """End as soon as possible; does not wait for it."""
        self._stopping.set()

    # -- what is going on ---------------------------------------------------------------------------------------------

    @property
    def paused(self) -> bool:
        """Whether nothing is recorded at present."""
        return self._paused

    def status(self) -> dict[str, Any]:
        """Return the state as JSON values."""
        sink = self._sink
        found: dict[str, Any] = {"file": "", "bytes": 0, "waiting_bytes": 0, "problem": ""}
        account = Account()
        if sink is not None:
            found, account = sink.status(), sink.account()
        state = "ended" if self._done.is_set() else "paused" if self._paused else "recording"
        return {
            **found,
            "name": self.name,
            "version": __version__,
            "pid": os.getpid(),
            "endpoint": redacted(self.options.endpoint),
            "connected": self._linked,
            "state": state,
            "seconds": round(self._seconds(), 3),
            "messages": sum(account.recorded.values()),
            "lost": account.total(),
            "reasons": {reason: sum(topics.values()) for reason, topics in account.lost.items()},
            "left_out": {reason: sum(topics.values()) for reason, topics in account.left_out.items()},
            "files": len(sink.files()) if sink is not None else 0,
        }

    def result(self) -> CaptureResult:
        """Return the result so far."""
        sink = self._sink
        problems = list(self._problems)
        if sink is None:
            return CaptureResult(problems=problems)
        if sink.problem:
            problems.append(sink.problem)
        if self._gaps.untold:
            problems.append("there are too many publishers to look for gaps in the numbers of all")
        return CaptureResult(sink.files(), sink.account(), self._seconds(), problems, self._selection.silent())

    def senders(self) -> dict[str, set[str]]:
        """Return the ids in the stamps of messages, by key; components stamp theirs if their configuration says so."""
        found: dict[str, set[str]] = {}
        for each in self._subscribers:
            for key, zids in each.senders().items():
                found.setdefault(key, set()).update(zids)
        return found

    def _seconds(self) -> float:
        return (self._ended or time.monotonic()) - self._began if self._began else 0.0

    # -- recording ----------------------------------------------------------------------------------------------------

    def _running(self) -> RotatingSink | RingSink:
        if self._sink is None or self._done.is_set():
            raise ConfigError("nothing is being recorded", where="record")
        return self._sink

    def _wanted(self, key: str) -> bool:
        return any(key_matches(each, key) for each in self._selection.expressions)

    def _learnt(self, key: str) -> None:
        if self._sink is not None:
            self._sink.renew(key)
            self._selection.learnt(key)

    def _open_sink(self) -> RotatingSink | RingSink:
        options, naming = self.options, Naming(self.options)
        profile = "ros2" if options.bag else options.profile or ("ros2" if self._announcements else "none")
        profile = "" if profile == "none" else profile
        common: dict[str, Any] = {
            "registry": self.registry,
            "naming": naming,
            "metadata": self._metadata,
            "details": self._announcements.details,
            "profile": profile,
            "warn": self._warn,
        }
        if options.ring_seconds:
            return RingSink(options, notes=self._graph_notes.whole, **common)
        return RotatingSink(options, began=self._note_whole_graph, **common)

    def _listen(self, session: zenoh.Session, stack: ExitStack) -> None:
        sink = self._running()
        expressions = self._selection.expressions
        claims, numbers = Claims(expressions), itertools.count(1)
        for text in expressions:
            subscriber = RecordingSubscriber(
                Batches(session, text),
                text,
                sink=sink,
                gaps=self._gaps,
                owner=claims.owner,
                rules=self._selection.rules,
                paused=lambda: self._paused,
                sequence=numbers,
            )
            stack.callback(subscriber.close)
            self._subscribers.append(subscriber)
        if self.options.latched:
            by_text = {each.expression: each for each in self._subscribers}

            def record(key: str, samples: list[Any]) -> None:
                owner = claims.owner(key)
                if owner is not None:
                    by_text[owner].put(samples)

            latched = LatchedCaches(session, wanted=lambda key: claims.owner(key) is not None, record=record)
            stack.callback(latched.close)
            self._latched: LatchedCaches | None = latched
        else:
            self._latched = None

    def _run(self) -> None:
        try:
            while not self._stopping.wait(0.1):  # so late chunks end by age, and another file is begun
                self._tick()
                if self.options.duration and self._seconds() >= self.options.duration:
                    break
        except Exception as error:
            _LOG.exception("the recording failed")
            self._problems.append(repr(error))
        try:
            self._finish()
        except Exception as error:
            _LOG.exception("the recording could not be finished")
            self._problems.append(repr(error))
        finally:
            self._ended = time.monotonic()
            self._done.set()

    def _tick(self) -> None:
        sink = self._running()
        sink.tick()
        self._look_at_link()
        reason = self._trigger.take(self.options.dump_after)
        if reason is not None:
            self._cut(f"{reason}: ")
        if self._dump.is_set():
            self._dump.clear()
            self._cut("")

    def _cut(self, why: str) -> None:
        try:
            if isinstance(self._sink, RingSink):
                self._warn(f"{why}wrote {self._sink.dump()}")
            else:
                self._warn(f"{why}went on in {self._running().split()[1]}")
        except RiotError as error:
            self._warn(f"{why}{error}")

    def _finish(self) -> None:
        if self._latched is not None:
            self._latched.close()
        for subscriber in self._subscribers:
            subscriber.close()
        reason = self._trigger.take(0.0)
        if reason is not None:
            self._cut(f"{reason}: ")
        self._running().close()

    def _look_at_link(self) -> None:
        """Report a lost connection: messages published meanwhile can be neither recorded nor counted."""
        now = time.monotonic()
        if now - self._looked < _LINK_S:
            return
        self._looked = now
        linked = any(True for _ in self._session.info.transports())
        if linked != self._linked:
            self._linked = linked
            where = redacted(self.options.endpoint)
            if linked:
                self._warn(f"the link to {where} is back")
            else:
                self._problems.append(f"the link to {where} broke: what was published meanwhile is not recorded")
                self._warn(f"ALARM: the link to {where} is broken: nothing is recorded until it is back")

    # -- what is written besides messages -----------------------------------------------------------------------------

    def _metadata(self) -> dict[str, str]:
        options = self.options
        hidden = {"config", "notes", "definitions", "monitors"}  # configuration may hold passwords
        settings = {each.name: getattr(options, each.name) for each in fields(options) if each.name not in hidden}
        settings["endpoint"] = redacted(options.endpoint)
        found = {
            "recorder": self.name,
            **run_facts(),
            "seed": str(options.seed),
            "options": json.dumps(settings, default=_plain, sort_keys=True),
        }
        if options.robot:
            found["robot"] = options.robot
        return found | dict(options.notes)

    def _write_note(self, name: str, mapping: Mapping[str, str]) -> bool:
        sink = self._sink
        if sink is None or self._done.is_set():
            return False
        sink.note(name, mapping)
        return True

    def _note_whole_graph(self) -> None:
        with self._graph_notes.new_log():
            pass  # the file has begun already


def _await_routes(session: zenoh.Session) -> None:
    """Wait until the router knows our subscriptions, since it processes what comes over a link in order."""
    with suppress(Exception):  # whatever is at the other end
        for _ in session.get(f"{OWN_CHUNK}/{session.info.zid()}/none", timeout=_LINK_S):
            pass


def _plain(value: object) -> object:
    return dict(value) if isinstance(value, Mapping) else str(value) if isinstance(value, Path) else list(value)  # type: ignore[call-overload]


def _start(service: CaptureService, _: CommandRequest) -> None:
    if not service.paused:
        hint = "split it (riot ctl record split), or stop it (riot ctl record stop)"
        raise ConfigError("this recorder is recording already", where="record/start", hint=hint)
    service.resume()


def _split(service: CaptureService, request: CommandRequest) -> dict[str, Any]:
    former, present = service.split(request.path())
    return {"former": str(former), "file": str(present)}


CAPTURE_COMMANDS: dict[str, Command] = {
    "record/status": Command(lambda service, _: service.status(), reads=True, urgent=True),
    "record/start": reporting(_start),
    "record/pause": reporting(lambda service, _: service.pause(), urgent=True),
    "record/resume": reporting(lambda service, _: service.resume(), urgent=True),
    "record/split": Command(_split),
    "record/dump": Command(lambda service, request: {"dumped": str(service.dump(request.path()))}),
    "record/stop": reporting(lambda service, _: service.stop(), urgent=True),
}
"""All commands by name."""
