from __future__ import annotations

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.vocabulary.errors import ConfigError, did_you_mean
from riot_bus.vocabulary.injection import Injection, Signal
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.selector import Selector, check_wildcards, key_matches, parse_selector, split_field
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation
from riot_bus.zenoh.session import canonical
from tests.manual_clock import ManualClock

chunk = st.sampled_from(["a", "b", "ab", "aab", "aba", "@v", "@va", "a.b", "std_msgs::msg::String_"])
wild = st.sampled_from(["a", "b", "*", "**", "a$*", "$*b", "a$*a", "$*a$*b$*", "@v"])


@given(st.lists(wild, min_size=1, max_size=7), st.lists(chunk, min_size=1, max_size=7))
def test_key_matches_as_zenoh_does(expression: list[str], key: list[str]) -> None:
    text = str(zenoh.KeyExpr.autocanonize("/".join(expression)))
    assert key_matches(text, "/".join(key)) == zenoh.KeyExpr(text).intersects(zenoh.KeyExpr("/".join(key)))


@pytest.mark.parametrize("expression", ["$*a" * 40 + "$*c", "**/a/" * 40 + "c", "**/$*a$*a$*a$*a$*a$*c/" * 40 + "c"])
def test_many_wildcards_take_no_longer_than_the_key_is_long(expression: str) -> None:
    key = "/".join(["a" * 100] * 100)  # by backtracking this would not end within a lifetime
    assert not key_matches(expression, key + "/b")
    assert not key_matches(expression, "a" * 60_000)


@pytest.mark.parametrize(
    ("text", "selector"),
    [
        ("/odom", Selector("/odom")),
        ("/odom:twist.twist.linear.x", Selector("/odom", "twist.twist.linear.x")),
        ("a/**:len(ranges)", Selector("a/**", "len(ranges)")),
        ("cmd:v[3].x where mode == 2", Selector("cmd", "v[3].x", "mode == 2")),
        ("0/odom/nav_msgs::msg::dds_::Odometry_/*:pose", Selector("0/odom/nav_msgs::msg::dds_::Odometry_/*", "pose")),
    ],
)
def test_selectors(text: str, selector: Selector) -> None:
    assert parse_selector(text) == selector
    assert parse_selector(str(selector)) == selector


@pytest.mark.parametrize(
    ("expression", "whole"),
    [
        ("x/$*a$*a", False),
        ("x/" + "$*a" * 8 + "$*b", False),
        ("a$*b$*c/x", False),
        ("**/a/**/b", False),
        ("**/" + "a/" * 32 + "b", False),
        ("@riot/$*a$*b/agent/status", False),
        ("*/robot/**/$*::dds_::$*/*/**", True),
        ("**/x/**", True),
        ("c$*t/x$*/$*y$*", True),
        ("a/" * 400 + "**", True),
        ("**/" + "a/" * 30 + "b", True),
    ],
)
def test_expressions_that_zenoh_would_take_long_to_match_are_refused(expression: str, whole: bool) -> None:
    for check in (lambda: check_wildcards(expression), lambda: canonical([expression])):  # all that riot hands over
        if whole:
            check()
            continue
        with pytest.raises(ConfigError, match="too many wildcards") as caught:
            check()
        assert "at most one $*" in (caught.value.hint or "")


@given(st.text("a:\n"))
def test_a_topic_ends_at_the_first_colon_that_stands_alone(text: str) -> None:
    topic, field = split_field(text)
    assert topic.replace("::", "").count(":") == 0
    assert text in (topic, f"{topic}:{field}")


def test_a_topic_of_many_colons_is_read_in_a_time_that_grows_with_it() -> None:
    assert split_field("a::" * (1 << 20) + "b:c") == ("a::" * (1 << 20) + "b", "c")  # took minutes


@pytest.mark.parametrize("text", ["", ":x", "a:", "a:b..c", "a:1x", "a:b[" + "1" * 5000 + "]"])
def test_wrong_selectors(text: str) -> None:
    with pytest.raises(ConfigError):
        parse_selector(text)


@given(st.integers(0, 500), st.integers(1, 9), st.integers(0, 9))
def test_signals_are_held_bounded_and_stateless(index: int, hold: int, seed: int) -> None:
    signal = Signal(10.0, 2.0, hold=hold, seed=seed)
    assert 8.0 <= signal.value(index) <= 12.0
    assert signal.value(index) == signal.value(index // hold * hold) == Signal(10.0, 2.0, hold, seed).value(index)


def test_digest_follows_whatever_decides_the_outcome() -> None:
    message = Message(1, "k", b"x")
    case = TestCase((message,), (Injection("k", "f", 1),), seed=1)
    same = TestCase((message.with_(time=9, sequence=7),), (Injection("k", "f", 1),), seed=1)
    assert case.digest() == same.digest()
    others = [
        TestCase((message.with_(payload=b"y"),), case.injections, seed=1),
        TestCase((message.with_(attachment=b""),), (Injection("k", "f", 2),), seed=1),
        TestCase((message,), case.injections, seed=2),
        TestCase((message, message), case.injections, seed=1),
    ]
    assert len({case.digest(), *(other.digest() for other in others)}) == 5


def test_digests_of_stored_trials_stay_and_options_of_faults_count() -> None:
    plain = (Injection("a", "x", 1.0), Injection("a", fault="drop"))
    assert TestCase((), plain, 3).digest() == "0977dd7218231dfb36cacf327ff70941"  # campaigns of earlier versions resume
    log = (Message(1, "a", b"x", attachment=b"y"), Message(5, "b", b"", "delete", "text/plain"))
    for _ in range(2):
        assert TestCase(log, (), 3).digest() == "4221f71f972e4c33a64b2aca954beaf0"
        assert TestCase(log, (), 3, paced=True).digest() == "12befe1e01e28dcc7f442f8f969e28d5"
        assert TestCase((), plain, 3).digest() == "0977dd7218231dfb36cacf327ff70941"
    assert "options" not in plain[0].row()
    cases = [TestCase((), (Injection("a", fault="f", options=(("n", number),)),)) for number in range(3)]
    assert len({case.digest() for case in cases}) == 3


def test_the_log_of_many_cases_is_hashed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    hashed: list[Message] = []
    digest = Message.digest
    monkeypatch.setattr(Message, "digest", lambda self: hashed.append(self) or digest(self))
    log = (Message(1, "a", b"x"), Message(2, "a", b"y"))
    cases = [TestCase(log, seed=seed) for seed in range(3)]
    digests = [case.digest() for case in cases]
    assert (len(set(digests)), len(hashed)) == (3, 2)
    copies = [TestCase(log[:1] + log[1:], seed=seed) for seed in range(3)]
    assert [case.digest() for case in copies] == digests


def test_failing_as() -> None:
    failed = Outcome(Verdict.FAIL, (Violation("crash", "a", "s"), Violation("hang", "b", "t")))
    assert failed.failed_as("t")
    assert failed.failed_as(None)
    assert not failed.failed_as("u")
    assert not Outcome(Verdict.ERROR).failed_as(None)


@pytest.mark.parametrize(
    ("monitor", "seen", "known", "same"),
    [
        ("hang", "hang of n", "hang of n: in f", True),
        ("hang", "hang of n: in f", "hang of n: in f in g", False),
        ("crash", "crash in n: SIGSEGV", "crash in n: SIGSEGV in f < g", True),
        ("crash", "crash in n: f: return x", "crash in n: f: return x in seen", False),
        ("log", "log of n: [ERROR] nav", "log of n: [ERROR] nav: lost", False),
        ("log", "log of n: no way", "log of n: no way in map", False),
    ],
)
def test_only_a_failure_whose_place_is_unknown_is_taken_for_one_with_a_place(
    monitor: str, seen: str, known: str, same: bool
) -> None:
    failed = Outcome(Verdict.FAIL, violations=(Violation(monitor, "n", seen),))
    assert failed.failed_as(known) is same
    assert failed.violation_as(known) == (failed.violations[0] if same else None)


def test_hints_and_clock() -> None:
    assert did_you_mean("segmets", ["segments", "types"]) == "did you mean 'segments'?"
    assert did_you_mean("zzz", ["a"]) == "known: a"
    clock = ManualClock(5)
    clock.sleep_until(3)
    clock.advance(1)
    clock.sleep_until(9)
    assert clock.now() == 9
