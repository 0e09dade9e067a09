from __future__ import annotations

import json
import math
from typing import Any

import pytest

from riot_bus.chain.base.injections import injection_of
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Curve, Formula, Injection, Signal


@pytest.mark.parametrize(
    "injection",
    [
        Injection("a", "v", math.inf, first=2, last=4, seed=7),
        Injection("a", "w", Signal(1.0, 2.0, 5, 3, integer=True, choices=("on", 2, False))),
        Injection("a", "w", Curve((0.0, 1.5), (3.0, -4.0), integer=True)),
        Injection("a", "len(xs)", Formula("2 * n", base="part")),
        Injection("b", "data", b"\x00\xff"),
        Injection("b", fault="mine", options=(("blob", b"\x00"), ("factor", 2.0))),
    ],
)
def test_what_was_written_is_read_again(injection: Injection) -> None:
    assert injection_of(json.loads(json.dumps(injection.row(), default=str)), "here") == injection


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ({"topc": "a"}, "unknown key 'topc'"),
        ({"field": "v"}, "this injection cannot be used"),
        ({"topic": "a", "value": {"x": 1}}, "this injection cannot be used"),
        ({"topic": "a", "value": "b'\\x"}, "this injection cannot be used"),
    ],
)
def test_what_is_no_injection(row: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        injection_of(row, "here")
