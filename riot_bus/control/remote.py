"""The other end of control: asks a running router, and turns its refusals into errors."""

from __future__ import annotations

import json
import re
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Literal

from riot_bus.control.commands import VERSION
from riot_bus.vocabulary.errors import ConfigError, DataLossError, EnvironmentFaultError, InconclusiveError, RiotError
from riot_bus.vocabulary.redaction import escape_control_chars
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session_config import OWN_CHUNK, control_id

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from riot_bus.graph.model import Graph
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.client import Client

_TRIES = 8
"""How often to ask: a question that ends at once without an answer was not carried out, since its queue was full or it
is not allowed. In a flood of twice what a loaded machine can answer, every second question is lost."""
_LATE_S = 0.5
"""How long to wait, after an answer, for a second one, which there should not be."""

_ERRORS = {each.exit_code: each for each in (ConfigError, DataLossError, EnvironmentFaultError, InconclusiveError)}
_STATUS = {"router": "status", "player": "play/status", "recorder": "record/status", "agent": "agent/status"}
_NO_ANSWER = {
    "router": "is it riot's, and may this segment control it (control)?",
    "player": "is riot play running in this segment?",
    "recorder": "is riot record running, and connected to this router?",
    "agent": "is riot agent running there, and connected to this router? see riot fleet robots",
}

Kind = Literal["router", "player", "recorder", "agent"]


class ForgedAnswerError(EnvironmentFaultError):
    """Another process answers instead of the one that was asked, or in addition to it."""


class Remote:
    """A connection to a router, for several questions; a context manager.

    Args:
        name: The router's name; None if it is the only one.
        kind: Kind of process to ask, if not a router.

    Raises:
        EnvironmentFaultError: No router answers at the endpoint.
    """

    def __init__(
        self,
        endpoint: str,
        name: str | None = None,
        *,
        config: Mapping[str, Any] | None = None,
        kind: Kind = "router",
    ) -> None:
        self._endpoint = endpoint
        self._name = name
        self._kind = kind
        self.client: Client = open_client(endpoint, config={"id": control_id(), **(config or {})})

    def __enter__(self) -> Remote:
        return self

    def __exit__(self, *error: object) -> None:
        from riot_bus.zenoh import api as zenoh

        with suppress(zenoh.ZError):  # the link may hang
            self.client.close()

    def find(self) -> list[str]:
        """Return the names of all routers (or processes of the kind asked) that answer here."""
        names = set()
        from riot_bus.zenoh import api as zenoh

        everyone = f"{OWN_CHUNK}/*/{_STATUS[self._kind]}"
        # One process that hangs delays the list by the timeout.
        for reply in self.client.session.get(everyone, timeout=3.0, target=zenoh.QueryTarget.ALL):
            if reply.ok is not None:
                names.add(str(reply.ok.key_expr).split("/")[1])
        return sorted(names)

    def ask(
        self, command: str, payload: bytes | None = None, *, parameters: str = "", timeout: float = 30.0
    ) -> dict[str, Any]:
        """Return what the router answers.

        Args:
            command: Name of the command, such as `status` or `plan/load`.
            payload: Payload of the command.
            parameters: `name=value` pairs, joined by `;`.
            timeout: Maximum time in seconds; a router on a loaded machine answers in tenths of a second.

        Raises:
            EnvironmentFaultError: No router answers.
            ForgedAnswerError: There is more than one answer.
            ConfigError: There are several routers, or the command is wrong.
            RiotError: The router reports another error.
        """
        name = self._name if self._name is not None else self._only()
        selector = f"{OWN_CHUNK}/{name}/{command}" + (f"?{parameters}" if parameters else "")
        began = time.monotonic()
        answers: list[tuple[bool, bytes]] = []
        for _ in range(_TRIES):
            answers = self._answers(selector, payload, max(0.0, began + timeout - time.monotonic()))
            if answers or time.monotonic() - began >= timeout:
                break
        refusals = {str(error_from(document_of(data))) for ok, data in answers if not ok}
        if len(answers) > 1 and (len(refusals) > 1 or any(ok for ok, _ in answers)):
            hint = "two of one name, or one that answers for another: give each its own name, and use access control"
            text = f"{len(answers)} answers to one {command!r}: there is no telling which is {name}'s"
            raise ForgedAnswerError(text, where=self._endpoint, hint=hint)
        for ok, data in answers:
            if not ok:
                raise error_from(document_of(data))
            return _result(data)
        found = self.find()
        if name in found and time.monotonic() - began < timeout:
            hint = "it is asked too often just now, or access control refuses this"
            raise EnvironmentFaultError(f"{self._kind} {name!r} did not answer", where=command, hint=hint)
        if name in found:
            hint = "it runs, since it tells its status, and may still do what was asked: look before asking again"
            text = f"{self._kind} {name!r} did not answer in {timeout:g} s"
            raise EnvironmentFaultError(text, where=command, hint=hint)
        raise self._no_answer(name, found)

    def _answers(self, selector: str, payload: bytes | None, timeout: float) -> list[tuple[bool, bytes]]:
        """Ask; return the answers that come until all have answered, or some time after the first answer."""
        from riot_bus.zenoh import api as zenoh

        found: list[tuple[bool, bytes]] = []
        came, ended = threading.Event(), threading.Event()

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                found.append((True, reply.ok.payload.to_bytes()))
            elif reply.err is not None and "exit_code" in document_of(data := reply.err.payload.to_bytes()):
                found.append((False, data))  # any other is Zenoh's own, which reports the timeout
            came.set()

        def end() -> None:
            ended.set()
            came.set()

        try:
            self.client.session.get(
                selector,
                zenoh.handlers.Callback(take, end),
                payload=payload,
                timeout=timeout,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,  # else only one answer of a key arrives, at the end
            )
        except zenoh.ZError as error:
            raise ConfigError(f"{selector!r} cannot be asked: {error}", where=self._endpoint) from error
        came.wait(timeout + _LATE_S)
        ended.wait(_LATE_S)
        return list(found)

    def _only(self) -> str:
        found = self.find()
        if not found:
            raise self._no_answer(None, found)
        if len(found) > 1:
            hint = f"choose one: --{self._kind} NAME"
            raise ConfigError(f"several {self._kind}s answer: {', '.join(found)}", where=self._endpoint, hint=hint)
        return found[0]

    def _no_answer(self, name: str | None, found: list[str]) -> EnvironmentFaultError:
        who = f"no {self._kind} {name!r}" if name is not None else f"no riot {self._kind}"
        hint = f"there are {', '.join(found)}" if found else _NO_ANSWER[self._kind]
        return EnvironmentFaultError(f"{who} answers", where=self._endpoint, hint=hint)


def find_routers(endpoint: str, *, config: Mapping[str, Any] | None = None) -> list[str]:
    """Return the names of all routers that answer at an endpoint; arguments as for `Remote`."""
    with Remote(endpoint, config=config) as remote:
        return remote.find()


def ask(
    endpoint: str,
    name: str | None,
    command: str,
    payload: bytes | None = None,
    *,
    parameters: str = "",
    config: Mapping[str, Any] | None = None,
    kind: Kind = "router",
) -> dict[str, Any]:
    """Ask one question; arguments and errors as for `Remote` and `Remote.ask`."""
    with Remote(endpoint, name, config=config, kind=kind) as remote:
        return remote.ask(command, payload, parameters=parameters)


def plan_payload(file: Path) -> tuple[bytes, str]:
    """Return payload and parameters of `plan/load`; raises ConfigError if the file cannot be read."""
    try:
        return file.read_bytes(), f"name={re.sub(r'[^A-Za-z0-9._-]', '_', file.name)}"
    except OSError as error:
        raise ConfigError(f"cannot read the injection plan: {error.strerror}", where=str(file)) from error


def graphs(remote: Remote, *, watch: bool = False) -> Iterator[Graph]:
    """Yield the present graph; then, if asked to watch, each one that is different, for ever; one look a second."""
    from riot_bus.graph.history import graph_from

    former = None
    while True:
        graph = graph_from(remote.ask("graph"))
        if graph != former:
            yield graph
            former = graph
        if not watch:
            return
        time.sleep(1.0)


def _result(data: bytes) -> dict[str, Any]:
    document = document_of(data)
    result = document.get("result")
    if document.get("version") != VERSION or not isinstance(result, dict):
        text = f"the router answers in version {document.get('version')!r} of the format, not {VERSION}"
        raise EnvironmentFaultError(text, hint="use the same version of riot_bus on both sides")
    return result


def error_from(document: Mapping[str, Any]) -> RiotError:
    """Return the error that a refusal describes; control characters from the network are escaped."""
    code = document.get("exit_code")
    kind = _ERRORS.get(code if isinstance(code, int) else ConfigError.exit_code, EnvironmentFaultError)
    message, where, hint = (_text(document.get(name)) for name in ("message", "where", "hint"))
    return kind(message or "it does not say why", where=where, hint=hint)


def document_of(data: bytes) -> dict[str, Any]:
    """Return received data as a JSON object; if it is not one, its beginning as `message`."""
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        document = None
    return document if isinstance(document, dict) else {"message": data[:200].decode(errors="replace")}


def _text(value: Any) -> str | None:
    return "\n".join(map(escape_control_chars, str(value).split("\n"))) if value else None
