"""Detection of advanced publishers on intercepted keys, and the handling of their messages."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, OrderedDict, deque
from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.router.advanced.answers import Answers
from riot_bus.router.advanced.history_mirror import HistoryMirror
from riot_bus.router.advanced.publisher_state import PublisherState, Relayed, relayed
from riot_bus.router.advanced.source import AdvancedSource, announced, source_of
from riot_bus.router.advanced.upstream import Upstream
from riot_bus.router.worker import Worker
from riot_bus.zenoh.keyexpr_pins import pin
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.session import release, wait_until
from riot_bus.zenoh.session_config import ANSWER_S

if TYPE_CHECKING:
    from collections.abc import Callable

    from riot_bus.router.advanced.publisher_state import Stored
    from riot_bus.router.delivery_queue import DeliveryQueue
    from riot_bus.vocabulary.message import Message
    from riot_bus.zenoh import api as zenoh

_LOG = logging.getLogger(__name__)
_BEAT_S = 0.5  # how late subscribers hear of a lost last sample; a beat visits all publishers
_END_S = ANSWER_S * 2.5  # longer than the two queries that an earlier task may make
_MOST_ASKED = 1 << 16  # an entry takes about 300 bytes: bounds memory at about 20 MiB
_MOST_UNASKED = 1 << 13  # at 320 keys a second (see below), the last one waits 26 s
_ASK_AT_ONCE = 16  # with `_ASK_PAUSE_S` 320 keys a second: a query costs Zenoh more with more publishers
_ASK_PAUSE_S = 0.05  # leaves the worker's thread to other jobs after each group of queries
_ASK_REST = 9  # pauses are nine times as long as queries took, so these take at most a tenth of the time
_MOST_ENDED = 1 << 12  # their late samples must not revive them; about 400 bytes each: 2 MiB
_MOST_RELAYS = 1 << 14  # tokens can be forged, and each publisher costs declarations in all other segments


class PublisherProxies:
    """Proxies, in the other segments, for the advanced publishers of intercepted keys.

    Args:
        changed: Function called, on a thread that must not be held up, when another key has an advanced publisher.
        fence: Function that returns a test, to be asked twice, whether forwarders have taken all that has come from a
            segment.
    """

    def __init__(
        self,
        deliveries: DeliveryQueue,
        *,
        changed: Callable[[], None] = lambda: None,
        fence: Callable[[str], Callable[[], bool]],
    ) -> None:
        self.keys: dict[str, dict[AdvancedSource, PublisherState]] = {}
        """Keys that have advanced publishers."""
        self._deliveries, self._changed = deliveries, changed
        self._sessions = sessions = deliveries.access.sessions
        self._own = {str(session.info.zid()) for session in sessions.values()}
        self._lock = threading.Lock()
        self._watched: dict[str, list[Any]] = {}
        self._asked: OrderedDict[tuple[str, str], float] = OrderedDict()
        self._unasked: deque[tuple[str, str]] = deque(maxlen=_MOST_UNASKED)
        self._asking = False
        self._ended: OrderedDict[AdvancedSource, None] = OrderedDict()
        self._ending: set[PublisherState] = set()
        self._closed = False
        self._worker = Worker("riot-advanced")
        self._upstream = Upstream(sessions, self._worker)
        self._answers = Answers(sessions, self._worker, self._published_by)
        self._mirror = HistoryMirror(deliveries, worker=self._worker, upstream=self._upstream, fence=fence)
        self._worker.later(_BEAT_S, self._tick, background=True)

    # -- for the bus --------------------------------------------------------------------------------------------------

    @property
    def watched(self) -> list[str]:
        """The key expressions that are watched."""
        return list(self._watched)

    def watch(self, expression: str, *, again: bool) -> None:
        """Watch an intercepted expression; call this once the junction cuts it and the forwarders receive.

        Args:
            expression: Canonical key expression.
            again: Whether its messages crossed natively until now, so that subscribers have had the caches' content.
        """
        text = f"{expression}/@adv/pub/**"
        mine = self._watched[expression] = []
        for name, session in self._sessions.items():
            heard = partial(self._heard, name)
            remote = library_of(session).Locality.REMOTE
            pin(session, text)
            mine.append(session.declare_subscriber(text, heard, allowed_origin=remote))
        for name, sample in self._present(text) if again else ():
            self._token(name, sample, again=True)
        for name, session in self._sessions.items():
            # Not on a thread of its own: a key has to be known before the first message of its publisher comes.
            seen = library_of(session).handlers.Callback(partial(self._token, name, again=False), indirect=False)
            mine.append(session.liveliness().declare_subscriber(text, seen, history=True))
            self._search(name, text, again=again)

    def unwatch(self, expression: str) -> None:
        """End all proxies on an expression; call when its forwarders are closed and the junction still cuts it."""
        from riot_bus.zenoh import api as zenoh

        release(*self._watched.pop(expression, ()))
        rest = [zenoh.KeyExpr(each) for each in self._watched]
        with self._lock:
            gone = [key for key in self.keys if not any(each.includes(key) for each in rest)]
            states = [state for key in gone for state in self.keys[key].values()]
        for state in states:
            self._end(state)
        wait_until(lambda: not self._ending.intersection(states), _END_S)

    def close(self) -> None:
        """Send what is held and end everything; call when the forwarders are closed; safe to call twice."""
        self._closed = True
        for expression in list(self._watched):
            self.unwatch(expression)
        self._worker.close()

    def idle(self) -> bool:
        """Return whether nothing is under way."""
        return self._worker.idle() and not any(state.holds for state in self._states())

    def held(self) -> Counter[str]:
        """Return how many messages wait for others that have to be sent before them, by key."""
        total: Counter[str] = Counter()
        for state in self._states():
            total.update(state.held())
        return total

    # -- for forwarders and the delivery queue ------------------------------------------------------------------------

    def concerns(self, segment: str, key: str, sample: zenoh.Sample) -> bool:
        """Return whether messages of a key concern us; asked when a forwarder learns a key, not for each message."""
        if key not in self.keys and not self._closed:
            if sample.source_info is not None:  # it is numbered, but perhaps shows no token
                known = source_of(segment, sample)
                if known is not None:
                    self._state_for(known[0])
            else:
                now = time.monotonic()
                if now - self._asked.get((segment, key), -_END_S) >= _END_S:  # a key has only one query at a time
                    _remember(self._asked, (segment, key), now, _MOST_ASKED)
                    self._unasked.append((segment, key))
                    if not self._asking:
                        self._asking = True
                        self._worker.do(self._ask)
        return key in self.keys

    def take(self, segment: str, sample: zenoh.Sample) -> Message | None:
        """Take a live message of a key that concerns us; safe to call twice for the same one.

        Returns:
            The message, None if nothing is left to do with it.
        """
        message = self._deliveries.access.converters[segment](sample)
        known = source_of(segment, sample)
        state = self._state_for(known[0]) if known is not None else None
        if known is None or state is None:
            return message
        verdict = state.arrived(known[1], time.monotonic())
        if (on_first := state.on_first) is not None:
            on_first()
        if verdict.stored is not None:
            state.deliver(message.key, partial(self._send_stored, verdict.stored, message))
            return None
        if verdict.late:
            return message
        if verdict.lost is not None:
            self._mirror.recover(state, *verdict.lost)
        if verdict.check:
            self._mirror.check(state)
        state.busy = True
        return relayed(message, state)

    def through(self, message: Message) -> None:
        """Note that a message returned by `take` has been sent."""
        if isinstance(message, Relayed) and message.state is not None:
            message.state.busy = False

    def state_of(self, original: Message | None, message: Message) -> PublisherState | None:
        """Return the publisher to whose stream a message from the interceptors belongs; None if there is none.

        Args:
            original: Message that came in; None for a message that an interceptor added.
            message: A message that interceptors have let through.
        """
        here = self.keys.get(message.key)
        if not here:
            return None
        carrier = message if original is None else original
        if isinstance(carrier, Relayed) and carrier.state is not None:
            return carrier.state if carrier.state.source.key == message.key else None
        if original is not None:
            return None
        states = list(here.values())  # so that late joiners get what was added too
        return states[0] if len(states) == 1 else None

    def _send_stored(self, stored: Stored, live: Message) -> None:
        """Send a stored sample; unlike the cache's answer, the live message has its own QoS, and may be a delete."""
        try:
            for proxy, message, number, stamp in stored.places:
                kind = "delete" if live.kind == "delete" else message.kind
                proxy.send(message.with_(qos=live.qos, kind=kind), number, stamp)
        except Exception:
            _LOG.exception("a message of %s could not be published", live.key)
            self._deliveries.lose(live.key, "not published")
            return
        if stored.result is not None:
            self._deliveries.record(stored.result)

    # -- on threads of Zenoh's, which must not wait -------------------------------------------------------------------

    def _token(self, segment: str, sample: Any, *, again: bool) -> None:
        source = announced(segment, str(sample.key_expr))
        if source is None or source.zid in self._own:
            return
        if int(sample.kind) == 0:
            if not self._is_elsewhere(source):
                self._ended.pop(source, None)
                self._meet(source, again=again, token=True)
        elif (state := self.keys.get(source.key, {}).get(source)) is not None:
            self._end(state)

    def _present(self, text: str) -> list[tuple[str, Any]]:
        """Return segments and the tokens seen there; tokens of components that are connected there come first."""
        found = []
        for name, session in self._sessions.items():
            near = self._connected(name)
            for reply in session.liveliness().get(text, timeout=ANSWER_S):
                if reply.ok is not None:
                    source = announced(name, str(reply.ok.key_expr))
                    found.append((source is None or source.zid not in near, name, reply.ok))
        return [(name, sample) for _, name, sample in sorted(found, key=lambda each: each[0])]

    def _is_elsewhere(self, source: AdvancedSource) -> bool:
        """Return whether a token has come from another segment natively, as it does if it did before interception."""
        here = list(self.keys.get(source.key, ()))
        return any(known[1:] == source[1:] and known.segment != source.segment for known in here)

    def _connected(self, segment: str) -> set[str]:
        return {str(each.zid) for each in self._sessions[segment].info.transports()}

    def _published_by(self, key: str, zid: str) -> list[PublisherState]:
        return [state for source, state in list(self.keys.get(key, {}).items()) if source.zid == zid]

    def _heard(self, segment: str, sample: Any) -> None:
        self._worker.do(partial(self._beat, segment, sample))

    def _search(self, segment: str, selector: str, *, again: bool) -> None:
        """Find caches that show no token."""
        self._upstream.search(segment, f"{selector}?_max=1", partial(self._found, again=again))

    def _ask(self) -> None:
        """Query new keys, a few at a time: a query takes longer the more publishers there are."""
        began, took = time.monotonic(), 0.0
        for _ in range(min(_ASK_AT_ONCE, len(self._unasked))):
            segment, key = self._unasked.popleft()
            self._search(segment, f"{key}/@adv/pub/**", again=False)
            if (took := time.monotonic() - began) > _ASK_PAUSE_S / _ASK_REST:
                break  # Zenoh delays publications meanwhile
        self._asking = False
        if self._unasked:
            self._asking = True
            self._worker.later(max(_ASK_PAUSE_S, _ASK_REST * took), self._ask, background=True)

    def _state_for(self, source: AdvancedSource) -> PublisherState | None:
        state = self.keys.get(source.key, {}).get(source)
        if state is None and source.numbered and source not in self._ended and not self._closed:
            state = self._meet(source, again=False, token=False)
        return state

    def _meet(self, source: AdvancedSource, *, again: bool, token: bool) -> PublisherState | None:
        with self._lock:
            here = self.keys.get(source.key, {})
            if source in here and not here[source].ended:
                return here[source]
            if len(self.keys) >= _MOST_RELAYS or len(here) >= _MOST_RELAYS:
                return None
            self.keys[source.key] = here
            state = here[source] = PublisherState(source, again=again, token=token)
            self._worker.do(partial(self._answers.begin, source.key))
            self._mirror.open(state)
        self._changed()
        return state

    def _end(self, state: PublisherState) -> None:
        with self._lock:
            if state.ended:
                return
            state.ended = True
            self._ending.add(state)
        self._mirror.end(state, partial(self._gone, state))

    # -- on the worker's thread ---------------------------------------------------------------------------------------

    def _gone(self, state: PublisherState) -> None:
        source = state.source
        with self._lock:
            here = self.keys.get(source.key, {})
            if here.get(source) is state:
                del here[source]
                _remember(self._ended, source, None, _MOST_ENDED)
            if not here:
                self.keys.pop(source.key, None)
        if not here:
            self._answers.end(source.key)
        self._ending.discard(state)

    def _found(self, source: AdvancedSource, *, again: bool) -> None:
        if source.zid not in self._own and source not in self._ended:
            self._meet(source, again=again, token=False)

    def _beat(self, segment: str, sample: Any) -> None:
        from riot_bus.zenoh import api as zenoh
        from riot_bus.zenoh.api import ext

        source = announced(segment, str(sample.key_expr))
        state = self.keys.get(source.key, {}).get(source) if source is not None else None
        if state is not None:
            payload = zenoh.ZBytes(sample.payload.to_bytes())
            self._mirror.beat(state, int(ext.z_deserialize(ext.UInt32, payload)))

    def _tick(self) -> None:
        """Send heartbeats for publishers that do, and end those without a token whose session has left."""
        self._worker.later(_BEAT_S, self._tick, background=True)
        connected: dict[str, set[str]] = {}
        for state in self._states():
            if state.beats:
                self._mirror.beat(state, -1)
            if not state.token and not state.ended:
                segment, zid = state.source.segment, state.source.zid
                if segment not in connected:
                    connected[segment] = self._connected(segment)
                if zid in connected[segment]:
                    state.near = True
                elif state.near:
                    self._end(state)

    def _states(self) -> list[PublisherState]:
        with self._lock:
            return [state for here in self.keys.values() for state in here.values()]


def _remember(table: OrderedDict[Any, Any], key: Any, value: Any, most: int) -> None:
    """Store a value as the newest entry; the oldest is dropped when there are more than `most`."""
    table[key] = value
    table.move_to_end(key)
    if len(table) > most:
        table.popitem(last=False)
