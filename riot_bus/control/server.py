"""Control of a running router through Zenoh itself: it answers questions under `@riot/<name>/<command>`."""

from __future__ import annotations

import logging
import threading
from contextlib import suppress
from queue import Full, Queue
from typing import TYPE_CHECKING, Any, Self

from riot_bus.control.commands import LARGEST_PAYLOAD, Command, answer, refusal
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release
from riot_bus.zenoh.session_config import OWN_CHUNK

if TYPE_CHECKING:
    from collections.abc import Mapping

    from riot_bus.zenoh import api as zenoh

__all__ = ["Control"]

_LOG = logging.getLogger(__name__)
_MOST_WAITING = 64


class Control:
    """Answers questions in some segments; a context manager.

    Commands are carried out one after another on a thread of its own, so that no question holds up traffic. Each is
    asked once, since questions do not cross the junction (`config.access_control`). A question with wildcards means
    the commands that only read.

    Args:
        service: The router (or what else the commands are for), open.
        name: Its name.
        sessions: The sessions of the segments in which it answers.
        commands: What it can do.
        under: Which of its keys it answers for; others may be somebody else's.
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
        self._waiting: Queue[zenoh.Query | None] = Queue(_MOST_WAITING + 1)
        self._queryables: list[Any] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="riot-control", daemon=True)

    def __enter__(self) -> Self:
        expression = f"{OWN_CHUNK}/{self._name}/{self._under}"
        for session in self._sessions.values():
            queryable = session.declare_queryable(
                expression, self._take, allowed_origin=library_of(session).Locality.REMOTE
            )
            self._queryables.append(queryable)
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._closing.set()
        release(*self._queryables)
        with suppress(Full):
            self._waiting.put_nowait(None)
        self._thread.join()

    def _take(self, query: zenoh.Query) -> None:
        """Take a question on a thread of Zenoh's; return at once."""
        try:
            self._waiting.put_nowait(query)
        except Full:
            text = f"{_MOST_WAITING} commands are waiting already"
            with query:  # which ends it
                self._refuse(query, EnvironmentFaultError(text, where=self._name, hint="ask again later"))

    def _run(self) -> None:
        while not self._closing.is_set():
            query = self._waiting.get()
            if query is None:
                return
            try:
                with query:
                    self._answer(query)
            except Exception:
                _LOG.exception("a question could not be answered")
            del query  # it ends when nobody holds it any more

    def _answer(self, query: zenoh.Query) -> None:
        prefix = f"{OWN_CHUNK}/{self._name}/"
        asked = str(query.key_expr)
        if "*" in asked:
            reading = (name for name, command in self._commands.items() if command.reads)
            names = [name for name in reading if self._means(query, prefix + name)]
        else:
            names = [asked.removeprefix(prefix)]
        try:
            size = len(query.payload) if query.payload is not None else 0
            if size > LARGEST_PAYLOAD:
                raise ConfigError(f"{size} bytes are too many", where=asked, hint=f"at most {LARGEST_PAYLOAD}")
            payload = query.payload.to_bytes() if query.payload is not None else b""
            parameters = {str(key): str(value) for key, value in _pairs(str(query.parameters))}
            for name in names:
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
        # A client that does not read holds up this thread at most, until Zenoh closes its link.
        query.reply(key, payload, encoding="application/json")

    def _refuse(self, query: zenoh.Query, error: Exception) -> None:
        with suppress(Exception):  # the asker may have gone
            query.reply_err(refusal(self._name, error), encoding="application/json")


def _pairs(text: str) -> list[tuple[str, str]]:
    """Take `a=1;b=2` apart; what is no pair has an empty value."""
    pairs = (part.partition("=") for part in text.split(";") if part)
    return [(key, value) for key, _, value in pairs]
