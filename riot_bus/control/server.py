"""Control of a running router through Zenoh itself: it answers queries under `@riot/<name>/<command>`."""

from __future__ import annotations

import itertools
import logging
import threading
import time
from contextlib import nullcontext, suppress
from typing import TYPE_CHECKING, Any, Self

from riot_bus.control.commands import LARGEST_PAYLOAD, Command, answer, refusal
from riot_bus.vocabulary.errors import ConfigError, RiotError
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release
from riot_bus.zenoh.session_config import OWN_CHUNK

if TYPE_CHECKING:
    from collections.abc import Mapping
    from contextlib import AbstractContextManager

    from riot_bus.zenoh import api as zenoh

_LOG = logging.getLogger(__name__)
_MOST_QUEUED = 64  # a guess: commands of people; in a flood, the oldest queries end unanswered
_MOST_URGENT = 1024
"""Queue length of an urgent command: at 5,000 queries per second, the thread may stall for 0.2 s and lose none."""


class Control:
    """Query service for control commands in some segments; a context manager.

    A lane is a Zenoh queue with a thread. In each segment, each command has its own lane, so an urgent command waits
    only for queries of the same command. When a queue is full, its oldest query ends without an answer; this costs time
    neither in Python nor on the link. Commands that are not urgent run one after another. A further lane gets every
    query, answers for unknown commands, and ends the others at once: a query lasts until all lanes have ended it. Each
    query arrives once, because queries do not cross the junction (`zenoh.session_config.access_control`). A query with
    wildcards runs only the commands that read.

    Args:
        service: The router (or other object the commands act on), open; urgent commands may run beside others.
        under: The keys below its name that it answers for; others may belong to another service.
    """

    def __init__(
        self,
        service: Any,
        name: str,
        sessions: Mapping[str, zenoh.Session],
        *,
        commands: Mapping[str, Command],
        under: str = "**",
    ) -> None:
        self._service = service
        self._name = name
        self._sessions = sessions
        self._commands = commands
        self._under = under
        self._shared = threading.Lock()
        self._queryables: list[Any] = []
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        for session in self._sessions.values():
            for name, command in self._commands.items():
                most, turn = (_MOST_URGENT, nullcontext()) if command.urgent else (_MOST_QUEUED, self._shared)
                self._open_lane(session, name, {name: command}, most, turn)
            self._open_lane(session, self._under, {}, _MOST_QUEUED, nullcontext())
        return self

    def __exit__(self, *error: object) -> None:
        release(*self._queryables)
        end = time.monotonic() + 10.0  # an asker who does not read blocks a lane until Zenoh closes the link, after 5 s
        for each in self._threads:
            each.join(max(0.0, end - time.monotonic()))

    def _open_lane(
        self,
        session: zenoh.Session,
        keys: str,
        commands: Mapping[str, Command],
        most: int,
        turn: AbstractContextManager[object],
    ) -> None:
        library = library_of(session)
        queryable: Any = session.declare_queryable(
            f"{OWN_CHUNK}/{self._name}/{keys}",
            library.handlers.RingChannel(most),
            allowed_origin=library.Locality.REMOTE,
        )
        self._queryables.append(queryable)
        thread = threading.Thread(
            target=self._run,
            args=(queryable.handler, commands, turn, library.ZError),
            name=f"riot-control {keys}",
            daemon=True,
        )
        self._threads.append(thread)
        thread.start()

    def _run(
        self,
        questions: Any,
        commands: Mapping[str, Command],
        turn: AbstractContextManager[object],
        closed: type[Exception],
    ) -> None:
        while True:
            try:
                query = questions.recv()
            except closed:
                return
            try:
                with query:  # leaving the block ends the query
                    self._answer(query, commands, turn)
            except Exception:
                _LOG.exception("a question could not be answered")
            del query

    def _answer(
        self, query: zenoh.Query, commands: Mapping[str, Command], turn: AbstractContextManager[object]
    ) -> None:
        """Run those of a lane's commands that a query asks for; commands of other lanes are left to those lanes."""
        prefix = f"{OWN_CHUNK}/{self._name}/"
        asked = str(query.key_expr)
        if "*" in asked:
            reading = (name for name, command in commands.items() if command.reads)
            names = [name for name in reading if self._means(query, prefix + name)]
        else:
            name = asked.removeprefix(prefix)
            names = [name] if name in commands or name not in self._commands else []
        if not names:
            return
        try:
            size = len(query.payload) if query.payload is not None else 0
            if size > LARGEST_PAYLOAD:
                raise ConfigError(f"{size} bytes are too many", where=asked, hint=f"at most {LARGEST_PAYLOAD}")
            payload = query.payload.to_bytes() if query.payload is not None else b""
            parameters = {str(key): str(value) for key, value in _pairs(str(query.parameters))}
            for name in names:
                with turn:
                    found = answer(self._service, self._name, name, payload, parameters, commands=self._commands)
                self._reply(query, prefix + name, found)
        except RiotError as error:
            error.where = error.where or asked
            self._refuse(query, error)
        except Exception as error:
            _LOG.exception("the command %s failed", asked[:200])
            self._refuse(query, error)

    @staticmethod
    def _means(query: zenoh.Query, key: str) -> bool:
        return query.key_expr.intersects(library_of(query).KeyExpr(key))

    @staticmethod
    def _reply(query: zenoh.Query, key: str, payload: bytes) -> None:
        # A client that does not read blocks only this thread, until Zenoh closes its link.
        query.reply(key, payload, encoding="application/json")

    def _refuse(self, query: zenoh.Query, error: Exception) -> None:
        with suppress(Exception):  # the asker may have gone
            query.reply_err(refusal(self._name, error), encoding="application/json")


def free_name(session: zenoh.Session, name: str, group: str) -> str:
    """Return a name for the control keys, with a number appended if another service has it.

    Args:
        session: Session that asks for the others.
        name: The preferred name.
        group: First part of the service's commands, such as `play` for `play/status`.
    """
    replies = session.get(f"{OWN_CHUNK}/*/{group}/status", timeout=1.0)  # one that does not answer delays a start
    taken = {str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok is not None}
    numbered = (f"{name}-{number}" for number in itertools.count(2))
    return next(each for each in itertools.chain([name], numbered) if each not in taken)


def _pairs(text: str) -> list[tuple[str, str]]:
    """Split `a=1;b=2` into pairs; a part without `=` gets an empty value."""
    pairs = (part.partition("=") for part in text.split(";") if part)
    return [(key, value) for key, _, value in pairs]
