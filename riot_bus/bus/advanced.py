"""Advanced publishers (caches, recovery, late joiners) on intercepted keys: ended here, played again over there.

In every other segment an advanced publisher of ours keeps the cache, with its own sequence numbers. Its destination is
its own session, so nobody hears what is put into it; what is to be heard goes out through a plain publisher under the
same number. So history can be stored without reaching live subscribers a second time.

Not wired into the bus yet; docs/advanced-pubsub.md says how.
"""

from __future__ import annotations

import itertools
import logging
import math
import queue
import threading
import time
from collections import OrderedDict, deque
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from riot_bus.bus.runtime import release

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    import zenoh

    from riot_bus.bus.convert import Outlets
    from riot_bus.message import Message

__all__ = ["Source", "Terminator"]

_LOG = logging.getLogger(__name__)
_DEEP = 1 << 20
_REMEMBERED = 1 << 14
_TIMEOUT_S = 2.0
_BEAT_S = 0.5
_SETTLE_S = 0.05
_LATER_S = 1.5
_NAP_S = 0.001
_STAND_IN = 1 << 30


class Source(NamedTuple):
    """An advanced publisher of a component; `entity` is `uhlc` if it does not number its samples."""

    segment: str
    key: str
    zid: str
    entity: str


class _Outlet:
    """Stands in one segment for an advanced publisher of another; calls are serialised by its relay."""

    def __init__(self, outlets: Outlets, session: zenoh.Session, key: str, depth: int | None) -> None:
        self.session, self.key, self._outlets = session, key, outlets
        self.quiet = False  # a beat would make present subscribers fetch what they have had already
        self._kept: deque[tuple[Message, Any]] = deque()
        self._token: Any = None
        self._declare(depth)

    def _declare(self, depth: int | None) -> None:
        import zenoh
        from zenoh import ext

        self._cache: Any = ext.declare_advanced_publisher(
            self.session,
            self.key,
            cache=None if depth == 0 else ext.CacheConfig(depth or _DEEP),
            sample_miss_detection=ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
            allowed_destination=zenoh.Locality.SESSION_LOCAL,
        )
        self._depth, self._next, self._beaten = depth, 0, 0
        self._suffix = f"{self.key}/@adv/pub/{self._cache.id.zid}/{self._cache.id.eid}/_"

    def announce(self, number: int, *, again: bool) -> None:
        """Show a token; `again`: those who subscribe already have had the history, so it does not lead to it."""
        self.quiet = again
        key = f"{self.key}/@adv/pub/{self._cache.id.zid}/{number}/_" if again else self._suffix
        self._token = self.session.liveliness().declare_token(key)

    def store(self, message: Message, stamp: Any) -> int:
        """Put into the cache alone; return the number."""
        if message.kind == "delete":
            self._cache.delete(attachment=message.attachment, timestamp=stamp)
        else:
            encoding = self._outlets.encoding(message.encoding)
            self._cache.put(message.payload, encoding=encoding, attachment=message.attachment, timestamp=stamp)
        if self._depth is None:
            self._kept.append((message, stamp))
        self._next += 1
        return self._next - 1

    def send(self, message: Message, number: int, stamp: Any) -> None:
        """Publish what was stored."""
        import zenoh

        publisher = self._outlets.publisher(message.key, message.qos)
        info = zenoh.SourceInfo(self._cache.id, number)
        if message.kind == "delete":
            publisher.delete(attachment=message.attachment, timestamp=stamp, source_info=info)
        else:
            encoding = self._outlets.encoding(message.encoding)
            publisher.put(
                message.payload, encoding=encoding, attachment=message.attachment, timestamp=stamp, source_info=info
            )
        self.quiet = False

    def publish(self, message: Message) -> None:
        """Store and send."""
        stamp = self.session.new_timestamp()
        self.send(message, self.store(message, stamp), stamp)

    def beat(self) -> None:
        """Tell the last number, if it has changed."""
        import zenoh
        from zenoh import ext

        if self._next != self._beaten and not self.quiet:
            self._beaten = self._next
            number: Any = ext.UInt32(self._next - 1)
            block = zenoh.CongestionControl.BLOCK
            self.session.put(self._suffix, ext.z_serialize(number), congestion_control=block)

    def resize(self, depth: int) -> None:
        """Keep only the last samples from now on: another cache, which present subscribers shall not ask."""
        kept, self._kept = list(self._kept)[-depth:] if depth else [], deque()
        release(self._cache)
        self._declare(depth)
        self.quiet = True
        for message, stamp in kept:
            self.store(message, stamp)

    def close(self) -> None:
        release(*[each for each in (self._token, self._cache) if each is not None])


class _Relay:
    """What is known of one advanced publisher."""

    def __init__(self, source: Source, *, again: bool, token: bool) -> None:
        self.source, self.again, self.token = source, again, token
        self.lock = threading.RLock()
        self.outlets: dict[str, _Outlet] = {}
        self.holds = 1  # reasons to hold messages back
        self.pending: list[tuple[str, Message]] = []
        self.early: dict[int, list[tuple[_Outlet, Message, int, Any]]] = {}  # stored, but perhaps still to be sent
        self.first: int | None = None
        self.last: int | None = None
        self.depth: int | None = None
        self.check_at = math.inf
        self.ended = self.checking = self.beats = False


class Terminator:
    """Detects advanced publishers on intercepted keys and stands in for them in the other segments.

    Args:
        sessions: The segments' own sessions.
        outlets: Where to publish, by segment.
        convert: Makes messages of samples, by segment.
        replay: Takes a message of a history through the interceptors, and returns what to store in which segments.
        changed: Called, on a thread that must not be held up, when another key has got an advanced publisher.
        depth: Returns how many samples a publisher (key, id of its session) keeps, None if unknown.
    """

    def __init__(
        self,
        sessions: Mapping[str, zenoh.Session],
        outlets: Mapping[str, Outlets],
        convert: Mapping[str, Callable[[zenoh.Sample], Message]],
        *,
        replay: Callable[[Message], Iterable[tuple[Message, Iterable[str]]]],
        changed: Callable[[], None] = lambda: None,
        depth: Callable[[str, str], int | None] = lambda key, zid: None,
    ) -> None:
        self._sessions, self._outlets, self._convert = sessions, outlets, convert
        self._replay, self._changed, self._hint = replay, changed, depth
        self._own = {str(session.info.zid()) for session in sessions.values()}
        self._by_key: dict[str, dict[Source, _Relay]] = {}
        self._lock = threading.Lock()
        self._watched: dict[str, list[Any]] = {}
        self._origins: OrderedDict[int, _Relay | None] = OrderedDict()
        self._numbers = itertools.count(_STAND_IN)
        self._jobs: queue.Queue[Callable[[], None] | None] = queue.Queue()
        self._thread = threading.Thread(target=self._run, name="riot-advanced", daemon=True)
        self._thread.start()

    # -- for the owner ------------------------------------------------------------------------------------------------

    def watch(self, expression: str, *, again: bool) -> None:
        """Look after an intercepted expression; call once the junction cuts it and the lanes receive.

        Args:
            expression: Canonical key expression.
            again: Its messages crossed natively until now, so subscribers have had the caches' content.
        """
        import zenoh

        remote, text = zenoh.Locality.REMOTE, f"{expression}/@adv/pub/**"
        mine = self._watched[expression] = []
        for name, session in self._sessions.items():
            heard = partial(self._heard, name)
            mine.append(session.declare_subscriber(text, heard, allowed_origin=remote))
            for reply in session.liveliness().get(text, timeout=_TIMEOUT_S):
                if reply.ok is not None:
                    self._token(name, reply.ok, again=again)
            # Not on a thread of its own: a key has to be known before the first message of its publisher comes.
            seen = zenoh.handlers.Callback(partial(self._token, name, again=False), indirect=False)
            mine.append(session.liveliness().declare_subscriber(text, seen, history=True))
            self._jobs.put(partial(self._discover, name, text, again=again))

    def unwatch(self, expression: str) -> None:
        """End all that stands in on an expression; call before the junction lets it pass."""
        import zenoh

        release(*self._watched.pop(expression, ()))
        rest = [zenoh.KeyExpr(each) for each in self._watched]
        with self._lock:
            gone = [key for key in self._by_key if not any(each.includes(key) for each in rest)]
            relays = [relay for key in gone for relay in self._by_key.pop(key).values()]
        for relay in relays:
            self._jobs.put(partial(self._end, relay))

    def close(self) -> None:
        """End everything; call before the sessions close."""
        for expression in list(self._watched):
            self.unwatch(expression)
        self._jobs.put(None)
        self._thread.join()

    def outlet_for(self, segment: str, sample: zenoh.Sample) -> bool:
        """Return whether messages of a sample's key concern us; asked when a lane learns a key, not for each one."""
        key = str(sample.key_expr)
        if key not in self._by_key:
            if sample.source_info is not None:  # it is numbered, but shows no token
                self._meet(_source(segment, sample)[0], again=False, token=False)
            else:
                self._jobs.put(partial(self._discover, segment, f"{key}/@adv/pub/**", again=False))
        return key in self._by_key

    def took(self, segment: str, sample: zenoh.Sample, sequence: int) -> bool:
        """Take note of a message of a key that concerns us; return False if nothing is left to do with it.

        Args:
            segment: Where it came from.
            sample: What came.
            sequence: Number of its message.
        """
        source, number = _source(segment, sample)
        relay = self._by_key.get(source.key, {}).get(source)
        if relay is None and source.entity != "uhlc":
            relay = self._meet(source, again=False, token=False)
        self._origins[sequence] = relay
        if len(self._origins) > _REMEMBERED:
            self._origins.popitem(last=False)
        if relay is None:
            return True
        with relay.lock:
            known, before = relay.early.pop(number, None), relay.last
            if relay.first is None:
                relay.first = number
            relay.last = number if before is None else max(before, number)
            if known is not None:
                live = self._convert[segment](sample)  # unlike a reply, it has its own QoS
                for outlet, message, place, stamp in known:
                    kind = live.kind if live.kind == "delete" else message.kind
                    outlet.send(message.with_(qos=live.qos, kind=kind), place, stamp)
                return False
            if relay.early and number > max(relay.early):
                relay.early.clear()
            elif relay.early and not relay.holds:  # a lane was very late: as an unnumbered message it is not refused
                self._origins[sequence] = None
                return True
            if source.entity != "uhlc" and before is not None and number > before + 1:
                relay.holds += 1
                self._jobs.put(partial(self._recover, relay, before + 1, number - 1))
            if relay.depth is None and not relay.checking and not relay.holds:
                relay.checking = True
                self._jobs.put(partial(self._check, relay))
        return True

    def publish(self, segment: str, message: Message) -> bool:
        """Publish in a segment what came out of the interceptors; False if it is a message like any other."""
        here = self._by_key.get(message.key)
        if here is None:
            return False
        if message.sequence in self._origins:
            relay = self._origins.get(message.sequence)
        else:  # somebody added it: to the stream of the only publisher, so that late joiners get it too
            others = [each for each in list(here.values()) if each.source.segment != segment]
            relay = others[0] if len(others) == 1 else None
        if relay is None or relay.source.key != message.key or relay.source.segment == segment:
            return False
        with relay.lock:
            if relay.holds:
                relay.pending.append((segment, message))
                return True
            if segment not in relay.outlets:
                return False
            relay.outlets[segment].publish(message)
            return True

    # -- on threads of Zenoh's, which must not wait -------------------------------------------------------------------

    def _token(self, segment: str, sample: Any, *, again: bool) -> None:
        key, _, rest = str(sample.key_expr).rpartition("/@adv/pub/")
        zid, entity = rest.split("/")[:2]
        if zid not in self._own:
            source = Source(segment, key, zid, entity)
            if int(sample.kind) == 0:
                self._meet(source, again=again, token=True)
            elif (relay := self._by_key.get(key, {}).get(source)) is not None:
                relay.ended = True
                self._jobs.put(partial(self._end, relay))

    def _heard(self, segment: str, sample: Any) -> None:
        self._jobs.put(partial(self._beat, segment, sample))

    def _meet(self, source: Source, *, again: bool, token: bool) -> _Relay:
        with self._lock:
            here = self._by_key.setdefault(source.key, {})
            if source in here and not here[source].ended:
                return here[source]
            relay = here[source] = _Relay(source, again=again, token=token)
        self._jobs.put(partial(self._open, relay))
        self._changed()
        return relay

    # -- on our thread ------------------------------------------------------------------------------------------------

    def _run(self) -> None:
        due = 0.0
        while True:
            try:
                job = self._jobs.get(timeout=_BEAT_S)
                if job is None:
                    return
                job()
            except queue.Empty:
                pass
            except Exception:
                _LOG.exception("an advanced publisher could not be looked after")
            if time.monotonic() >= due:
                due = time.monotonic() + _BEAT_S
                for relay in [each for here in list(self._by_key.values()) for each in list(here.values())]:
                    with relay.lock:
                        for outlet in relay.outlets.values() if relay.beats else ():
                            outlet.beat()
                    if time.monotonic() >= relay.check_at:
                        relay.check_at = math.inf
                        self._jobs.put(partial(self._check, relay))

    def _fetch(self, segment: str, selector: str) -> list[tuple[Source, int, Any]]:
        import zenoh

        replies = self._sessions[segment].get(
            selector,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            allowed_destination=zenoh.Locality.REMOTE,
            timeout=_TIMEOUT_S,
        )
        found = [(*_source(segment, reply.ok), reply.ok) for reply in replies if reply.ok is not None]
        return sorted(found, key=lambda each: each[1])

    def _samples(self, source: Source, parameters: str = "") -> list[tuple[int, Any]]:
        found = self._fetch(source.segment, f"{source.key}/@adv/pub/{source.zid}/{source.entity}/**{parameters}")
        return [(number, sample) for _, number, sample in found]

    def _discover(self, segment: str, expression: str, *, again: bool) -> None:
        """Find caches that show no token."""
        for source, _, _ in self._fetch(segment, expression):
            if source.zid not in self._own:
                self._meet(source, again=again, token=False)

    def _open(self, relay: _Relay) -> None:
        self._open_with(relay, self._samples(relay.source), time.monotonic() + _SETTLE_S)

    def _open_with(self, relay: _Relay, samples: list[tuple[int, Any]], deadline: float) -> None:
        if samples and relay.first is None and time.monotonic() < deadline:
            time.sleep(_NAP_S)  # what was just published is on its way through a lane too, and is no history then
            self._jobs.put(partial(self._open_with, relay, samples, deadline))
            return
        source, depth = relay.source, self._hint(relay.source.key, relay.source.zid)
        with relay.lock:
            if samples:
                if depth is None and source.entity != "uhlc" and samples[0][0] > 0:
                    depth = len(samples)
                samples = [each for each in samples if relay.first is None or each[0] < relay.first]
            relay.depth = depth
            for name, session in self._sessions.items():
                if name != source.segment:
                    relay.outlets[name] = _Outlet(self._outlets[name], session, source.key, depth)
            self._store(relay, samples)
            for outlet in relay.outlets.values():
                if relay.token:
                    outlet.announce(next(self._numbers), again=relay.again)
            self._let_go(relay)

    def _store(self, relay: _Relay, samples: list[tuple[int, Any]]) -> None:
        for number, sample in samples:
            relay.first = number if relay.first is None else min(relay.first, number)
            relay.last = number if relay.last is None else max(relay.last, number)
            stored = relay.early[number] = []
            for message, targets in self._replay(self._convert[relay.source.segment](sample)):
                outlets = [relay.outlets[name] for name in targets if name in relay.outlets]
                stamp = sample.timestamp
                stored.extend((each, message, each.store(message, stamp), stamp) for each in outlets)

    def _let_go(self, relay: _Relay) -> None:
        relay.holds -= 1
        if not relay.holds:
            pending, relay.pending = relay.pending, []
            for name, message in pending:
                (relay.outlets.get(name) or self._outlets[name]).publish(message)

    def _recover(self, relay: _Relay, first: int, last: int) -> None:
        """Fetch what was lost on the way to us, before what came after it is let go."""
        samples = self._samples(relay.source, f"?_sn={first}..{last}")
        with relay.lock:
            self._store(relay, samples)
            self._let_go(relay)
            relay.check_at = time.monotonic() + _LATER_S  # not before present subscribers have recovered it from us

    def _check(self, relay: _Relay) -> None:
        """Find out how many samples a publisher keeps: as many as it has once the first one is gone."""
        relay.checking = False
        if relay.depth is not None or relay.ended:
            return
        source, first = relay.source, relay.first
        if source.entity != "uhlc" and self._samples(source, f"?_sn={first}..{first}"):
            return
        samples = self._samples(source)
        if first is None or (samples and samples[0][0] <= first):
            return
        with relay.lock:
            relay.depth = len(samples)
            for outlet in relay.outlets.values():
                outlet.resize(relay.depth)

    def _beat(self, segment: str, sample: Any) -> None:
        from zenoh import ext

        key, _, rest = str(sample.key_expr).rpartition("/@adv/pub/")
        zid, entity = rest.split("/")[:2]
        relay = self._by_key.get(key, {}).get(Source(segment, key, zid, entity))
        if relay is None:
            return
        relay.beats = True
        told, before = int(ext.z_deserialize(ext.UInt32, sample.payload)), relay.last
        if before is None or told <= before:
            return
        time.sleep(_SETTLE_S)  # it may have overtaken what a lane has not come to yet
        with relay.lock:
            if relay.last == before:
                relay.holds += 1
                self._recover(relay, before + 1, told)

    def _end(self, relay: _Relay) -> None:
        """The publisher has gone, and its cache with it."""
        source = relay.source
        with self._lock:
            here = self._by_key.get(source.key, {})
            if here.get(source) is relay:
                del here[source]
            if not here:
                self._by_key.pop(source.key, None)
        with relay.lock:
            for outlet in relay.outlets.values():
                outlet.close()
            relay.outlets.clear()


def _source(segment: str, sample: Any) -> tuple[Source, int]:
    """Return who published a sample, and its place in order."""
    info, stamp, key = sample.source_info, sample.timestamp, str(sample.key_expr)
    if info is not None:
        return Source(segment, key, str(info.source_id.zid), str(info.source_id.eid)), info.source_sn
    return Source(segment, key, str(stamp.get_id()), "uhlc"), stamp.get_time_as_ntp64().as_nanos()
