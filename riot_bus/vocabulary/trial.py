"""Test cases, outcomes and the `Runner` that turns one into the other.

`generalize` and `backchain` know only this module: they work against a live system, a pool, a cluster or a pure
function in a test.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from riot_bus.vocabulary.message import Scalar

if TYPE_CHECKING:
    from riot_bus.vocabulary.injection import Injection
    from riot_bus.vocabulary.message import Message

SEVERITIES = ("catastrophic", "restart", "abort", "silent", "hindering")
"""The CRASH scale of robustness testing (Koopman and DeVale, 1999), most severe first."""

QuestionT = TypeVar("QuestionT")

Ask = Callable[[Sequence[QuestionT]], Sequence[bool]]
"""Function that puts a batch of questions to the system: one answer each, in order, True if the failure occurred."""

Progress = Callable[[int, int | None, str], None]
"""Function called with (trials done, trials expected or None, current activity)."""


class Verdict(StrEnum):
    """The verdict on one trial.

    After an `ERROR` the same case may be tried again. `UNJUDGED` is a case during which several processes of riot died
    one after the other, so that it is unknown whether the tested component fails.
    """

    PASS = "pass"  # noqa: S105
    FAIL = "fail"
    ERROR = "error"
    UNJUDGED = "unjudged"


@dataclass(frozen=True, slots=True)
class Violation:
    """A failure that one monitor found in one trial.

    `signature` identifies the failure across trials (monitor, component, place), `detail` is for users.
    """

    monitor: str
    component: str
    signature: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Series:
    """One field over time: seconds since the start of the trial, and as many values, of the field's own type."""

    times: tuple[float, ...] = ()
    values: tuple[Scalar, ...] = ()


@dataclass(frozen=True, slots=True)
class TestCase:
    """A log (or part of one) + injections + seed.

    `messages` are played to the system under test; empty means that its own external components drive it. `again`
    numbers fresh trials of one case: the case is executed again, and nothing else changes. `ordered` means that a
    message waits until the unit has taken the earlier ones of other topics. `paced` means that the times between
    messages affect the outcome, too, because the unit is not fed as fast as it takes messages. `unprobed` means that a
    unit gets no other messages than these: no probe follows.
    """

    __test__ = False  # not a pytest class

    messages: tuple[Message, ...] = ()
    injections: tuple[Injection, ...] = ()
    seed: int = 0
    again: int = 0
    ordered: bool = False
    paced: bool = False
    unprobed: bool = False

    def digest(self) -> str:
        """Return a hash of everything that decides the outcome; equal cases have equal digests."""
        digest = _hash_of(self.messages)
        rest: dict[str, object] = {"seed": self.seed, "injections": [each.row() for each in self.injections]}
        if self.again:
            rest["again"] = self.again
        if self.ordered:
            rest["ordered"] = True
        if self.unprobed:
            rest["unprobed"] = True
        if self.paced:
            rest["gaps"] = [after.time - before.time for before, after in pairwise(self.messages)]
        digest.update(json.dumps(rest, sort_keys=True, default=repr).encode())
        return digest.hexdigest()[:32]


_hashed: list[tuple[tuple[Message, ...], hashlib._Hash]] = [((), hashlib.sha256())]
"""Cache of the last hashed messages: nearly all cases of a campaign have the same messages."""


def _hash_of(messages: tuple[Message, ...]) -> hashlib._Hash:
    """Return a hash object updated with the messages."""
    known, state = _hashed[0]
    if known is not messages:
        state = hashlib.sha256()
        for message in messages:
            state.update(message.digest())
        _hashed[0] = messages, state
    return state.copy()


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of one trial.

    `observed` contains the watched fields (`topic:field`) as they arrived at the system's inputs and inside it.
    """

    verdict: Verdict
    violations: tuple[Violation, ...] = ()
    seconds: float = 0.0
    detail: str = ""
    observed: Mapping[str, Series] = field(default_factory=dict)
    log: str | None = None
    statistics: Mapping[str, Any] = field(default_factory=dict)

    def without(self, leave: Callable[[Violation], bool]) -> Outcome:
        """Return the outcome without some violations; a failed outcome passes if no violation is left."""
        kept = tuple(each for each in self.violations if not leave(each))
        verdict = Verdict.PASS if self.verdict is Verdict.FAIL and not kept else self.verdict
        return replace(self, violations=kept, verdict=verdict)

    @property
    def judged(self) -> bool:
        """Whether the trial passed or failed, so that there is a verdict on what was tested."""
        return self.verdict in (Verdict.PASS, Verdict.FAIL)

    def failed_as(self, signature: str | None) -> bool:
        """Return whether this is the failure under study (any failure when `signature` is None); see `violation_as`."""
        return self.verdict is Verdict.FAIL and (signature is None or self.violation_as(signature) is not None)

    def violation_as(self, signature: str) -> Violation | None:
        """Return the violation with a signature, None if there is none.

        A hang, or a crash by a signal, at an unknown place, as in runs of a whole system, also matches a signature with
        a known place.
        """
        for each in self.violations:
            end = _before_place(each)
            if signature == each.signature or (end and signature.startswith(each.signature + end)):
                return each
        return None


def _before_place(violation: Violation) -> str:
    """Return the text that would precede the place in a signature without a place; empty for other signatures.

    Those without a place are `hang of NAME` and `crash in NAME: SIGNAL`; a crash at a line of Python has one more `: `.
    """
    if violation.monitor == "hang":
        return "" if ": " in violation.signature else ": "
    return " in " if violation.monitor == "crash" and violation.signature.count(": ") == 1 else ""


class Runner(Protocol):
    """Executes test cases against freshly started components."""

    @property
    def parallelism(self) -> int:
        """Number of cases worth running at once."""
        ...

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Execute all cases and return their outcomes in the same order."""
        ...
