"""Serialisation of trials, test cases and outcomes for worker processes: MessagePack, validated when read."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import msgpack  # type: ignore[import-untyped]
from pydantic import TypeAdapter, ValidationError

from riot_bus.processes.python_report import ThreadStack
from riot_bus.system.system_file import RunPace
from riot_bus.trial.baseline import Baseline, NominalTrial
from riot_bus.trial.hangs import KnownHangs
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.trial.unit_trial import IdleTrial, UnitTrial
from riot_bus.vocabulary import errors
from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal
from riot_bus.vocabulary.message import Message, Scalar
from riot_bus.vocabulary.trial import Outcome, TestCase

_T = TypeVar("_T")
MOST_KNOWN = 4
"""Number of logs that a worker keeps in memory; a chain works with one or two at a time."""
Trial = UnitTrial | IdleTrial | SystemTrial
"""Ways in which a worker can execute a test case."""

_TRIALS: dict[str, type[Trial]] = {kind.__name__: kind for kind in (UnitTrial, IdleTrial, SystemTrial)}
_ERRORS = {name: getattr(errors, name) for name in vars(errors) if name.endswith("Error")}
_LARGE_INT = 1
"""Extension type of integers that do not fit into 64 bits."""
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
"""Names used in the annotations of the serialised classes."""


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
    raise TypeError(f"{type(value).__name__} cannot be sent to a worker")


def _unpack(data: bytes) -> Any:
    return msgpack.unpackb(data, ext_hook=_unpack_other, strict_map_key=False, unicode_errors="surrogatepass")


def _unpack_other(code: int, data: bytes) -> Any:
    if code != _LARGE_INT:
        raise ValueError(f"unknown extension type {code}")
    return int(data)


class TrialBatch:
    """Data that many requests share: how cases are executed, and the log from which their messages come.

    Attributes:
        digest: Hash of the shared data, which is not sent again to a worker that knows it.
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
        """Return the request that asks a worker to execute a case.

        Args:
            directory: Folder in which it may leave files; a relative path is below the worker's working folder.
            imports: Modules that Python components import, by program, without those that the worker knows.
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
        """Return messages in the form of a request, None for the whole log; the result of the last case is cached."""
        if messages is not self._last[0]:
            numbers = self._numbers
            told = None
            if messages != self._log:
                told = [numbers[each] if each in numbers else _plain(each) for each in messages]
            self._last = messages, told
        return self._last[1]


def _log_of(trial: Trial) -> tuple[Message, ...]:
    return trial.baseline.log if isinstance(trial, UnitTrial) else ()


@dataclass(frozen=True, slots=True)
class TrialRequest:
    """A request to execute a case; the fields are those of `TrialBatch.request`."""

    trial: Trial
    case: TestCase
    directory: Path
    imports: Mapping[str, Sequence[str]]
    hangs: Mapping[str, KnownHangs]

    @classmethod
    def read(cls, data: bytes, known: dict[bytes, tuple[Trial, tuple[Message, ...]]]) -> TrialRequest:
        """Read a request.

        Args:
            known: Shared data of earlier requests, by hash; that of this request is added.

        Raises:
            ValueError: The data is not a request.
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
    """Add the shared data of a request and forget the oldest; the worker and riot use the same rule."""
    known[digest] = shared
    if len(known) > MOST_KNOWN:
        del known[next(iter(known))]


def _messages(found: Sequence[Any], log: Sequence[Message]) -> Iterable[Message]:
    for each in found:
        yield log[each] if isinstance(each, int) else _adapter(Message).validate_python(each)


@dataclass(frozen=True, slots=True)
class TrialAnswer:
    """The answer of a worker.

    Attributes:
        imports: Modules that Python components import, by program, without those known to the worker before.
        hangs: Known hangs, by component, where they differ from the request.
    """

    outcome: Outcome
    imports: Mapping[str, Sequence[str]] = field(default_factory=dict)
    hangs: Mapping[str, KnownHangs] = field(default_factory=dict)


def pack_answer(answer: TrialAnswer) -> bytes:
    """Return an answer as bytes."""
    return _pack(_plain(answer))


def pack_failure(error: Exception, trace: str) -> bytes:
    """Return an answer that raises the error when it is read; for an unknown kind, an error with its traceback."""
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
        RiotError: The trial raised it or a subclass.
        OSError: The trial raised it.
        RuntimeError: The trial raised another error, or the data is not an answer.
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
    """Return the `NominalTrial` from the outcome of a trial with `UnitTrial.nominal`."""
    found: NominalTrial = _adapter(NominalTrial).validate_python(outcome.statistics["nominal"])
    return found


def pack_baseline(key: str, baseline: Baseline) -> bytes:
    """Return a baseline and its key as bytes."""
    return _pack({"key": key, "baseline": _plain(baseline)})


def read_baseline(data: bytes) -> tuple[str, Baseline]:
    """Return the key of a baseline, and the baseline; raises ValueError if the data is not a baseline."""
    try:
        found = _unpack(data)
        baseline: Baseline = _adapter(Baseline).validate_python(found["baseline"])
        return str(found["key"]), baseline
    except (ValueError, KeyError, TypeError, ValidationError, msgpack.UnpackException) as wrong:
        raise ValueError(f"it holds no baseline: {wrong}") from None
