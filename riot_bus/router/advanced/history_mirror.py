"""Synchronisation of proxies with the publishers' own caches: history, lost messages, and the depth of the cache.

All of this is done by a worker, one task after another for each publisher. A publisher's lock is only tried, not waited
for, since a lane may hold it for as long as a receiver is slow.
"""

from __future__ import annotations

import itertools
import logging
import math
import time
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.pipeline.runner import AbandonedError
from riot_bus.router.advanced.proxy_publisher import ProxyPublisher
from riot_bus.router.advanced.publisher_state import Task

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.router.advanced.publisher_state import PublisherState, Stored
    from riot_bus.router.advanced.upstream import CacheAnswer, Upstream
    from riot_bus.router.advanced.worker import Worker
    from riot_bus.router.delivery_queue import DeliveryQueue
    from riot_bus.zenoh import api as zenoh
    from riot_bus.zenoh.convert import Converter, Outlets

__all__ = ["HistoryMirror"]

_LOG = logging.getLogger(__name__)
_SETTLE_S = 0.05  # for lanes to take samples, and subscribers to query; live messages may wait meanwhile
_UNDER_WAY_S = 0.25  # 50 ms were not enough once in 180 runs on a busy machine
_LOOK_S = 0.01  # a look compares two numbers of each lane; `_MOST_LOOKS` make ten seconds
_MOST_LOOKS = (
    1000  # ten seconds: where interceptors are so slow that a lane never ends, late joiners shall not wait for it
)
_RECOVERED_S = 1.5  # three heartbeats of 0.5 s, to notice a gap and query; not measured
_PATIENCE_S = 0.005  # a slow receiver keeps the worker from other publishers for as long
_FAILURES = 3  # one or two queries may time out by chance, after 2 s each
_STAND_IN = 1 << 30  # fits into the 32 bits of an entity's id, far above those that a session counts up


class HistoryMirror:
    """Execution of the tasks of publishers.

    Args:
        sessions: The segments' own sessions.
        outlets: Outlets to publish to, by segment.
        converters: Converters of samples to messages, by segment.
        crossing: Queue that takes messages through the interceptors.
        worker: Worker that runs the tasks.
        upstream: Access to the publishers' caches.
        depth: Function that returns how many samples a publisher (key, id of its session) keeps, None if unknown.
        fence: Function that returns a test, asked twice, whether lanes have taken what came from a segment until then.
    """

    def __init__(
        self,
        sessions: Mapping[str, zenoh.Session],
        outlets: Mapping[str, Outlets],
        converters: Mapping[str, Converter],
        *,
        crossing: DeliveryQueue,
        worker: Worker,
        upstream: Upstream,
        depth: Callable[[str, str], int | None],
        fence: Callable[[str], Callable[[], bool]],
    ) -> None:
        self._sessions, self._outlets, self._converters = sessions, outlets, converters
        self._crossing, self._worker, self._upstream, self._hint = crossing, worker, upstream, depth
        self._fence = fence
        self._numbers = itertools.count(_STAND_IN)

    # -- tasks --------------------------------------------------------------------------------------------------------

    def open(self, relay: PublisherState) -> None:
        """Fetch the history and create the proxies; until then live messages wait."""
        fetch = partial(self._upstream.ask, relay.source, "", partial(self._step, relay, partial(self._fetched, relay)))
        self._add(relay, fetch, holds=True)

    def recover(self, relay: PublisherState, first: int, last: int) -> None:
        """Fetch messages that were lost on the way to us, before later ones are sent."""
        self._add(relay, partial(self._recover, relay, first, last), holds=True)

    def check(self, relay: PublisherState) -> None:
        """Find out how many samples a publisher keeps: as many as it has once the first one is gone."""
        self._add(relay, partial(self._check, relay), holds=False)

    def beat(self, relay: PublisherState, told: int) -> None:
        """Process a heartbeat; called by the worker.

        Args:
            relay: State of the publisher.
            told: Number of the last sample, according to the heartbeat.
        """
        relay.beats = True
        before = relay.last
        if before is not None and told > before:
            # It may have overtaken samples that are still in a lane, whose progress with one key is not known.
            self._worker.later(_SETTLE_S, partial(self._locked, relay, partial(self._behind, relay, before, told)))
        else:
            self._locked(relay, relay.beat)

    def end(self, relay: PublisherState, then: Callable[[], None]) -> None:
        """Remove everything for a publisher, once earlier tasks are done."""

        def close() -> None:
            relay.close()
            then()
            self._finish(relay)

        self._add(relay, partial(self._locked, relay, close), holds=False)

    # -- how tasks are carried out ------------------------------------------------------------------------------------

    def _add(self, relay: PublisherState, run: Callable[[], None], *, holds: bool) -> None:
        if holds:
            relay.hold()
        relay.tasks.append(Task(run, holds))
        self._worker.do(partial(self._next, relay))

    def _next(self, relay: PublisherState) -> None:
        if relay.task is None and relay.tasks:
            relay.task = relay.tasks.popleft()
            self._step(relay, relay.task.run)

    def _step(self, relay: PublisherState, action: Callable[..., None], *arguments: Any) -> None:
        try:
            action(*arguments)
        except AbandonedError:
            raise
        except Exception:
            _LOG.exception("the advanced publisher %s could not be looked after", relay.source)
            self._locked(relay, partial(self._checked, relay))

    def _locked(self, relay: PublisherState, action: Callable[..., None], *arguments: Any) -> None:
        if not relay.lock.acquire(timeout=_PATIENCE_S):
            self._worker.later(_PATIENCE_S, partial(self._locked, relay, action, *arguments))
            return
        try:
            self._step(relay, action, *arguments)
        finally:
            relay.lock.release()

    def _finish(self, relay: PublisherState) -> None:
        task, relay.task = relay.task, None
        if task is not None and task.holds:
            relay.let_go()
        if relay.overdue():  # messages have come since it was asked, or while they were held
            self.check(relay)
        self._worker.do(partial(self._next, relay))

    # -- history ------------------------------------------------------------------------------------------------------

    def _fetched(self, relay: PublisherState, found: CacheAnswer) -> None:
        adopt = partial(self._locked, relay, _once(partial(self._adopt, relay, found)))
        with relay.lock:  # nobody publishes yet, so nobody holds it for long
            wait = bool(found.samples) and relay.first is None and not relay.ended
            relay.waiting = partial(self._worker.do, adopt) if wait else None
        if wait:
            # Samples published just now are also in a lane, and then are no history. How long they take to come in is
            # not known, nor whether there are any; samples that come even later are recognised by their numbers.
            taken = self._fence(relay.source.segment)
            self._worker.later(_UNDER_WAY_S, partial(self._adopt_behind, relay, taken, adopt, 0, _MOST_LOOKS))
        else:
            adopt()

    def _adopt_behind(
        self, relay: PublisherState, taken: Callable[[], bool], adopt: Callable[[], None], seen: int, left: int
    ) -> None:
        """Adopt the history once lanes have taken what came in before it, which may take long on a busy machine.

        Args:
            relay: State of the publisher.
            taken: Function that returns whether they have.
            adopt: Function that adopts it; not needed any more when the first live sample has come.
            seen: Number of times in a row that they had.
            left: Number of checks that are left.
        """
        if relay.waiting is None:
            return
        seen = seen + 1 if taken() else 0
        if seen > 1 or not left:
            adopt()
        else:
            again = partial(self._adopt_behind, relay, taken, adopt, seen, left - 1)
            self._worker.later(_LOOK_S, again)

    def _adopt(self, relay: PublisherState, found: CacheAnswer) -> None:
        relay.waiting, source, samples = None, relay.source, found.samples
        first = math.inf if relay.first is None else relay.first
        depth = self._hint(source.key, source.zid)
        if not found.asked:
            depth = 0
        elif depth is None and found.complete and samples and samples[0][0] > (0 if source.numbered else first):
            depth = len(samples)  # what was before them is gone
        relay.depth = depth
        for name, session in self._sessions.items():
            if name != source.segment:
                relay.outlets[name] = ProxyPublisher(self._outlets[name], session, source.key, depth)
        history = [each for each in samples if relay.first is None or each[0] < relay.first]
        self._feed(relay, history, partial(self._opened, relay, bool(history)))

    def _opened(self, relay: PublisherState, history: bool) -> None:  # noqa: FBT001
        relay.opened = True
        for standin in relay.outlets.values() if relay.token else ():
            standin.announce(next(self._numbers), again=relay.again)
        if history and relay.token and not relay.again:
            # A subscriber that queries the history because of the token refuses it once a live message has come.
            self._worker.later(_SETTLE_S, partial(self._locked, relay, partial(self._finish, relay)))
        else:
            self._finish(relay)

    def _feed(self, relay: PublisherState, samples: list[tuple[int, Any]], then: Callable[[], None]) -> None:
        claimed = deque((relay.claim(number), sample) for number, sample in samples)
        self._worker.do(partial(self._step, relay, partial(self._feed_next, relay, claimed, then)))

    def _feed_next(self, relay: PublisherState, claimed: deque[tuple[Stored, Any]], then: Callable[[], None]) -> None:
        """Take one sample through the interceptors, without the lock: they may block, and then this is done again."""
        if not claimed:
            self._locked(relay, then)
            return
        stored, sample = claimed[0]
        message = self._converters[relay.source.segment](sample)
        stored.result = self._crossing.replay(message, self._worker)
        claimed.popleft()
        more = partial(self._worker.do, partial(self._step, relay, partial(self._feed_next, relay, claimed, then)))
        self._locked(relay, partial(self._put_away, relay, stored, sample.timestamp, more))

    def _put_away(self, relay: PublisherState, stored: Stored, stamp: Any, then: Callable[[], None]) -> None:
        assert stored.result is not None
        for emission in stored.result.emissions:
            for name in self._crossing.targets_of(emission):
                if (standin := relay.outlets.get(name)) is not None:
                    number = standin.store(emission.message, stamp)
                    stored.places.append((standin, emission.message, number, stamp))
        then()

    # -- what was lost ------------------------------------------------------------------------------------------------

    def _behind(self, relay: PublisherState, before: int, told: int) -> None:
        if relay.busy:
            self._worker.later(_SETTLE_S, partial(self._locked, relay, partial(self._behind, relay, before, told)))
        elif relay.last == before and not relay.ended:
            relay.last = told
            self.recover(relay, before + 1, told)

    def _recover(self, relay: PublisherState, first: int, last: int) -> None:
        if relay.depth == 0:
            self._locked(relay, partial(self._skipped, relay, last - first + 1))
        else:
            then = partial(self._locked, relay, partial(self._recovered, relay))
            self._upstream.ask(relay.source, f"?_sn={first}..{last}", then)

    def _skipped(self, relay: PublisherState, numbers: int) -> None:
        relay.skip(numbers)
        self._finish(relay)
        if relay.beats:
            relay.beat()

    def _recovered(self, relay: PublisherState, found: CacheAnswer) -> None:
        self._feed(relay, found.samples, partial(self._stored, relay))

    def _stored(self, relay: PublisherState) -> None:
        relay.check_from = time.monotonic() + _RECOVERED_S  # not before present subscribers have recovered it from us
        relay.checking = True
        self._worker.later(_RECOVERED_S, partial(self.check, relay), background=True)
        self._finish(relay)
        if relay.beats:
            relay.beat()

    # -- depth --------------------------------------------------------------------------------------------------------

    def _check(self, relay: PublisherState) -> None:
        source = relay.source
        if relay.depth is not None or relay.ended:
            self._locked(relay, partial(self._checked, relay))
        elif source.numbered:
            then = partial(self._step, relay, partial(self._first, relay))
            self._upstream.ask(source, f"?_sn={relay.first}..{relay.first}", then)
        else:
            self._upstream.ask(source, "", partial(self._locked, relay, partial(self._measured, relay)))

    def _first(self, relay: PublisherState, found: CacheAnswer) -> None:
        if found.samples:
            self._locked(relay, partial(self._checked, relay))
        else:
            self._upstream.ask(relay.source, "", partial(self._locked, relay, partial(self._measured, relay)))

    def _measured(self, relay: PublisherState, found: CacheAnswer) -> None:
        """Take over the depth; 0 if a cache never answers, as late joiners would not have got anything either."""
        relay.failures = 0 if found.complete else relay.failures + 1
        first, samples = relay.first, found.samples
        gone = first is not None and not (samples and samples[0][0] <= first)
        if relay.failures >= _FAILURES:
            relay.resize(0)
        elif found.complete and gone and not relay.ended:
            relay.resize(len(samples))
        self._checked(relay)

    def _checked(self, relay: PublisherState) -> None:
        relay.checking = False  # also after a failure: then the next message asks again
        self._finish(relay)


def _once(action: Callable[[], None]) -> Callable[[], None]:
    """Return a function that runs an action only the first time; for one thread."""
    left = [action]

    def run() -> None:
        if left:
            left.pop()()

    return run
