"""Changes of nominal inputs, for the truths of cases."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable, Sequence
from typing import Any

Input = tuple[float, str, Any]


def nth(log: Sequence[Input], topic: str, number: int = -1) -> int:
    """Return the index of the nth input of a topic in a log."""
    return [index for index, each in enumerate(log) if each[1] == topic][number]


def changed(log: Sequence[Input], topic: str, number: int = -1, **fields: Any) -> list[Input]:
    """Return a log in which fields of the nth input of a topic are replaced."""
    found, index = copy.deepcopy(list(log)), nth(log, topic, number)
    seconds, _, before = found[index]
    found[index] = (seconds, topic, {**before, **fields})
    return found


def without(log: Sequence[Input], topic: str, number: int = -1, count: int = 1) -> list[Input]:
    """Return a log that lacks some inputs of a topic, from the nth on."""
    places = [index for index, each in enumerate(log) if each[1] == topic]
    first = number % len(places)
    lost = set(places[first : first + count])
    return [each for index, each in enumerate(log) if index not in lost]


def near(source: random.Random, *limits: float) -> float:
    """Return a number at, just beside, or around one of some limits."""
    limit = source.choice(limits)
    beside = [math.nextafter(limit, math.inf), math.nextafter(limit, -math.inf), limit, limit]
    width = max(1.0, abs(limit))
    around = [limit + source.uniform(-1, 1) * width * 10 ** source.uniform(-6, 0.5) for _ in range(4)]
    return source.choice(beside + around)


def near_integer(source: random.Random, *limits: int) -> int:
    """Return an integer at, just beside, or around one of some limits."""
    limit = source.choice(limits)
    return limit + source.choice([0, 0, 1, -1, source.randint(-20, 20), source.randint(-1000, 1000)])


def drawn(
    source: random.Random, log: Sequence[Input], topic: str, most: int = 1, **fields: Callable[[], Any]
) -> list[Input]:
    """Return a log in which some inputs of a topic have new fields, each from its function."""
    found = list(log)
    places = [index for index, each in enumerate(log) if each[1] == topic]
    for index in source.sample(places, min(len(places), source.randint(1, most))):
        chosen = source.sample(sorted(fields), source.randint(1, len(fields)))
        seconds, _, before = found[index]
        found[index] = (seconds, topic, {**before, **{name: fields[name]() for name in chosen}})
    return found
