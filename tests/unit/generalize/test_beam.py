import numpy as np

from riot_bus.generalize.beam import learn
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
