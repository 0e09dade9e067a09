"""What crosses to workers comes out as it went in."""

from __future__ import annotations

import errno
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.monitors.mined import Mined, MinedRule
from riot_bus.pool.wire import (
    Trial,
    TrialAnswer,
    TrialBatch,
    TrialRequest,
    nominal_of,
    pack_answer,
    pack_failure,
    read_answer,
    remember,
)
from riot_bus.processes.activity import Idle
from riot_bus.processes.python_report import ThreadStack
from riot_bus.system.system_file import RunPace
from riot_bus.trial.baseline import Baseline, Growth, NominalTrial
from riot_bus.trial.hangs import KnownHangs
from riot_bus.trial.system_trial import SystemTrial
from riot_bus.trial.unit_trial import IdleTrial, UnitTrial
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, PayloadError
from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.vocabulary.trial import Outcome, Series, TestCase, Verdict, Violation

floats = st.floats(width=64)
texts = st.text(st.characters(exclude_categories=()), max_size=8)
unicode = st.text(max_size=8)  # keys and encodings are UTF-8 on the bus
scalars = st.booleans() | st.integers() | floats | texts | st.binary(max_size=8)
signals = st.builds(
    Signal, floats, floats, st.integers(1, 9), st.integers(), st.booleans(), st.tuples(texts, st.integers(), floats)
)
curves = st.builds(Curve, st.just((0.0, 1.0)), st.tuples(floats, floats), st.booleans())
injections = st.builds(
    Injection,
    topic=texts,
    field=st.none() | texts,
    value=st.none() | scalars | signals | curves | st.builds(Formula, texts, texts),
    fault=texts,
    start=floats,
    end=st.none() | floats,
    first=st.integers(),
    last=st.none() | st.integers(),
    where=st.none() | texts,
    probability=floats,
    delay=floats,
    copies=st.integers(),
    seed=st.integers(),
    options=st.lists(st.tuples(texts, scalars), max_size=2).map(tuple),
)
messages = st.builds(
    Message,
    time=st.integers(0, 2**63),
    key=unicode,
    payload=st.binary(max_size=16),
    kind=st.sampled_from(["put", "delete"]),
    encoding=unicode,
    attachment=st.none() | st.binary(max_size=4),
    qos=st.builds(Qos, st.integers(1, 7), st.sampled_from(["drop", "block", "block_first"]), st.booleans()),
    segment=unicode,
    sequence=st.integers(),
    publish_time=st.none() | st.integers(),
)
logs = st.lists(messages, max_size=4).map(tuple)
cases = st.builds(
    TestCase, logs, st.lists(injections, max_size=3).map(tuple), st.integers(), st.integers(), st.booleans()
)
outcomes = st.builds(
    Outcome,
    verdict=st.sampled_from(list(Verdict)),
    violations=st.lists(st.builds(Violation, texts, texts, texts, texts), max_size=2).map(tuple),
    seconds=floats,
    detail=texts,
    observed=st.dictionaries(texts, st.builds(Series, st.tuples(floats), st.tuples(scalars)), max_size=2),
    log=st.none() | texts,
    statistics=st.dictionaries(texts, scalars | st.lists(st.integers()) | st.none(), max_size=3),
)


def sent(trial: Trial, case: TestCase, log: tuple[Message, ...] = ()) -> TrialRequest:
    """Send a case twice, the second time without what is shared; return what comes out."""
    known: dict[bytes, tuple[Trial, object]] = {}
    batch = TrialBatch(trial, log)
    first, again = (
        TrialRequest.read(batch.request(case, directory=Path("/x"), whole=whole, imports={"a": ["b"]}), known)  # type: ignore[arg-type]
        for whole in (True, False)
    )
    assert repr(first) == repr(again)
    assert first.directory == Path("/x")
    assert first.imports == {"a": ["b"]}
    return again


@given(cases, logs)
def test_a_case_crosses_as_it_is(case: TestCase, log: tuple[Message, ...]) -> None:
    case = replace(case, messages=case.messages + log[::-1])
    found = sent(IdleTrial("unit"), case, log).case
    assert repr(found) == repr(case)  # of NaN, the text is the same
    assert found.digest() == case.digest()


@given(outcomes, st.dictionaries(texts, st.lists(texts, max_size=2), max_size=2))
def test_an_outcome_crosses_as_it_is(outcome: Outcome, imports: dict[str, list[str]]) -> None:
    assert repr(read_answer(pack_answer(TrialAnswer(outcome, imports)))) == repr(TrialAnswer(outcome, imports))


LOG = (Message(1, "a", b"\xff"), Message(2, "b", b""))
BASELINE = Baseline(
    Idle(1.5, 0.25),
    3,
    LOG,
    LOG[:1],
    {"a": 1},
    {"a": 2},
    {"f": 1},
    {"g": 1},
    main_ends=False,
    ends=False,
    growth=Growth(1, 2, 3),
    mute=("m",),
    ordered=True,
    mined=Mined((MinedRule("value", "a", "x", (1.0, float("-inf")), (2.0, 3.0), 1000),), 6, 1, 8, ("d",)),
    alarms=("exit of u: status 0",),
)


@pytest.mark.parametrize(
    "trial",
    [
        IdleTrial("u"),
        UnitTrial("u"),
        UnitTrial("u", BASELINE, nominal=True, evidence=True, before=("gdb", "-q")),
        SystemTrial(RunPace(duration=3.0, speed=2.0), ("a:x", "b"), record=True),
        SystemTrial(RunPace(duration=3.0), unit="u", baseline=BASELINE, nominal=True),
    ],
)
def test_a_trial_crosses_as_it_is(trial: Trial) -> None:
    found = sent(trial, TestCase(LOG), LOG)
    assert found.trial == trial
    assert found.case.messages == LOG


def test_what_is_known_of_hangs_crosses_both_ways() -> None:
    hangs = {"u": KnownHangs((((), ("spin", "main")), ()), 0.75), "v": KnownHangs()}
    data = TrialBatch(IdleTrial("u"), ()).request(TestCase(), directory=Path("/x"), whole=True, imports={}, hangs=hangs)
    assert TrialRequest.read(data, {}).hangs == hangs
    answer = TrialAnswer(Outcome(Verdict.PASS), {}, hangs)
    assert read_answer(pack_answer(answer)) == answer


def test_messages_of_the_log_go_over_once() -> None:
    log = tuple(Message(number, "a", bytes(1000)) for number in range(50))
    batch = TrialBatch(UnitTrial("u", replace(BASELINE, log=log)), ())
    assert len(batch.shared) < 60_000
    assert len(batch.request(TestCase(log[10:]), directory=Path("/x"), whole=False, imports={})) < 1000


def test_messages_of_the_last_case_are_looked_up_once(monkeypatch: pytest.MonkeyPatch) -> None:
    log = tuple(Message(number, "a", bytes(9)) for number in range(50))
    trial = UnitTrial("u", replace(BASELINE, log=log))
    batch, known = TrialBatch(trial, ()), dict[bytes, tuple[Trial, tuple[Message, ...]]]()
    part = (*log[10:], Message(7, "b", b""))

    def requested(messages: tuple[Message, ...]) -> tuple[int, TestCase]:
        data = batch.request(TestCase(messages), directory=Path("/x"), whole=not known, imports={})
        return len(data), TrialRequest.read(data, known).case

    for messages in (log, (*log[:1], *log[1:]), part):
        assert requested(messages)[1] == TestCase(messages)
    monkeypatch.setattr(Message, "__hash__", lambda self: pytest.fail("it was looked up"))
    assert requested(part)[1] == TestCase(part)
    size, case = requested((*log[:1], *log[1:]))
    assert size < 250
    assert case.messages is requested(log)[1].messages  # so whoever works on them can know them again


def test_the_oldest_log_is_forgotten() -> None:
    known: dict[bytes, int] = {}
    for number in range(10):
        remember(known, bytes([number]), number)
    assert list(known.values()) == list(range(6, 10))


def test_a_nominal_trial_crosses_in_its_outcome() -> None:
    stack = ThreadStack(("f", "g"), "text")
    seen = NominalTrial({"a": 1}, {"a": 2}, (stack,), True, None, Growth(1, 2, 3), ("m",), LOG, 1)
    answer = read_answer(pack_answer(TrialAnswer(Outcome(Verdict.PASS, statistics={"nominal": seen}))))
    found = nominal_of(answer.outcome)
    assert replace(found, stacks=tuple(found.stacks)) == seen


@pytest.mark.parametrize("kind", [ConfigError, EnvironmentFaultError, PayloadError])
def test_an_error_is_raised_on_the_other_side(kind: type[ConfigError]) -> None:
    with pytest.raises(kind) as raised:
        read_answer(pack_failure(kind("wrong", where="here", hint="mend it"), "trace"))
    assert str(raised.value) == "here: wrong\n  hint: mend it"


def test_errors_of_other_kinds_are_told_with_their_traceback() -> None:
    with pytest.raises(OSError, match="No space") as raised:
        read_answer(pack_failure(OSError(errno.ENOSPC, "No space left", "file"), "trace"))
    assert (raised.value.errno, raised.value.filename) == (errno.ENOSPC, "file")
    with pytest.raises(RuntimeError, match="where it was"):
        read_answer(pack_failure(ZeroDivisionError("by zero"), "where it was"))


@given(st.binary(max_size=64))
def test_what_is_no_answer_is_refused(data: bytes) -> None:
    with pytest.raises(RuntimeError):
        read_answer(data)
