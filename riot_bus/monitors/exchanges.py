"""Invariant that each request is answered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from riot_bus.monitors.arrivals import Seconds
from riot_bus.monitors.forging import without
from riot_bus.monitors.selection import WithSelectors, message_selector, selected, why_unseen
from riot_bus.vocabulary.trial import Violation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from riot_bus.monitors.model import TrialView
    from riot_bus.types.model import MessageType
    from riot_bus.vocabulary.message import Message, Scalar


@dataclass(frozen=True)
class Answered(WithSelectors):
    """Each request gets an answer in time, counted from the first input for requests before it.

    Attributes:
        request: A selector of requests, such as `255/*/COMMAND_LONG`.
        answer: A selector of answers, such as `1/1/COMMAND_ACK where result == 0`.
        within: Time limit, seconds of wall time, not counting those in which the machine was busy.
        same: Fields whose values are equal in a request and its answer.
    """

    request: str
    answer: str
    within: Seconds
    same: tuple[str, ...] = ()

    selectors = (("request", message_selector), ("answer", message_selector))

    @property
    def missed(self) -> tuple[str, ...]:
        """Topics whose missing messages are a violation."""
        return self.topics[1:]

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first request without an answer, ignoring those that may still get one."""
        answers = [
            (message.time, self._values(message, kind))
            for message, kind in selected(view, message_selector(self.answer))
        ]
        for message, kind in self._requests(view):
            end, values = self._deadline(view, message), self._values(message, kind)
            if end <= view.end and not any(message.time <= time <= end and each == values for time, each in answers):
                shown = ", ".join(f"{name} = {value!r}" for name, value in zip(self.same, values, strict=True))
                detail = f"no answer within {self.within:g} s" + (f" to {shown}" if shown else "")
                return [Violation("answered", self.request, f"answer to {self.request}", detail)]
        return []

    def unseen(self, view: TrialView) -> str | None:
        """Return why no request could be left without an answer, None if one could."""
        requests = self._requests(view)
        if not requests:
            return why_unseen(view, message_selector(self.request))
        late = all(self._deadline(view, message) > view.end for message, _ in requests)
        return f"each of {len(requests)} requests could still be answered at the end" if late else None

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy without answers."""
        return without(view, message_selector(self.answer))

    def _requests(self, view: TrialView) -> list[tuple[Message, MessageType]]:
        selector = message_selector(self.request)
        return list(selected(view, selector)) or list(selected(view, selector, view.inputs))

    def _deadline(self, view: TrialView, request: Message) -> int:
        return max(request.time, view.start) + round((self.within + view.late) * 1e9)

    def _values(self, message: Message, kind: MessageType) -> tuple[Scalar, ...]:
        return tuple(kind.read(message.payload, name) for name in self.same)
