"""What tests of faults have in common: asking a bus whether its counts balance, and components what they got."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import psutil

from riot_bus.pipeline.runner import Pipeline
from riot_bus.router.bus import Bus
from riot_bus.types.registry import TypeRegistry
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet

SEGMENTS: dict[str, tuple[str, ...]] = {"system": (), "unit": ()}
MIB = 1 << 20


def pipeline(*interceptors: object, registry: TypeRegistry | None = None) -> Pipeline:
    return Pipeline(interceptors, registry=registry or TypeRegistry())


def assert_balanced(bus: Bus) -> None:
    assert_rows_balance({topic: asdict(each) for topic, each in bus.counts().items()})


def assert_rows_balance(rows: Mapping[str, Mapping[str, Any]]) -> None:
    """Check every topic; that there are any is for the test to check."""
    for topic, row in rows.items():
        assert min(row.values()) >= 0, (topic, row)
        assert row["received"] + row["added"] == row["forwarded"] + row["dropped"] + row["lost"] + row["held"], (
            topic,
            row,
        )


def rss() -> int:
    return int(psutil.Process().memory_info().rss)


def everything(count: int) -> dict[str, object]:
    return {"count": count, "ordered": True, "different": count}


def payloads(samples: list[dict[str, str]], key: str) -> list[bytes]:
    return [bytes.fromhex(each["payload"]) for each in samples if each["key"] == key]


def subscribed(bus: Bus, segment: str, *keys: str) -> None:
    assert bus.wait_subscribed(segment, list(keys), timeout=60) == []


def received(bus: Bus, topic: str) -> int:
    counts = bus.counts().get(topic)
    return counts.received if counts is not None else 0


def crosses(source: Puppet, sink: Puppet, key: str, text: str) -> bool:
    """Send a message again and again until it arrives, since clients may still be connecting."""

    def crossed() -> bool:
        source.do("put_texts", key=key, payloads=[text], congestion="BLOCK")
        return text.encode() in payloads(sink.do("wait", count=1, timeout=0.02), key)

    return wait_until(crossed, 60, interval=0.02)
