"""Synchronisation of proxies with the publishers' own caches: history, lost messages, and the depth of the cache.

All of this is done by a worker, one task after another for each publisher. A publisher's lock is only tried, not waited
for, since a forwarder may hold it for as long as a receiver is slow.
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
    from collections.abc import Callable

    from riot_bus.router.advanced.publisher_state import PublisherState, Stored
    from riot_bus.router.advanced.upstream import CacheAnswer, Upstream
    from riot_bus.router.delivery_queue import DeliveryQueue
    from riot_bus.router.worker import Worker

_LOG = logging.getLogger(__name__)
_SETTLE_S = 0.05  # for forwarders to take samples, and subscribers to query; live messages may wait meanwhile
_UNDER_WAY_S = 0.25  # 50 ms were not enough once in 180 runs on a busy machine
_LOOK_S = 0.01  # a look compares two numbers of each forwarder; `_MOST_LOOKS` make ten seconds
_MOST_LOOKS = (
    1000  # ten seconds: where interceptors are so slow that a forwarder never ends, late joiners shall not wait for it
)
_RECOVERED_S = 1.5  # three heartbeats of 0.5 s, to notice a gap and query; not measured
_PATIENCE_S = 0.005  # a slow receiver keeps the worker from other publishers for as long
_FAILURES = 3  # one or two queries may time out by chance, after 2 s each


class HistoryMirror:
    """Execution of the tasks of publishers.

    Args:
        fence: Function that returns a test, to be asked twice, whether forwarders have taken all that has come from a
            segment.
    """

    def __init__(
        self,
        deliveries: DeliveryQueue,
        *,
        worker: Worker,
        upstream: Upstream,
        fence: Callable[[str], Callable[[], bool]],
    ) -> None:
        self._deliveries, self._worker, self._upstream, self._fence = deliveries, worker, upstream, fence
        self._numbers = itertools.count(1 << 30)  # 32 bits are room for this, far above what a session counts up to

    # -- tasks --------------------------------------------------------------------------------------------------------

    def open(self, state: PublisherState) -> None:
        """Fetch the history and create the proxies; until then live messages wait."""
        fetch = partial(self._upstream.ask, state.source, "", partial(self._step, state, partial(self._fetched, state)))
        self._add(state, fetch, holds=True)

    def recover(self, state: PublisherState, first: int, last: int) -> None:
        """Fetch messages that were lost on the way to us, before later ones are sent."""
        self._add(state, partial(self._recover, state, first, last), holds=True)

    def check(self, state: PublisherState) -> None:
        """Find out how many samples a publisher keeps: as many as it has once the first one is gone."""
        self._add(state, partial(self._check, state), holds=False)

    def beat(self, state: PublisherState, told: int) -> None:
        """Process a heartbeat; called by the worker.

        Args:
            state: State of the publisher.
            told: Number of the last sample, according to the heartbeat.
        """
        state.beats = True
        before = state.last
        if before is not None and told > before:
            # It may have overtaken samples that are still in a forwarder, whose progress with one key is not known.
            self._worker.later(_SETTLE_S, partial(self._locked, state, partial(self._behind, state, before, told)))
        else:
            self._locked(state, state.beat)

    def end(self, state: PublisherState, then: Callable[[], None]) -> None:
        """Remove everything for a publisher, once earlier tasks are done."""

        def close() -> None:
            state.close()
            then()
            self._finish(state)

        self._add(state, partial(self._locked, state, close), holds=False)

    # -- how tasks are carried out ------------------------------------------------------------------------------------

    def _add(self, state: PublisherState, run: Callable[[], None], *, holds: bool) -> None:
        if holds:
            state.hold()
        state.tasks.append(Task(run, holds))
        self._worker.do(partial(self._next, state))

    def _next(self, state: PublisherState) -> None:
        if state.task is None and state.tasks:
            state.task = state.tasks.popleft()
            self._step(state, state.task.run)

    def _step(self, state: PublisherState, action: Callable[..., None], *arguments: Any) -> None:
        try:
            action(*arguments)
        except AbandonedError:
            raise
        except Exception:
            _LOG.exception("the advanced publisher %s could not be looked after", state.source)
            self._locked(state, partial(self._checked, state))

    def _locked(self, state: PublisherState, action: Callable[..., None], *arguments: Any) -> None:
        if not state.lock.acquire(timeout=_PATIENCE_S):
            self._worker.later(_PATIENCE_S, partial(self._locked, state, action, *arguments))
            return
        try:
            self._step(state, action, *arguments)
        finally:
            state.lock.release()

    def _finish(self, state: PublisherState) -> None:
        task, state.task = state.task, None
        if task is not None and task.holds:
            state.let_go()
        if state.overdue():  # messages have come since it was asked, or while they were held
            self.check(state)
        self._worker.do(partial(self._next, state))

    # -- history ------------------------------------------------------------------------------------------------------

    def _fetched(self, state: PublisherState, found: CacheAnswer) -> None:
        adopt = partial(self._locked, state, _once(partial(self._adopt, state, found)))
        with state.lock:  # no thread publishes yet, so the lock is not held for long
            wait = bool(found.samples) and state.first is None and not state.ended
            state.on_first = partial(self._worker.do, adopt) if wait else None
        if wait:
            # Samples published just now are also in a forwarder, and then are not history. How long they take to come
            # in is not known, nor whether there are any; samples that come later are recognised by their numbers.
            taken = self._fence(state.source.segment)
            self._worker.later(_UNDER_WAY_S, partial(self._adopt_behind, state, taken, adopt, 0, _MOST_LOOKS))
        else:
            adopt()

    def _adopt_behind(
        self, state: PublisherState, taken: Callable[[], bool], adopt: Callable[[], None], seen: int, left: int
    ) -> None:
        """Adopt the history once forwarders have taken what came in before it, which may take long."""
        if state.on_first is None:
            return
        seen = seen + 1 if taken() else 0
        if seen > 1 or not left:
            adopt()
        else:
            again = partial(self._adopt_behind, state, taken, adopt, seen, left - 1)
            self._worker.later(_LOOK_S, again)

    def _adopt(self, state: PublisherState, found: CacheAnswer) -> None:
        state.on_first, source, samples = None, state.source, found.samples
        first = math.inf if state.first is None else state.first
        depth = None if found.asked else 0
        if found.asked and found.complete and samples and samples[0][0] > (0 if source.numbered else first):
            depth = len(samples)  # what was before them is gone
        state.depth = depth
        for name, session in self._deliveries.access.sessions.items():
            if name != source.segment:
                state.outlets[name] = ProxyPublisher(self._deliveries.access.outlets[name], session, source.key, depth)
        history = [each for each in samples if state.first is None or each[0] < state.first]
        self._feed(state, history, partial(self._opened, state, bool(history)))

    def _opened(self, state: PublisherState, history: bool) -> None:  # noqa: FBT001
        state.opened = True
        for proxy in state.outlets.values() if state.token else ():
            proxy.announce(next(self._numbers), again=state.again)
        if history and state.token and not state.again:
            # A subscriber that queries the history because of the token refuses it once a live message has come.
            self._worker.later(_SETTLE_S, partial(self._locked, state, partial(self._finish, state)))
        else:
            self._finish(state)

    def _feed(self, state: PublisherState, samples: list[tuple[int, Any]], then: Callable[[], None]) -> None:
        claimed = deque((state.claim(number), sample) for number, sample in samples)
        self._worker.do(partial(self._step, state, partial(self._feed_next, state, claimed, then)))

    def _feed_next(self, state: PublisherState, claimed: deque[tuple[Stored, Any]], then: Callable[[], None]) -> None:
        """Take one sample through the interceptors, without the lock: they may block, and then this is done again."""
        if not claimed:
            self._locked(state, then)
            return
        stored, sample = claimed[0]
        message = self._deliveries.access.converters[state.source.segment](sample)
        stored.result = self._deliveries.replay(message, self._worker)
        claimed.popleft()
        more = partial(self._worker.do, partial(self._step, state, partial(self._feed_next, state, claimed, then)))
        self._locked(state, partial(self._put_away, state, stored, sample.timestamp, more))

    def _put_away(self, state: PublisherState, stored: Stored, stamp: Any, then: Callable[[], None]) -> None:
        assert stored.result is not None
        for emission in stored.result.emissions:
            for name in self._deliveries.targets_of(emission):
                if (proxy := state.outlets.get(name)) is not None:
                    number = proxy.store(emission.message, stamp)
                    stored.places.append((proxy, emission.message, number, stamp))
        then()

    # -- what was lost ------------------------------------------------------------------------------------------------

    def _behind(self, state: PublisherState, before: int, told: int) -> None:
        if state.busy:
            self._worker.later(_SETTLE_S, partial(self._locked, state, partial(self._behind, state, before, told)))
        elif state.last == before and not state.ended:
            state.last = told
            self.recover(state, before + 1, told)

    def _recover(self, state: PublisherState, first: int, last: int) -> None:
        if state.depth == 0:
            self._locked(state, partial(self._skipped, state, last - first + 1))
        else:
            then = partial(self._locked, state, partial(self._recovered, state))
            self._upstream.ask(state.source, f"?_sn={first}..{last}", then)

    def _skipped(self, state: PublisherState, numbers: int) -> None:
        state.skip(numbers)
        self._finish(state)
        if state.beats:
            state.beat()

    def _recovered(self, state: PublisherState, found: CacheAnswer) -> None:
        self._feed(state, found.samples, partial(self._stored, state))

    def _stored(self, state: PublisherState) -> None:
        state.check_from = time.monotonic() + _RECOVERED_S  # not before present subscribers have recovered it from us
        state.checking = True
        self._worker.later(_RECOVERED_S, partial(self.check, state), background=True)
        self._finish(state)
        if state.beats:
            state.beat()

    # -- depth --------------------------------------------------------------------------------------------------------

    def _check(self, state: PublisherState) -> None:
        source = state.source
        if state.depth is not None or state.ended:
            self._locked(state, partial(self._checked, state))
        elif source.numbered:
            then = partial(self._step, state, partial(self._first, state))
            self._upstream.ask(source, f"?_sn={state.first}..{state.first}", then)
        else:
            self._upstream.ask(source, "", partial(self._locked, state, partial(self._measured, state)))

    def _first(self, state: PublisherState, found: CacheAnswer) -> None:
        if found.samples:
            self._locked(state, partial(self._checked, state))
        else:
            self._upstream.ask(state.source, "", partial(self._locked, state, partial(self._measured, state)))

    def _measured(self, state: PublisherState, found: CacheAnswer) -> None:
        """Take over the depth; 0 if a cache never answers, as late joiners would not have got anything either."""
        state.failures = 0 if found.complete else state.failures + 1
        first, samples = state.first, found.samples
        gone = first is not None and not (samples and samples[0][0] <= first)
        if state.failures >= _FAILURES:
            state.resize(0)
        elif found.complete and gone and not state.ended:
            state.resize(len(samples))
        self._checked(state)

    def _checked(self, state: PublisherState) -> None:
        state.checking = False  # also after a failure: then the next message asks again
        self._finish(state)


def _once(action: Callable[[], None]) -> Callable[[], None]:
    """Return a function that runs an action only the first time; for one thread."""
    left = [action]

    def run() -> None:
        if left:
            left.pop()()

    return run
