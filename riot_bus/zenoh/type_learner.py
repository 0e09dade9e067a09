"""Asks the users of a key for its type if it has no local definition: on its own thread, one query at a time.

This concerns only keys whose messages are used here, and does not delay anything. A starting component may publish
before it answers queries, so it is asked again, a few times.
"""

from __future__ import annotations

import logging
import threading
import time
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.vocabulary.message import CACHED_KEYS
from riot_bus.zenoh.attachment_probe import AttachmentProbe
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session_config import ANSWER_S

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import zenoh

    from riot_bus.types.registry import TypeRegistry

_LOG = logging.getLogger(__name__)
_FIRST_S = 0.05  # what a component announces comes in a burst
_AGAIN_S = (1.0, 5.0, 20.0, 60.0)  # a starting component answers soon; after five questions in 86 s, it is mute
_LOOK_S = 2.0  # how late a key that is used from now on is noticed; a look goes over all of `CACHED_KEYS`
_MOST_PROBES = 64  # each is a subscription in all sessions, whose messages come here: bounds that load
_MOST_QUESTIONS = 10_000  # in the life of a process: peers that invent types cannot make it ask for ever
_MOST_REPLIES = 4  # a node sends one; others that answer under its key must not take for ever
_MOST_BYTES = 1 << 20  # descriptions of types are text of some KB; larger replies are ignored


@dataclass(slots=True, eq=False)
class _Pursuit:
    """State of the search for the type of one key.

    Attributes:
        due: Monotonic time of the next attempt, in seconds.
        missing: Whether the type is missing; None before the first attempt.
        asked: Number of attempts with queries.
    """

    key: str
    due: float
    missing: bool | None = None
    asked: int = 0
    probe: AttachmentProbe | None = None

    def close(self) -> None:
        if self.probe is not None:
            self.probe.close()
            self.probe = None


class Learner:
    """Learns the types of keys.

    Args:
        wanted: Function that tells whether messages of a key are used here.
        learnt: Function called with each key whose type has become known.

    Attributes:
        sessions: Sessions to subscribe and query with, one after the other until there is an answer.
    """

    def __init__(
        self,
        registry: TypeRegistry,
        *,
        tokens: Callable[[], Sequence[str]],
        wanted: Callable[[str], bool],
        learnt: Callable[[str], None],
    ) -> None:
        self.sessions: list[zenoh.Session] = []
        self._registry, self._tokens, self._wanted, self._learnt = registry, tokens, wanted, learnt
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._settled: set[str] = set()
        self._pursued: dict[str, _Pursuit] = {}
        self._questions = 0
        self._closed = False
        self._thread: threading.Thread | None = None
        self._asking: Any = None

    def look(self, key: str) -> None:
        """Schedule learning the type of a key if it is missing; to be called whenever the key is announced."""
        with self._lock:
            if self._closed or key in self._settled or key in self._pursued or len(self._pursued) >= CACHED_KEYS:
                return
            self._pursued[key] = _Pursuit(key, time.monotonic() + _FIRST_S)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="riot-types", daemon=True)
                self._thread.start()
        self._wake.set()

    def idle(self) -> bool:
        """Return whether all missing and wanted types have been asked for."""
        return all(
            each.missing is False or (each.missing and (each.asked > 0 or not self._wanted(each.key)))
            for each in list(self._pursued.values())
        )

    def close(self) -> None:
        """Stop asking; safe to call twice."""
        with self._lock:
            self._closed = True
            if self._asking is not None:
                self._asking.cancel()
        self._wake.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        while not self._closed:
            now = time.monotonic()
            pursued = list(self._pursued.values())
            for each in pursued:
                if each.due <= now and not self._closed:
                    try:
                        self._pursue(each)
                    except Exception:  # a third-party adapter may raise anything
                        _LOG.exception("the type of %s cannot be learnt", each.key)
                        self._settle(each)
            due = min((each.due for each in list(self._pursued.values())), default=now + _LOOK_S)
            self._wake.wait(max(0.0, due - time.monotonic()))
            self._wake.clear()
        for each in self._pursued.values():
            each.close()

    def _pursue(self, pursuit: _Pursuit) -> None:
        key, registry = pursuit.key, self._registry
        pursuit.due = time.monotonic() + _LOOK_S
        if pursuit.missing is None or self._wanted(key):
            pursuit.missing = registry.missing(key)
        if not pursuit.missing:
            self._settle(pursuit)
            return
        if not self._wanted(key):
            pursuit.close()
            return
        if pursuit.probe is None:
            if sum(each.probe is not None for each in list(self._pursued.values())) < _MOST_PROBES:
                pursuit.probe = AttachmentProbe(key, self.sessions, partial(self._hurry, pursuit))
            return
        before = self._questions
        if registry.learn(key, self._tokens(), pursuit.probe.attachments, self._ask):
            self._settle(pursuit)
            _LOG.info("the type of %s was told by those who use it", registry.topic(key))
            self._learnt(key)
        elif self._questions > before:
            pursuit.asked += 1
            if pursuit.asked > len(_AGAIN_S):
                pursuit.close()
                self._pursued.pop(key)  # until another component announces it
            else:
                pursuit.due = time.monotonic() + _AGAIN_S[pursuit.asked - 1]

    def _hurry(self, pursuit: _Pursuit) -> None:
        if not pursuit.asked:
            pursuit.due = 0.0
            self._wake.set()

    def _settle(self, pursuit: _Pursuit) -> None:
        pursuit.close()
        if len(self._settled) >= CACHED_KEYS:
            self._settled.clear()
        self._settled.add(pursuit.key)
        self._pursued.pop(pursuit.key)

    def _ask(self, key: str, payload: bytes, attachment: bytes) -> Iterator[bytes]:
        for session in self.sessions:
            zenoh = library_of(session)
            with self._lock:
                if self._closed or self._questions >= _MOST_QUESTIONS:
                    return
                self._asking = zenoh.CancellationToken()
            self._questions += 1
            try:
                replies = session.get(
                    key,
                    payload=payload,
                    attachment=attachment,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    timeout=ANSWER_S,
                    allowed_destination=zenoh.Locality.REMOTE,  # not our own stand-ins for services
                    cancellation_token=self._asking,
                )
            except zenoh.ZError:  # it is closed, or this is not a key
                continue
            answered = False
            for _, reply in zip(range(_MOST_REPLIES), replies, strict=False):
                sample = reply.ok
                if sample is not None and len(sample.payload) <= _MOST_BYTES:
                    answered = True
                    yield sample.payload.to_bytes()
            if answered:
                return
