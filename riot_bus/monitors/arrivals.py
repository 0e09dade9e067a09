"""Invariants on when and how often outputs come: rate, never, sometimes, reached, count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

from pydantic import Field

from riot_bus.monitors.forging import with_message, without
from riot_bus.monitors.model import TrialView, why_no_message
from riot_bus.monitors.selection import WithSelectors, message_selector, selected, why_unseen
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.selector import Selector
from riot_bus.vocabulary.trial import Violation

Seconds = Annotated[float, Field(gt=0, le=86_400)]
_Ratio = Annotated[float, Field(ge=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class Rate:
    """An output comes at least every `gap` seconds of wall time, from the first input to the end of watching.

    Without known inputs, this starts with the trial. An output may be late by the time for which the machine was busy.

    Attributes:
        topic: Topic name or key expression.
        gap: Longest time between two messages, seconds.
    """

    topic: str
    gap: Seconds

    @property
    def topics(self) -> tuple[str, ...]:
        """The topic."""
        return (self.topic,)

    @property
    def missed(self) -> tuple[str, ...]:
        """Topics whose missing messages are a violation."""
        return self.topics

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation when the largest gap is too large."""
        widest = self._widest(view)
        if widest <= self.gap + view.late:
            return []
        detail = f"no {self.topic} for {widest:.3f} s (allowed: {self.gap:g} s)"
        return [Violation("rate", self.topic, f"rate of {self.topic}", detail)]

    def unseen(self, view: TrialView) -> str | None:
        """Return why no gap could be too large, None if one could."""
        seconds, widest = (view.end - view.start) / 1e9, self._widest(view)
        short = (
            f"the trial took {seconds:.3f} s, which is no longer than the gap allowed" if seconds <= self.gap else None
        )
        if (why := why_no_message(view, self.topic) or short) or not self.gap < widest <= self.gap + view.late:
            return why
        return f"the machine was busy: outputs may be {view.late:.3f} s late, the largest gap is {widest:.3f} s"

    def _widest(self, view: TrialView) -> float:
        """Return the seconds of the largest gap."""
        times = [message.time for message in view.outputs if view.registry.matches(self.topic, message.key)]
        stamps = [view.start, *(time for time in times if time >= view.start), view.end]
        return max(after - before for before, after in pairwise(stamps)) / 1e9

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy in which the output is missing."""
        return without(view, Selector(self.topic), seconds=2 * self.gap)


@dataclass(frozen=True)
class _Condition(WithSelectors):
    when: str

    selectors = (("when", message_selector),)


@dataclass(frozen=True)
class Never(_Condition):
    """No message of an output meets a condition.

    Attributes:
        when: A selector with a predicate, `1/1/STATUSTEXT where severity <= 2`; without one no message may come at all.
        tell: Field of such a message whose value is reported.
    """

    tell: str | None = None

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation at the first such message."""
        for message, kind in selected(view, message_selector(self.when)):
            told = "" if self.tell is None else f": {self.tell} = {kind.read(message.payload, self.tell)!r}"
            return [Violation("never", self.topics[0], f"never {self.when}", f"{message.key}{told}")]
        return []

    def unseen(self, view: TrialView) -> str | None:
        """Return why the condition could not be checked, None if it could or there is no condition."""
        selector = message_selector(self.when)
        return None if selector.where is None else why_unseen(view, selector, met=False)

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy with such a message."""
        return with_message(view, message_selector(self.when))


@dataclass(frozen=True)
class Sometimes(_Condition):
    """A condition is met by at least one output in each trial.

    Attributes:
        when: A selector, `mission/state where phase == 4`; without a condition, some message has to come.
    """

    whole_trial = True

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation when no message meets the condition."""
        selector = message_selector(self.when)
        if next(selected(view, selector), None) is not None:
            return []
        detail = why_unseen(view, selector) or ""
        return [Violation("sometimes", self.topics[0], f"never reached: {self.when}", detail)]

    @property
    def missed(self) -> tuple[str, ...]:
        """Topics whose missing messages are a violation."""
        return self.topics

    def unseen(self, view: TrialView) -> str | None:
        """Return None: missing messages are what it looks for."""
        return None

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy without these messages."""
        return without(view, message_selector(self.when))


@dataclass(frozen=True)
class Reached(_Condition):
    """A condition is met by at least one output in at least one trial of a campaign; no single trial violates it.

    Attributes:
        when: A selector, `mission/state where phase == 4`; without a condition, some message has to come.
    """

    whole_trial = True

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return nothing: another trial may reach it."""
        return []

    def unseen(self, view: TrialView) -> str | None:
        """Return why this trial has not reached it, None if it has; a campaign reports what none of its trials has."""
        why = why_unseen(view, message_selector(self.when))
        return None if why is None else f"not reached: {why}"


@dataclass(frozen=True)
class Ratio(WithSelectors):
    """The number of outputs per input, over the whole trial, is within bounds.

    Attributes:
        output: A selector of outputs.
        input: A selector of inputs, or of outputs where inputs are not known.
        low: Least number of outputs per input.
        high: Largest number of outputs per input.
    """

    output: str
    input: str
    low: _Ratio
    high: _Ratio

    whole_trial = True
    selectors = (("output", message_selector), ("input", message_selector))

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.low > self.high:
            raise ConfigError(f"low = {self.low:g} is above high = {self.high:g}")

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return a violation when the ratio is out of bounds."""
        inputs, outputs = self._inputs(view), len(list(selected(view, message_selector(self.output))))
        if not inputs or self.low <= outputs / inputs <= self.high:
            return []
        allowed = f"{outputs / inputs:.4g} for one, allowed: {self.low:g} to {self.high:g}"
        detail = f"{outputs} of {self.output} for {inputs} of {self.input} ({allowed})"
        return [Violation("count", self.topics[0], f"count of {self.output} for {self.input}", detail)]

    @property
    def missed(self) -> tuple[str, ...]:
        """Topics whose missing messages are a violation."""
        return self.topics[:1] if self.low else ()

    def unseen(self, view: TrialView) -> str | None:
        """Return that no input came, None if one did."""
        return None if self._inputs(view) else f"no input {self.input!r} came"

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy without the outputs, or with more of them."""
        selector = message_selector(self.output)
        if self.low > 0:
            return without(view, selector)
        more = int(self.high * self._inputs(view)) + 1
        forged = with_message(view, selector)
        return replace(forged, outputs=[*forged.outputs, *[forged.outputs[-1]] * more])

    def _inputs(self, view: TrialView) -> int:
        selector = message_selector(self.input)
        return len(list(selected(view, selector, view.inputs or None)))
