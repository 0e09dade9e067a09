"""Synthetic nominal trials of a rover, and faults put into them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

from riot_bus.monitors.model import ComponentView, TrialView
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message

START = 1_700_000_000 * 10**9
REGISTRY = TypeRegistry()


def nominal(seed: int, *, messages: int = 30) -> TrialView:
    """Return a trial with noise, jitter, lost outputs, an occasional late output, constants, flags and counters."""
    random = Random(seed)
    begin = START + random.randrange(10**15)
    inputs = [Message(begin + 10**8 * (number + 1), "odom", b"{}") for number in range(messages)]
    outputs = []
    for number, message in enumerate(inputs):
        time = message.time + round(random.lognormvariate(2, 0.6) * 1e6) + (random.random() < 0.002) * 3 * 10**8
        angle = random.gauss(0, 0.3) + number / 10
        twist: dict[str, Any] = {
            "stamp": {"sec": time // 10**9, "nanosec": time % 10**9},
            "count": number,
            "speed": 1 + math.sin(number / 5) + random.gauss(0, 0.1),
            "wild": random.expovariate(1.0),
            "zero": 0.0,
            "flag": random.random() < 0.02,
            "mode": 3,
            "ranges": [random.uniform(0.5, 8) for _ in range(6)],
            "pose": {"x": 0.0, "y": 0.0, "z": math.sin(angle / 2), "w": math.cos(angle / 2)},
        }
        if random.random() > 0.005:
            outputs.append(Message(time, "cmd", json.dumps(twist).encode()))
        if number % 5 == 0:
            battery = {"level": 90 - number * 0.01 + random.gauss(0, 0.02), "cells": 4}
            outputs.append(Message(time + 1000, "battery", json.dumps(battery).encode()))
    end = max(message.time for message in outputs) + 3 * 10**8
    view = ComponentView("unit", None, "", Path("/"))
    ordered = sorted(outputs, key=lambda message: message.time)
    return TrialView([view], True, 1.0, REGISTRY, ordered, begin, end, inputs=inputs)


def changed(view: TrialView, topic: str, change: Callable[[dict[str, Any], int], Any], *, start: int = 10) -> TrialView:
    """Return a copy in which messages of a topic are changed, from one on; what is None is left out."""
    outputs = []
    for number, message in enumerate(view.outputs):
        document = json.loads(message.payload)
        if message.key == topic and number >= start:
            document = change(document, number)
        if document is not None:
            payload = document if isinstance(document, bytes) else json.dumps(document).encode()
            outputs.append(message.with_payload(payload))
    return replace(view, outputs=outputs)


def _set(path: str, value: Any) -> Callable[[dict[str, Any], int], Any]:
    def change(document: dict[str, Any], number: int) -> dict[str, Any]:
        *parents, name = path.split(".")
        inner = document
        for parent in parents:
            inner = inner[parent]
        inner[name] = value(inner[name]) if callable(value) else value
        return document

    return change


FAULTS: dict[str, Callable[[TrialView], TrialView]] = {
    "nan": lambda view: changed(view, "cmd", _set("speed", math.nan)),
    "infinite": lambda view: changed(view, "battery", _set("level", math.inf)),
    "huge": lambda view: changed(view, "cmd", _set("speed", 1e6)),
    "ten times": lambda view: changed(view, "cmd", _set("speed", lambda it: it * 10)),
    "reversed": lambda view: changed(view, "cmd", _set("speed", lambda it: -it)),
    "battery at zero": lambda view: changed(view, "battery", _set("level", 0.0)),
    "stuck": lambda view: changed(view, "cmd", _set("speed", 1.0)),
    "offset by its range": lambda view: changed(view, "cmd", _set("speed", lambda it: it + 2.2)),
    "silent": lambda view: replace(changed(view, "cmd", lambda it, n: None), end=view.end + 5 * 10**9),
    "stops": lambda view: changed(view, "cmd", lambda it, n: None, start=12),
    "every second one lost": lambda view: changed(view, "cmd", lambda it, n: it if n % 2 else None),
    "one lost": lambda view: changed(view, "cmd", lambda it, n: it if n != 15 else None),
    "flood": lambda view: replace(view, outputs=sorted([*view.outputs] * 3, key=lambda message: message.time)),
    "stamps of the past": lambda view: changed(view, "cmd", _set("stamp.sec", lambda it: it - 100)),
    "stamps are zero": lambda view: changed(view, "cmd", _set("stamp.sec", 0)),
    "counter begins anew": lambda view: changed(view, "cmd", _set("count", lambda it: it % 7)),
    "no unit quaternion": lambda view: changed(view, "cmd", _set("pose.w", lambda it: it * 3)),
    "zero quaternion": lambda view: changed(view, "cmd", _set("pose", {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0})),
    "garbage": lambda view: changed(view, "cmd", lambda it, n: b"\xff\x00"),
    "no ranges": lambda view: changed(view, "cmd", _set("ranges", [])),
    "negative ranges": lambda view: changed(view, "cmd", _set("ranges", [-50.0] * 6)),
    "mode unknown": lambda view: changed(view, "cmd", _set("mode", 77)),
    "mode next": lambda view: changed(view, "cmd", _set("mode", 4)),
    "cells missing": lambda view: changed(view, "battery", _set("cells", 0)),
}
