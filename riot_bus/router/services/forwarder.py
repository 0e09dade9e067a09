"""Forwarding of calls from one segment to the services of the others, and of the replies back."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from functools import partial
from typing import TYPE_CHECKING, Any

from riot_bus.pipeline.runner import AbandonedError, BoundedCounts, Result
from riot_bus.router.services.call import Call, encoding_text, payload_of, reply_to
from riot_bus.router.worker import Worker
from riot_bus.types.serve import ERROR, REPLY, REQUEST, Request, part_of
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.convert import is_delete
from riot_bus.zenoh.libraries import library_of, moved
from riot_bus.zenoh.session import includes

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from riot_bus.pipeline.runner import Emission
    from riot_bus.router.delivery_queue import DeliveryQueue
    from riot_bus.zenoh import api as zenoh

_LOG = logging.getLogger(__name__)
_QOS = Qos()


class Limits:
    """Limits of one forwarder; attributes of the class, so that a test can set them."""

    calls = 1 << 14
    """Open calls. A new one replaces the oldest, whose caller may have gone, which cannot be detected."""
    call_bytes = 1 << 28
    """Payload bytes of the requests of open calls."""
    queued = 1 << 16
    """Requests and replies that wait for the pipeline."""
    queued_bytes = 1 << 28
    silent = 1 << 10
    """Calls with a dropped message, whose callers wait until their own timeout."""
    silent_s = 600.0
    """Seconds for which these callers may wait."""


class CallForwarder:
    """Forwards the calls that components of one segment make to the services of one key expression.

    A call is a Zenoh query, and a service a queryable. One thread does all the work, so calls keep their order; Zenoh's
    threads only enqueue. Services answer to this router; each reply goes to the caller as soon as it has passed the
    pipeline. A caller is told that its call has ended when all services that were asked have ended it.

    Args:
        owner: Function that returns which of several overlapping expressions a key belongs to.
        asked: Function of a calling segment and a key that returns the other segments that may have a service for it:
            True to ask only queryables that are declared as complete there (`QueryTarget.ALL_COMPLETE`), False to ask
            as Zenoh does by default (`QueryTarget.BEST_MATCHING`).
    """

    def __init__(
        self,
        segment: str,
        expression: str,
        *,
        deliveries: DeliveryQueue,
        owner: Callable[[str], str | None],
        asked: Callable[[str, str], Mapping[str, bool]],
    ) -> None:
        self.segment, self.expression = segment, expression
        self.shed = BoundedCounts()
        """Requests and replies, by key, for which there was no room."""
        self._deliveries, self._owner, self._asked = deliveries, owner, asked
        self._lock = threading.Lock()
        self._queued = self._queued_bytes = 0
        self._held: Counter[str] = Counter()
        self._calls: dict[int, Call] = {}
        self._call_bytes = 0
        self._silent: deque[tuple[float, Call]] = deque()
        self._sweeping = False
        self._retiring = False
        self._worker = Worker(f"riot-calls-{segment}")

    # -- on Zenoh's threads -------------------------------------------------------------------------------------------

    def take(self, query: Any) -> None:
        """Enqueue a query without waiting."""
        key = str(query.key_expr)
        owner = self._owner(key)
        if owner != self.expression and owner is not None:
            query.drop()  # another forwarder has it
            return
        size = 0 if query.payload is None else len(query.payload)
        if self._enqueue(size, partial(self._begin, query, key, size)):
            return
        self.shed.add(f"{key}/{REQUEST}")
        query.drop()

    def _replied(self, call: Call, target: str, reply: zenoh.Reply) -> None:
        result: Any = reply.result
        size = len(result.payload)
        if not call.over and not self._enqueue(size, partial(self._reply, call, target, reply)):
            self.shed.add(f"{call.query.key_expr}/{REPLY}")

    def _enqueue(self, size: int, job: Callable[[], None]) -> bool:
        with self._lock:
            if self._queued >= Limits.queued or (self._queued and self._queued_bytes + size > Limits.queued_bytes):
                return False
            self._queued += 1
            self._queued_bytes += size
        self._worker.do(partial(self._run, size, job))
        return True

    # -- on the worker's thread ---------------------------------------------------------------------------------------

    def _run(self, size: int, job: Callable[[], None]) -> None:
        try:
            job()
        except AbandonedError:
            raise  # another thread repeats the job
        except Exception:
            self._dequeue(size)
            raise
        self._dequeue(size)

    def _begin(self, query: Any, key: str, size: int) -> None:
        wide = self._owner(key) is None
        if wide and includes(key, self.expression):
            key = self.expression
        targets = self._asked(self.segment, key)
        if not targets:  # there is no service, or only in the caller's own segment
            query.drop()
            return
        request = Request(
            time.time_ns(),
            f"{key}/{REQUEST}",
            payload_of(query),
            "put",
            encoding_text(query.encoding),
            None if query.attachment is None else query.attachment.to_bytes(),
            _QOS,
            self.segment,
            next(self._deliveries.access.sequence),
            parameters=str(query.parameters),
        )
        result = self._deliveries.result(request, self._worker, tuple(targets))
        call = Call(query, request.sequence, targets, wide, pending=1, size=size)
        self._remember(call)
        self._settle(call, result, None)
        self._ended(call)

    def _reply(self, call: Call, target: str, reply: zenoh.Reply) -> None:
        sample = reply.ok
        if call.over or (call.wide and sample is not None and self._owner(str(sample.key_expr)) != self.expression):
            return  # it is routed natively, or by another forwarder
        message = self._message(call, target, reply)
        result = self._deliveries.result(message, self._worker, (self.segment,))
        self._settle(call, result, None if sample is None else sample.timestamp)

    def _message(self, call: Call, target: str, reply: zenoh.Reply) -> Message:
        sample = reply.ok
        key, kind, attachment = f"{call.query.key_expr}/{ERROR}", "put", None
        if sample is not None:
            key, kind = f"{sample.key_expr}/{REPLY}", "delete" if is_delete(sample) else "put"
            attachment = None if sample.attachment is None else sample.attachment.to_bytes()
        result: Any = reply.result
        encoding = encoding_text(result.encoding)
        return Message(
            time.time_ns(),
            key,
            payload_of(result),
            "delete" if kind == "delete" else "put",
            encoding,
            attachment,
            _QOS,
            target,
            call.number,
        )

    def _settle(self, call: Call, result: Result, stamp: zenoh.Timestamp | None) -> None:
        """Deliver a result: requests and replies go on in the call, all other messages are published."""
        self._deliveries.record_original(result)
        own = [each for each in result.emissions if part_of(each.message.key) is not None]
        others = tuple(each for each in result.emissions if part_of(each.message.key) is None)
        if others:
            self._deliveries.deliver(Result(result.original, others))
        if not own:
            call.silent = True
        now = time.time_ns()
        for emission in own:
            call.pending += 1
            if emission.due <= now:
                self._emit(call, emission, stamp)
            else:
                self._hold(emission.counted_key, 1)
                self._worker.later((emission.due - now) / 1e9, partial(self._emit_held, call, emission, stamp))

    def _emit_held(self, call: Call, emission: Emission, stamp: zenoh.Timestamp | None) -> None:
        self._emit(call, emission, stamp)
        self._hold(emission.counted_key, -1)

    def _emit(self, call: Call, emission: Emission, stamp: zenoh.Timestamp | None) -> None:
        message, key = emission.message, emission.counted_key
        if emission.original is None:
            message = message.with_(sequence=call.number, segment=emission.message.segment or self.segment)
        base, part = part_of(message.key) or (message.key, "")
        try:
            if call.over:
                self._deliveries.lose(key, "call given up")
            elif part == REQUEST:
                for target in emission.targets or call.targets:
                    self._ask(call, base, message, target)
            else:
                reply_to(call.query, base, part, message, stamp=moved(stamp, library_of(call.query)))
        except Exception as error:  # the session is closed, or the query does not accept this key
            _LOG.warning("a message of %s could not be passed on: %s", message.key, error)
            self._deliveries.lose(key, "not published")
        else:
            if not call.over:
                self._deliveries.record_delivered(emission, message)
        self._ended(call)

    def _ask(self, call: Call, key: str, message: Message, target: str) -> None:
        session = self._deliveries.access.sessions[target]
        zenoh = library_of(session)
        query, payload, complete = call.query, call.payload(message), zenoh.QueryTarget.ALL_COMPLETE
        call.pending += 1
        asked: Any = zenoh.Selector(key, message.parameters if isinstance(message, Request) else "")
        question = object()
        call.questions.add(question)
        token = zenoh.CancellationToken()
        call.tokens.append(token)
        ended = partial(self._worker.do, partial(self._answered, call, question))
        try:
            session.get(
                asked,
                zenoh.handlers.Callback(partial(self._replied, call, target), drop=ended, indirect=False),
                target=complete if call.targets.get(target) else zenoh.QueryTarget.BEST_MATCHING,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=30 * 86_400.0,  # a month: the caller's own timeout counts, which is not known here
                payload=payload,
                encoding=None if payload is None else zenoh.Encoding(message.encoding or "zenoh/bytes"),
                attachment=message.attachment,
                accept_replies=zenoh.ReplyKeyExpr.ANY if _anywhere(query) else zenoh.ReplyKeyExpr.MATCHING_QUERY,
                allowed_destination=zenoh.Locality.REMOTE,  # not our own stand-ins
                cancellation_token=token,
            )
        except zenoh.ZError:  # whether `drop` is called as well depends on the error
            call.questions.discard(question)
            call.pending -= 1
            raise

    def _answered(self, call: Call, question: object) -> None:
        if question in call.questions:
            call.questions.discard(question)
            self._ended(call)

    def _ended(self, call: Call) -> None:
        """Count down what is pending in a call, and end the call at zero."""
        call.pending -= 1
        if call.pending or call.over:
            return
        self._forget(call)
        if not call.silent:
            call.query.drop()
        else:
            self._silent.append((time.monotonic() + Limits.silent_s, call))
            self._sweep()
        if self._retiring and not self._calls:
            self.close()

    def _sweep(self, *, again: bool = False) -> None:
        """End calls that were silent for long enough."""
        silent, now = self._silent, time.monotonic()
        while silent and (silent[0][0] <= now or len(silent) > Limits.silent):
            silent.popleft()[1].query.drop()
        if silent and (again or not self._sweeping):
            self._worker.later(silent[0][0] - now, partial(self._sweep, again=True), background=True)
        self._sweeping = bool(silent)

    def _remember(self, call: Call) -> None:
        self._calls[call.number] = call
        self._call_bytes += call.size
        while len(self._calls) > 1 and (len(self._calls) > Limits.calls or self._call_bytes > Limits.call_bytes):
            oldest = next(iter(self._calls.values()))
            _LOG.warning("a call of %s without an end was given up for newer ones", oldest.query.key_expr)
            self._give_up(oldest)

    def _forget(self, call: Call) -> None:
        call.over = True
        if self._calls.pop(call.number, None) is not None:
            self._call_bytes -= call.size

    def _give_up(self, call: Call) -> None:
        self._forget(call)
        for token in call.tokens:
            token.cancel()
        call.query.drop()

    # -- for others ---------------------------------------------------------------------------------------------------

    def held(self) -> Counter[str]:
        """Return how many messages wait until they are due, by key."""
        with self._lock:
            return +self._held

    def idle(self) -> bool:
        """Return whether nothing is in process; services that have not answered yet do not count."""
        return self._worker.idle()

    def retire(self) -> None:
        """End with the last open call; call this when no more calls can come."""
        self._worker.do(self._retire)

    def _retire(self) -> None:
        self._retiring = True
        if not self._calls:
            self.close()

    def close(self) -> None:
        """Do what is ready, then end all calls; safe to call twice."""
        self._worker.close()
        for call in list(self._calls.values()):
            self._give_up(call)
        while self._silent:
            self._silent.popleft()[1].query.drop()
        for key, number in self.held().items():
            for _ in range(number):
                self._deliveries.lose(key, "held at the end")
            self._hold(key, -number)

    def _dequeue(self, size: int) -> None:
        with self._lock:
            self._queued -= 1
            self._queued_bytes -= size

    def _hold(self, key: str, number: int) -> None:
        with self._lock:
            self._held[key] += number
            if not self._held[key]:
                del self._held[key]


def _anywhere(query: Any) -> bool:
    """Return whether replies may have other keys than a query."""
    return bool(query.accepts_replies() == library_of(query).ReplyKeyExpr.ANY)
