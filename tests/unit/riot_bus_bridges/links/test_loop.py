"""The thread of the links."""

from __future__ import annotations

import os
import threading

import pytest

from riot_bus_bridges.links.loop import READ, WRITE, Loop


def test_descriptors_and_times_are_waited_for(caplog: pytest.LogCaptureFixture) -> None:
    loop = Loop()
    reader, writer = os.pipe()
    said: list[str] = []
    bell = threading.Event()

    def read(events: int) -> None:
        said.append(os.read(reader, 10).decode())
        if said[-1] == "bad":
            raise ValueError("a handler")
        loop.later(0.0, lambda: said.append("now"))
        loop.later(0.01, bell.set)

    loop.watch(reader, read)
    never = loop.later(0.02, lambda: said.append("never"))
    never.cancel()
    loop.start()
    os.write(writer, b"bad")
    while not said:
        bell.wait(0.001)
    os.write(writer, b"good")
    assert bell.wait(20)
    late = threading.Event()
    loop.later(0.05, late.set)
    assert late.wait(20)
    assert said == ["bad", "good", "now"]
    assert "a handler" in caplog.text
    loop.forget(reader)
    loop.forget(reader)
    loop.close()
    for descriptor in (reader, writer):
        os.close(descriptor)


def test_other_events_can_be_waited_for() -> None:
    loop = Loop()
    reader, writer = os.pipe()
    seen: list[int] = []
    bell = threading.Event()

    def handle(events: int) -> None:
        seen.append(events)
        loop.change(writer, 0)
        bell.set()

    loop.watch(writer, handle, 0)
    loop.start()
    assert not bell.wait(0.05)
    loop.change(writer, WRITE)
    assert bell.wait(20)
    bell.clear()
    os.close(reader)  # a broken pipe can be read, so that its end is seen
    assert bell.wait(20)
    assert seen[0] == WRITE
    assert seen[1] & READ
    loop.close()
    os.close(writer)
