"""Recorded replies to the calls of a service that does not run itself."""

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

_LOG = logging.getLogger(__name__)


class RecordedCall(NamedTuple):
    """A recorded request and all its replies."""

    request: Message
    replies: Sequence[Message]


def calls_in(messages: Iterable[Message]) -> dict[str, list[RecordedCall]]:
    """Return the answered calls of a log by the keys of their services, in the order of their requests.

    Args:
        messages: Messages by time; only requests, replies and errors count. Those of one call share a sequence number.
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
    """The recorded replies of a service: equal requests get the replies recorded for them, one call after the other.

    The n-th request that was not recorded gets the replies of the n-th recorded call. After the last call, that one is
    repeated.

    Args:
        calls: Calls in the order in which they were recorded; at least one.
    """

    def __init__(self, calls: Sequence[RecordedCall]) -> None:
        self._calls = list(calls)
        self._asked: Counter[tuple[bytes, str] | None] = Counter()
        self._lock = threading.Lock()

    def restart(self) -> None:
        """Start again with the first recorded replies."""
        with self._lock:
            self._asked.clear()

    def replies(self, payload: bytes, parameters: str = "") -> Sequence[Message]:
        """Return the replies to a request."""
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

    A reply gets the attachment of its request, by which `rmw_zenoh` matches the two.

    Returns:
        An object with `undeclare()`.
    """

    def take(query: Any) -> None:
        try:
            for reply in service.replies(payload_of(query), str(query.parameters)):
                base, part = part_of(reply.key) or (key, "")
                asked = query.attachment
                reply_to(query, base, part, reply if asked is None else reply.with_(attachment=asked.to_bytes()))
        except library_of(session).ZError as error:  # the caller is gone
            _LOG.debug("a call of %s is not answered: %s", key, error)
        finally:
            query.drop()

    pin(session, key)
    return session.declare_queryable(key, take, complete=True)
