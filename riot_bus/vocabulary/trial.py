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

__all__ = ["SEVERITIES", "Ask", "Outcome", "Progress", "Runner", "Scalar", "Series", "TestCase", "Verdict", "Violation"]


SEVERITIES = ("catastrophic", "restart", "abort", "silent", "hindering")
"""The CRASH scale of robustness testing (Koopman and DeVale, 1999), the worst first."""

QuestionT = TypeVar("QuestionT")

Ask = Callable[[Sequence[QuestionT]], Sequence[bool]]
"""A batch of questions to the system: one answer each, in order, True where the failure under study happened."""

Progress = Callable[[int, int | None, str], None]
"""Called with (trials done, trials expected or None, what is going on)."""


class Verdict(StrEnum):
    """How one trial ended.

    After an `ERROR` the same case may be tried again. `UNJUDGED` is a case that several processes of riot did not
    outlive, one after the other: whether what it tests fails is not known.
    """

    PASS = "pass"  # noqa: S105
    FAIL = "fail"
    ERROR = "error"
    UNJUDGED = "unjudged"


@dataclass(frozen=True, slots=True)
class Violation:
    """What one monitor saw go wrong in one trial.

    `signature` identifies the failure across trials (monitor, component, place), `detail` is for people.
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
    numbers fresh trials of one case: it is asked anew, and nothing else changes. `ordered` says that a message waits
    until the unit has taken in those of other topics before it. `paced` says that the times between messages decide,
    too: where a unit is not fed as fast as it takes them.
    """

    __test__ = False  # not a pytest class

    messages: tuple[Message, ...] = ()
    injections: tuple[Injection, ...] = ()
    seed: int = 0
    again: int = 0
    ordered: bool = False
    paced: bool = False

    def digest(self) -> str:
        """Return a hash of everything that decides the outcome; equal cases have equal digests."""
        digest = _hash_of(self.messages)
        rest: dict[str, object] = {"seed": self.seed, "injections": [each.row() for each in self.injections]}
        if self.again:
            rest["again"] = self.again
        if self.ordered:
            rest["ordered"] = True
        if self.paced:
            rest["gaps"] = [after.time - before.time for before, after in pairwise(self.messages)]
        digest.update(json.dumps(rest, sort_keys=True, default=repr).encode())
        return digest.hexdigest()[:32]


_hashed: list[tuple[tuple[Message, ...], hashlib._Hash]] = [((), hashlib.sha256())]
"""The messages that were hashed last: nearly all cases of a campaign have the same."""


def _hash_of(messages: tuple[Message, ...]) -> hashlib._Hash:
    """Return a hash that has taken in messages."""
    known, state = _hashed[0]
    if known is not messages:
        state = hashlib.sha256()
        for message in messages:
            state.update(message.digest())
        _hashed[0] = messages, state
    return state.copy()


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one trial showed.

    `observed` holds the watched fields (`topic:field`) as they arrived at the system's inputs and inside it.
    """

    verdict: Verdict
    violations: tuple[Violation, ...] = ()
    seconds: float = 0.0
    detail: str = ""
    observed: Mapping[str, Series] = field(default_factory=dict)
    log: str | None = None
    statistics: Mapping[str, Any] = field(default_factory=dict)

    def without(self, leave: Callable[[Violation], bool]) -> Outcome:
        """Return the outcome without some violations; one that has failed passes if none is left."""
        kept = tuple(each for each in self.violations if not leave(each))
        verdict = Verdict.PASS if self.verdict is Verdict.FAIL and not kept else self.verdict
        return replace(self, violations=kept, verdict=verdict)

    @property
    def judged(self) -> bool:
        """Whether it tells something of what was tested."""
        return self.verdict in (Verdict.PASS, Verdict.FAIL)

    def failed_as(self, signature: str | None) -> bool:
        """Return whether this is the failure under study (any failure when `signature` is None); see `violation_as`."""
        return self.verdict is Verdict.FAIL and (signature is None or self.violation_as(signature) is not None)

    def violation_as(self, signature: str) -> Violation | None:
        """Return the violation that has a signature, None if none has.

        A hang, or a crash by a signal, whose place could not be told, as in runs of a whole system, is taken for one
        whose place is known.
        """
        for each in self.violations:
            end = _before_place(each)
            if signature == each.signature or (end and signature.startswith(each.signature + end)):
                return each
        return None


def _before_place(violation: Violation) -> str:
    """Return what would come before the place in a signature that has none; empty where another one may lack nothing.

    It is `hang of NAME`, and `crash in NAME: SIGNAL`; a crash with a line of Python has one more `: ` in it.
    """
    if violation.monitor == "hang":
        return "" if ": " in violation.signature else ": "
    return " in " if violation.monitor == "crash" and violation.signature.count(": ") == 1 else ""


class Runner(Protocol):
    """Executes test cases against freshly started components."""

    @property
    def parallelism(self) -> int:
        """How many cases are worth asking at once."""
        ...

    def run(self, cases: Sequence[TestCase]) -> Sequence[Outcome]:
        """Execute all cases and return their outcomes in the same order."""
        ...
