"""What people would use instead, on the same nodes, for the same time, with the same oracle.

Each peer runs logs without a bus, each with a new process (Atheris: all in one), and is told of each whether it failed:
an exception, a signal, a hang, or what the case's own symptom says (Atheris: an exception or an end). Their values have
the types of nominal ones, so no time goes into payloads of another form; riot has no such help.
"""

from __future__ import annotations

import copy
import itertools
import json
import math
import random
import re
import struct
import subprocess
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from benchmarks.real_faults.case import Case, Input, Run, messages_of
from riot_bus.inject.dictionary import load_dictionary
from tests.interop import Environment, of_case, provide

FUZZ = Path(__file__).with_name("fuzz.py")
ROOT = Path(__file__).resolve().parents[2]
_OVERRUN = 2.0  # Hypothesis may shrink for as long again
_EXAMPLES = 100  # Hypothesis' default

Place: TypeAlias = "tuple[str | int, ...]"


@dataclass(slots=True)
class PeerResult:
    """What a peer met: after how many logs and seconds the report's fault, how many failures in all, and its words."""

    met: bool = False
    runs: int = 0
    seconds: float = 0.0
    failures: list[str] = field(default_factory=list)
    said: str = ""


class _TimeIsOver(BaseException):  # no Exception, so that Hypothesis lets it through
    pass


class _Subject:
    """A program, a clock, and a note of each failure."""

    def __init__(self, case: Case, run: Callable[[Sequence[Input]], Run], seconds: float) -> None:
        self.case, self._run = case, run
        self._begin = time.monotonic()
        self._end = self._begin + seconds
        self.seconds, self.result, self._places = seconds, PeerResult(), set[str]()

    @property
    def left(self) -> float:
        """Time left, in seconds."""
        return self._end - time.monotonic()

    @property
    def over(self) -> bool:
        """Whether the time is over."""
        return self.left <= 0

    def fails(self, log: Sequence[Input]) -> str:
        """Run a log; return where or how it failed, empty if not."""
        run = self._run(log)
        shown = self.case.shows(log, run)
        place = (
            "" if run.end == "passed" and not shown else f"{run.end} {run.error.partition(':')[0]} {run.place}".strip()
        )
        result = self.result
        result.runs += not result.met
        if place and shown and self.case.verdict(messages_of(log))[0] == "known" and not result.met:
            result.met, result.seconds = True, time.monotonic() - self._begin
        if place and place not in self._places:
            self._places.add(place)
            result.failures.append(place)
        return place


def uniform(subject: _Subject, nominal: Sequence[Input], source: random.Random) -> None:
    """Set some fields of some messages to values drawn from all that their types can hold."""
    while not subject.over:
        subject.fails(_with_values(nominal, source, lambda before: _anything(before, source)))


def dictionary(subject: _Subject, nominal: Sequence[Input], source: random.Random) -> None:
    """Set some fields of some messages to exceptional values from riot's own dictionary."""
    words = load_dictionary()
    values = {kind: [each.value for each in words.values_for(kind)] for kind in ("bool", "int64", "float64", "string")}
    kinds = {bool: "bool", int: "int64", float: "float64", str: "string"}

    def one(before: Any) -> Any:
        return source.choice(values[kinds[type(before)]])

    while not subject.over:
        subject.fails(_with_values(nominal, source, one))


def hypothesis(subject: _Subject, nominal: Sequence[Input], source: random.Random) -> None:
    """Let Hypothesis draw changes, shrink what fails, and explain it."""
    from hypothesis import HealthCheck, Phase, given, seed, settings
    from hypothesis import strategies as st

    known: set[str] = set()
    failures: dict[str, type[Exception]] = {}  # Hypothesis tells failures apart by their types
    places = [(number, place) for number, (_, _, fields) in enumerate(nominal) for place in _leaves(fields)]
    seen: dict[tuple[str, Place], list[Any]] = {}
    for number, place in places:
        seen.setdefault((nominal[number][1], place), []).append(_at(nominal[number][2], place))

    @st.composite
    def changes(draw: Any) -> list[tuple[int, Place, Any]]:
        found = []
        for number, place in draw(st.lists(st.sampled_from(places), min_size=1, max_size=4)):
            values = seen[nominal[number][1], place]
            anything = {bool: st.booleans(), int: st.integers(), float: st.floats(), str: st.text()}[type(values[0])]
            found.append((number, place, draw(st.one_of(anything, st.sampled_from(values)))))
        return found

    orders = st.lists(
        st.tuples(st.sampled_from(("drop", "repeat", "swap")), st.integers(0, len(nominal) - 2)), max_size=3
    )
    for number in itertools.count():
        if subject.over:
            return

        @seed(source.randrange(1 << 32) + number)
        @settings(max_examples=_EXAMPLES, database=None, deadline=None, suppress_health_check=list(HealthCheck),
                  phases=(Phase.generate, Phase.shrink, Phase.explain))  # fmt: skip
        @given(changes=changes(), order=orders)
        def test(changes: Any, order: Any) -> None:
            if time.monotonic() > subject._end + _OVERRUN * subject.seconds:
                raise _TimeIsOver
            place = subject.fails(_reordered(_changed(nominal, changes), order))
            if place and place not in known:
                raise failures.setdefault(place, type("Failure", (Exception,), {}))(place)

        try:
            test()
        except _TimeIsOver:
            return
        except Exception as error:
            text = "".join(traceback.format_exception(error)[-1:]) + "\n".join(getattr(error, "__notes__", ()))
            subject.result.said = subject.result.said or text.replace(f"{ROOT}/", "")[-600:]
            known.update(subject.result.failures)


def atheris(subject: _Subject, nominal: Sequence[Input], source: random.Random) -> None:
    """Let Atheris look for values that reach new code; each failure is tried again in a process of its own."""
    case = subject.case
    entry = _fuzzing(case).entry
    known: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        last = Path(folder) / "log.json"
        while (left := subject.left) > 1:
            words = [str(left), str(source.randrange(1 << 31)), str(last), json.dumps(known)]
            done = subprocess.run(
                [entry, FUZZ, case.folder, *words],
                cwd=folder,  # where it leaves what it has found
                input=json.dumps(list(nominal)),
                capture_output=True,
                text=True,
                timeout=left + 60,
                check=False,
            )
            executed = re.search(r"number_of_executed_units: *(\d+)", done.stderr)
            subject.result.runs += int(executed[1]) if executed and not subject.result.met else 0
            found = [json.loads(line) for line in done.stdout.splitlines()]
            if done.returncode and last.exists():
                found.append([f"ended with {done.returncode}", json.loads(last.read_text())])
            for place, log in found:
                known.append(place)
                subject.fails(log)


PEERS = {"hypothesis": hypothesis, "dictionary": dictionary, "uniform": uniform, "atheris": atheris}


def run_peers(case: Case, *, seconds: float, seed: int) -> dict[str, PeerResult]:
    """Run all peers on a case, one after the other, each for some seconds."""
    found = {}
    fuzzing = provide(_fuzzing(case))  # first: it takes its time, which is no peer's
    for name, peer in PEERS.items():
        if peer is atheris and fuzzing:
            found[name] = PeerResult(said=f"not to be had: {fuzzing}")
            continue
        with case.program() as run:
            subject = _Subject(case, run, seconds)
            peer(subject, case.nominal, random.Random(seed))
            found[name] = subject.result
    return found


def _fuzzing(case: Case) -> Environment:
    return of_case(case.folder, more=("atheris==3.0.0",))


def _leaves(value: Any, place: Place = ()) -> Iterator[Place]:
    if isinstance(value, dict | list):
        for key, each in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _leaves(each, (*place, key))
    elif value is not None:
        yield place


def _at(value: Any, place: Place) -> Any:
    for key in place:
        value = value[key]
    return value


def _changed(nominal: Sequence[Input], changes: Sequence[tuple[int, Place, Any]]) -> list[Input]:
    log = list(nominal)
    for number, place, value in changes:
        seconds, topic, fields = log[number]
        fields = copy.deepcopy(fields)
        if place:
            _at(fields, place[:-1])[place[-1]] = value
        log[number] = (seconds, topic, fields if place else value)
    return log


def _reordered(log: list[Input], order: Sequence[tuple[str, int]]) -> list[Input]:
    for what, number in order:
        number = min(number, len(log) - 2)
        if what == "drop" and len(log) > 2:
            del log[number]
        elif what == "repeat":
            log.insert(number, log[number])
        elif number >= 0:
            first, second = log[number], log[number + 1]
            log[number : number + 2] = [(first[0], *second[1:]), (second[0], *first[1:])]
    return log


def _with_values(nominal: Sequence[Input], source: random.Random, value: Callable[[Any], Any]) -> list[Input]:
    changes = []
    for _ in range(source.randint(1, 3)):
        number = source.randrange(len(nominal))
        places = list(_leaves(nominal[number][2]))
        if places:
            place = source.choice(places)
            changes.append((number, place, value(_at(nominal[number][2], place))))
    return _changed(nominal, changes)


def _anything(before: Any, source: random.Random) -> Any:
    if isinstance(before, bool):
        return source.random() < 0.5
    if isinstance(before, int):
        return source.randint(-(1 << 63), (1 << 63) - 1) if source.random() < 0.5 else source.randint(-1000, 1000)
    if isinstance(before, float):
        raw: float = struct.unpack("<d", source.randbytes(8))[0]
        return raw if source.random() < 0.5 else before * source.uniform(-10, 10) + source.uniform(-math.pi, math.pi)
    return "".join(chr(source.randint(32, 126)) for _ in range(source.randint(0, 40)))
