"""Trials, test cases and outcomes as bytes, for workers in other processes: MessagePack, checked as it is read."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import msgpack  # type: ignore[import-untyped]
from pydantic import TypeAdapter, ValidationError

from riot_bus.sut.baseline import Baseline, NominalTrial
from riot_bus.sut.hangs import KnownHangs
from riot_bus.sut.persistent import PersistentTrial
from riot_bus.sut.python_report import ThreadStack
from riot_bus.sut.system import RunPace
from riot_bus.sut.system_trial import SystemTrial
from riot_bus.sut.unit_trial import IdleTrial, UnitTrial
from riot_bus.vocabulary import errors
from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.trial import Outcome, TestCase

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = [
    "Trial",
    "TrialAnswer",
    "TrialBatch",
    "TrialRequest",
    "nominal_of",
    "pack_answer",
    "pack_baseline",
    "pack_failure",
    "read_answer",
    "read_baseline",
    "remember",
]

_T = TypeVar("_T")
_MOST_KNOWN = 8
"""Logs that a worker keeps in memory; a chain works with one or two at a time."""
Trial = UnitTrial | PersistentTrial | IdleTrial | SystemTrial
"""What a worker can do with a test case."""

_TRIALS: dict[str, type[Trial]] = {kind.__name__: kind for kind in (UnitTrial, PersistentTrial, IdleTrial, SystemTrial)}
_ERRORS = {name: getattr(errors, name) for name in errors.__all__ if name.endswith("Error")}
_LARGE_INT = 1
"""Extension type of numbers that 64 bits do not hold."""
_NAMES: dict[str, Any] = {
    each.__name__: each
    for each in (
        Curve,
        Formula,
        Injection,
        KnownHangs,
        Mapping,
        Message,
        RunPace,
        Sequence,
        Signal,
        TestCase,
        ThreadStack,
    )
} | {"Scalar": Scalar}
"""What the annotations of the classes name that cross."""


_NO_HANGS: Mapping[str, KnownHangs] = {}
_ADAPTERS: dict[type[Any], TypeAdapter[Any]] = {}


def _adapter(kind: type[Any]) -> TypeAdapter[Any]:
    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
        _ADAPTERS[kind].rebuild(_types_namespace=_NAMES)
    return _ADAPTERS[kind]


def _plain(value: Any) -> Any:
    return _adapter(type(value)).dump_python(value, warnings=False)


def _pack(value: Any) -> bytes:
    packed: bytes = msgpack.packb(value, default=_pack_other, unicode_errors="surrogatepass")
    return packed


def _pack_other(value: Any) -> Any:
    if isinstance(value, int):
        return msgpack.ExtType(_LARGE_INT, str(value).encode())
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} does not cross to a worker")


def _unpack(data: bytes) -> Any:
    return msgpack.unpackb(data, ext_hook=_unpack_other, strict_map_key=False, unicode_errors="surrogatepass")


def _unpack_other(code: int, data: bytes) -> Any:
    if code != _LARGE_INT:
        raise ValueError(f"unknown extension type {code}")
    return int(data)


class TrialBatch:
    """What many requests share: how cases are executed, and the log that their messages are from.

    Args:
        trial: Executes each case.
        log: Messages that go over once; cases name them by their numbers.

    Attributes:
        shared: That, as bytes.
        digest: Its hash; a worker that knows it is not sent it again.
    """

    def __init__(self, trial: Trial, log: Sequence[Message]) -> None:
        self.trial = trial
        known = _log_of(trial)
        own = [] if known else [_plain(message) for message in log]
        self.shared = _pack({"kind": type(trial).__name__, "trial": _plain(trial), "log": own})
        self.digest = hashlib.sha256(self.shared).digest()
        self._log = tuple(known or log)
        self._numbers = {message: number for number, message in enumerate(self._log)}
        self._last: tuple[tuple[Message, ...] | None, Sequence[Any] | None] = None, None

    def request(
        self,
        case: TestCase,
        *,
        directory: Path,
        whole: bool,
        imports: Mapping[str, Sequence[str]],
        hangs: Mapping[str, KnownHangs] = _NO_HANGS,
    ) -> bytes:
        """Return what asks a worker to execute a case.

        Args:
            case: The case.
            directory: Folder in which it may leave files; a relative one is below the worker's working folder.
            whole: Whether what is shared goes with it.
            imports: Modules that Python components import, by program, as far as the worker does not know them.
            hangs: What is known of hangs, by component.
        """
        messages = self._told(case.messages)
        return _pack(
            {
                "digest": self.digest,
                "shared": self.shared if whole else None,
                "case": _plain(replace(case, messages=())) | {"messages": messages},
                "directory": directory,
                "imports": imports,
                "hangs": {name: _plain(known) for name, known in hangs.items()},
            }
        )

    def _told(self, messages: tuple[Message, ...]) -> Sequence[Any] | None:
        """Return messages as a request has them, None for the whole log; those of the last case are looked up once."""
        if messages is not self._last[0]:
            numbers = self._numbers
            told = None
            if messages != self._log:
                told = [numbers[each] if each in numbers else _plain(each) for each in messages]
            self._last = messages, told
        return self._last[1]


def _log_of(trial: Trial) -> tuple[Message, ...]:
    return trial.baseline.log if isinstance(trial, UnitTrial | PersistentTrial) else ()


@dataclass(frozen=True, slots=True)
class TrialRequest:
    """What a worker is to do: execute a case; fields as of `TrialBatch.request`."""

    trial: Trial
    case: TestCase
    directory: Path
    imports: Mapping[str, Sequence[str]]
    hangs: Mapping[str, KnownHangs]

    @classmethod
    def read(cls, data: bytes, known: dict[bytes, tuple[Trial, tuple[Message, ...]]]) -> TrialRequest:
        """Read a request.

        Args:
            data: Its bytes.
            known: What earlier requests shared, by hash; what this one shares is added.

        Raises:
            ValueError: It is no request.
        """
        found = _unpack(data)
        if found["shared"] is not None:
            shared = _unpack(found["shared"])
            trial: Trial = _adapter(_TRIALS[shared["kind"]]).validate_python(shared["trial"])
            own = tuple(_adapter(Message).validate_python(each) for each in shared["log"])
            remember(known, found["digest"], (trial, _log_of(trial) or own))
        trial, log = known[found["digest"]]
        messages = found["case"].pop("messages")
        case: TestCase = _adapter(TestCase).validate_python(found["case"])
        case = replace(case, messages=log if messages is None else tuple(_messages(messages, log)))
        hangs = {name: _adapter(KnownHangs).validate_python(each) for name, each in found["hangs"].items()}
        return cls(trial, case, Path(found["directory"]).absolute(), found["imports"], hangs)


def remember(known: dict[bytes, _T], digest: bytes, shared: _T) -> None:
    """Add what a request shares; the oldest is forgotten, by worker and riot alike."""
    known[digest] = shared
    if len(known) > _MOST_KNOWN:
        del known[next(iter(known))]


def _messages(found: Sequence[Any], log: Sequence[Message]) -> Iterable[Message]:
    for each in found:
        yield log[each] if isinstance(each, int) else _adapter(Message).validate_python(each)


@dataclass(frozen=True, slots=True)
class TrialAnswer:
    """What a worker has found.

    Attributes:
        outcome: How the trial ended.
        imports: Modules that Python components import, by program, as far as they were not asked with.
        hangs: What is known of hangs, by component, where that is not what they were asked with.
    """

    outcome: Outcome
    imports: Mapping[str, Sequence[str]] = field(default_factory=dict)
    hangs: Mapping[str, KnownHangs] = field(default_factory=dict)


def pack_answer(answer: TrialAnswer) -> bytes:
    """Return an answer as bytes."""
    return _pack(_plain(answer))


def pack_failure(error: Exception, trace: str) -> bytes:
    """Return an answer that raises where it is read: the error, or one with its traceback if it is of no known kind."""
    if type(error).__name__ in _ERRORS and isinstance(error, errors.RiotError):
        told = [error.message, error.where, error.hint]
        return _pack({"error": type(error).__name__, "told": told})
    if isinstance(error, OSError) and error.errno:
        return _pack(
            {"error": "OSError", "told": [error.errno, error.strerror, error.filename and str(error.filename)]}
        )
    return _pack({"error": "", "told": [trace]})


def read_answer(data: bytes) -> TrialAnswer:
    """Read an answer.

    Raises:
        RiotError: The trial raised it, of whatever kind.
        OSError: Likewise.
        RuntimeError: The trial raised something else, or this is no answer.
    """
    try:
        found = _unpack(data)
        if "error" not in found:
            answer: TrialAnswer = _adapter(TrialAnswer).validate_python(found)
            return answer
        name, told = str(found["error"]), found["told"]
        if name in _ERRORS:
            error: Exception = errors.RiotError.__new__(_ERRORS[name])
            errors.RiotError.__init__(error, told[0], where=told[1], hint=told[2])  # type: ignore[arg-type]
        elif name == "OSError":
            error = OSError(int(told[0]), *told[1:])
        else:
            error = RuntimeError(f"a trial has raised an error:\n{told[0]}")
    except (ValueError, KeyError, TypeError, IndexError, ValidationError, msgpack.UnpackException) as wrong:
        raise RuntimeError(f"a worker gave an invalid answer: {wrong}") from None
    raise error


def nominal_of(outcome: Outcome) -> NominalTrial:
    """Return what a trial with `UnitTrial.nominal` has shown."""
    found: NominalTrial = _adapter(NominalTrial).validate_python(outcome.statistics["nominal"])
    return found


def pack_baseline(key: str, baseline: Baseline) -> bytes:
    """Return a baseline as bytes, with what it is bound to."""
    return _pack({"key": key, "baseline": _plain(baseline)})


def read_baseline(data: bytes) -> tuple[str, Baseline]:
    """Return what a baseline is bound to, and the baseline.

    Raises:
        ValueError: This is none.
    """
    try:
        found = _unpack(data)
        baseline: Baseline = _adapter(Baseline).validate_python(found["baseline"])
        return str(found["key"]), baseline
    except (ValueError, KeyError, TypeError, ValidationError, msgpack.UnpackException) as wrong:
        raise ValueError(f"it holds no baseline: {wrong}") from None
