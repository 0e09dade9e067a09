import numpy as np

from riot_bus.generalize.beam import learn, learn_guarded
from riot_bus.generalize.features import Feature
from riot_bus.generalize.table import Candidate

BITS = 6.0


def literals(*names: str) -> list[Candidate]:
    return [Candidate(Feature("raw", (name,)), "==", BITS, inside=True) for name in names]


def test_without_a_failure_the_rule_is_never() -> None:
    masks = np.array([[True, False, True]])
    learnt = learn(literals("a"), masks, np.zeros(3, dtype=bool))
    assert learnt.rule.text() == "never"
    assert learnt.mistakes == 0


def test_a_literal_that_always_or_never_holds_is_of_no_use() -> None:
    failed = np.array([True, True, False, False])
    masks = np.array([[True] * 4, [False] * 4, [True, True, False, False]])
    assert learn(literals("all", "none", "cause"), masks, failed).rule.text() == "cause == True"
    missed = learn(literals("all", "none"), masks[:2], failed)
    assert missed.rule.text() == "never"
    assert missed.mistakes == 2


def test_of_literals_that_hold_on_the_same_samples_the_shorter_is_taken() -> None:
    failed = np.array([True, False, True, False])
    long, short = literals("long", "short")
    long = Candidate(long.feature, "==", BITS + 3, inside=True)
    assert learn([long, short], np.array([failed, failed]), failed).rule.text() == "short == True"


def test_two_causes_and_a_joint_one_are_told_apart() -> None:
    rows = np.array([[bool(n >> bit & 1) for n in range(64)] for bit in range(4)])
    a, b, c, _ = rows
    learnt = learn(literals("a", "b", "c", "d"), rows, (a & b) | c)
    assert learnt.rule.text() == "c == True or (a == True and b == True)"
    assert learnt.mistakes == 0


def test_what_all_terms_need_is_paid_for_once() -> None:
    rows = np.array([[bool(n >> bit & 1) for n in range(128)] for bit in range(7)])
    names, a, b, c = literals(*"abcdefg"), rows[0], rows[1], rows[2]
    failed = (a | b | c) & rows[3] & rows[4]
    plain = learn(names, rows, failed)
    guarded = learn_guarded(names, rows, failed, plain)
    assert guarded.bits < plain.bits
    assert guarded.mistakes == 0
    assert guarded.rule.text() == "d == True and e == True and (a == True or b == True or c == True)"


def test_without_anything_that_all_failures_share_the_rule_stays() -> None:
    a, b = np.array([[True, True, False, False], [True, False, True, False]])
    plain = learn(literals("a", "b"), np.array([a, b]), a | b)
    assert learn_guarded(literals("a", "b"), np.array([a, b]), a | b, plain) is plain
