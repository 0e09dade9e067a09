"""Answers calls of a service with what was recorded of it, where the service itself does not run."""

from __future__ import annotations

import logging
import threading
from collections import Counter
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.router.services.call import payload_of, reply_to
from riot_bus.types.serve import REQUEST, Request, part_of
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh

__all__ = ["RecordedCall", "RecordedService", "calls_in", "serve_recorded"]

_LOG = logging.getLogger(__name__)


class RecordedCall(NamedTuple):
    """A request and all that was answered to it."""

    request: Message
    replies: Sequence[Message]


def calls_in(messages: Iterable[Message]) -> dict[str, list[RecordedCall]]:
    """Return the calls of a log by the keys of their services, in the order of their requests.

    Args:
        messages: Requests, replies and errors, by time; others are passed over. Those of one call have one number.
    """
    found: dict[str, list[RecordedCall]] = {}
    open_calls: dict[tuple[str, int], list[Message]] = {}
    for message in messages:
        key, part = part_of(message.key) or ("", "")
        if part == REQUEST:
            replies = open_calls[key, message.sequence] = []
            found.setdefault(key, []).append(RecordedCall(message, replies))
        elif part and (key, message.sequence) in open_calls:
            open_calls[key, message.sequence].append(message)
    return {key: answered for key, calls in found.items() if (answered := [each for each in calls if each.replies])}


class RecordedService:
    """What a service has answered: the same question gets the same answer, one after the other if there were several.

    A question that was not recorded gets what was answered to the recorded one of its number; after the last one, that.

    Args:
        calls: In the order in which they were recorded; at least one.
    """

    def __init__(self, calls: Sequence[RecordedCall]) -> None:
        self._calls = list(calls)
        self._asked: Counter[tuple[bytes, str] | None] = Counter()
        self._lock = threading.Lock()

    def restart(self) -> None:
        """Begin with the first answers again."""
        with self._lock:
            self._asked.clear()

    def replies(self, payload: bytes, parameters: str = "") -> Sequence[Message]:
        """Return what is answered to a question."""
        question = payload, parameters
        same = [each for each in self._calls if _question(each.request) == question]
        with self._lock:
            number = self._asked[question if same else None]
            self._asked[question if same else None] += 1
        calls = same or self._calls
        return calls[min(number, len(calls) - 1)].replies


def _question(request: Message) -> tuple[bytes, str]:
    return request.payload, request.parameters if isinstance(request, Request) else ""


def serve_recorded(session: zenoh.Session, key: str, service: RecordedService) -> Any:
    """Answer the calls of a service on a session's segment, as a complete service of that key would.

    With `rmw_zenoh` a reply's attachment names the request that it is for, so it is that of the request.

    Returns:
        Something with `undeclare()`.
    """

    def take(query: Any) -> None:
        try:
            for reply in service.replies(payload_of(query), str(query.parameters)):
                base, part = part_of(reply.key) or (key, "")
                asked = query.attachment
                reply_to(query, base, part, reply if asked is None else reply.with_(attachment=asked.to_bytes()))
        except library_of(session).ZError as error:  # whoever has asked is gone
            _LOG.debug("a call of %s is not answered: %s", key, error)
        finally:
            query.drop()

    pin(session, key)
    return session.declare_queryable(key, take, complete=True)
