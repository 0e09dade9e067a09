"""Units that do not check their payloads, as people's nodes: their faults are found, and found first, in 100 trials."""

from __future__ import annotations

import json
import math
from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest

from riot_bus.campaign.campaign import CampaignSettings, run_campaign
from riot_bus.campaign.covering import Covering
from riot_bus.campaign.malformed import fixed_lengths, malformations
from riot_bus.campaign.schedule import Schedule, message_faults, positions_of
from riot_bus.campaign.targets import targets_of, with_observed
from riot_bus.campaign.triage import FIXED, Failure
from riot_bus.inject.apply import inject_log
from riot_bus.inject.dictionary import load_dictionary
from riot_bus.types.learnt import learn_types
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message
from riot_bus.vocabulary.trial import Outcome, TestCase, Verdict, Violation

Fields = dict[str, Any]
Log = Iterator[tuple[str, Fields]]


def sentence(body: str) -> str:
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}\r\n"


def covariances() -> Log:
    for n in range(60):
        yield "cov", {"data": [1.5 + 0.01 * n, 0, 0, 0, 2.5, 0]}


def covariance(_: str, m: Fields) -> None:
    """Fail if any element is not finite; nominally most are written as integers."""
    if not all(math.isfinite(each) for each in m["data"]):
        raise ValueError("covariance is not finite")


def loads() -> Log:
    for n in range(60):
        yield "load", {"left": 20.5 + n % 7, "right": 21.5 + n % 5, "name": "arm", "note": "ok"}


def load(_: str, m: Fields) -> None:
    """Fail if two fields together are too large."""
    left, right, _name = m["left"], m["right"], m["name"].upper()
    if left + right > 100:
        raise ArithmeticError("overloaded")


def drives() -> Log:
    for n in range(60):
        yield "drive", {"speed": 2.5 * math.sin(n / 5), "source": "panel", "gear": 1 + n % 3}
        yield "battery", {"level": 80.5 - n / 10, "temps": [30.5, 31.5, 32.5], "cells": [4, 4, 4], "serial": "b7"}


def drive(topic: str, m: Fields) -> None:
    """Fail easily at one field, and elsewhere seldom."""
    if topic == "drive":
        [0.0, 0.5, 1.0, 1.5][int(abs(m["speed"]))]
    elif m["level"] <= 0 or m["temps"][2] > 120:
        raise RuntimeError("battery")


def sentences() -> Log:
    for n in range(60):
        yield "nmea", {"line": sentence(f"GPXYZ,{n:06},5{n % 10}.5,7.25,1")}


def position(_: str, m: Fields) -> None:
    """Refuse what has a wrong check sum, and fail if the third part is no number though it is right."""
    body, _, total = m["line"].strip().removeprefix("$").rpartition("*")
    parts = body.split(",")
    if sentence(body).strip() == f"${body}*{total}" and parts[0] == "GPXYZ" and len(parts) >= 5:
        float(parts[2])


class Unit:
    """A runner for a unit that ends at its first exception."""

    parallelism = 2

    def __init__(self, handler: Callable[[str, Fields], None], registry: TypeRegistry) -> None:
        self._handler, self._registry = handler, registry

    def run(self, cases: Sequence[TestCase]) -> list[Outcome]:
        return [self._run(case) for case in cases]

    def _run(self, case: TestCase) -> Outcome:
        reached, ahead = list[list[int]](), list[int]()
        messages, _ = inject_log(case.messages, case.injections, registry=self._registry, reached=reached, ahead=ahead)
        violations: tuple[Violation, ...] = ()
        sent = 0
        while sent < len(messages) and not violations:
            message, sent = messages[sent], sent + 1
            try:
                self._handler(message.key, json.loads(message.payload))
            except Exception as error:
                violations = (Violation("crash", "unit", f"crash in unit: {type(error).__name__}"),)
        turns = bisect_left(ahead, sent) if violations else len(case.messages)
        delivered = [sum(number < turns for number in each) for each in reached]
        statistics = {"played": sent, "outputs": sent, "delivered": delivered}
        return Outcome(Verdict.FAIL if violations else Verdict.PASS, violations, seconds=0.01, statistics=statistics)


def campaign(log: Log, handler: Callable[[str, Fields], None], seed: int) -> tuple[dict[str, Failure], Covering]:
    messages = [Message(10**9 + n * 10**7, topic, json.dumps(fields).encode()) for n, (topic, fields) in enumerate(log)]
    registry = TypeRegistry()
    learn_types(messages, registry)
    schedule = Schedule(with_observed(targets_of(messages, registry), messages, registry), load_dictionary(), seed=seed)
    schedule.types |= dict.fromkeys(fixed_lengths(messages, registry), FIXED)
    items = [*schedule.items(), *message_faults(messages, registry), *malformations(messages, registry)]
    covering = Covering(items, positions_of(messages, registry), seed=seed)
    settings = CampaignSettings(seed=seed, trials=100)
    result = run_campaign(messages, schedule, Unit(handler, registry), settings, covering=covering)
    return {name.rpartition(" ")[2]: failure for name, failure in result.failures.items()}, covering


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("log", "handler", "faults"),
    [
        (covariances, covariance, {"ValueError"}),
        (loads, load, {"ArithmeticError"}),
        (sentences, position, {"ValueError"}),
    ],
)
def test_what_plausible_messages_cause_is_told_apart_from_what_malformed_ones_do(
    log: Callable[[], Log], handler: Callable[[str, Fields], None], faults: set[str], seed: int
) -> None:
    failures, covering = campaign(log(), handler, seed)
    plausible = {name for name, failure in failures.items() if not failure.malformed}
    assert plausible
    assert plausible <= faults
    assert len(failures) > len(plausible)
    assert next(iter(failures)) in plausible
    assert covering.covered > 0.6 * covering.total


@pytest.mark.parametrize("seed", range(3))
def test_a_fault_that_comes_easily_leaves_trials_for_others(seed: int) -> None:
    failures, covering = campaign(drives(), drive, seed)
    assert {name for name, failure in failures.items() if not failure.malformed} >= {"IndexError", "RuntimeError"}
    tried = Counter(item.about for item, _ in covering.tried)
    for about in ("drive:source", "drive:gear", "battery:cells[*]", "battery:serial", "battery:temps[*]"):
        left = [item for item in covering.undecided if item.about == about]
        assert tried[about] > 30, about
        assert not left
