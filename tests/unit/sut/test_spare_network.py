"""A network that waits for the next trial, and is closed when the next trial needs another one."""

from __future__ import annotations

from riot_bus.router.bus import Bus
from riot_bus.sut.spare_network import SpareNetwork
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.session import wait_until

SEGMENTS = ["inside", "outside"]


def test_the_next_trial_gets_the_network_that_was_prepared_and_may_cut_the_same_keys() -> None:
    spare = SpareNetwork()
    spare.prepare()  # nobody has said yet what is needed
    first = spare.take(SEGMENTS, ["cut/**"], wait_before_close_s=3.0)
    assert not first.segments
    spare.prepare()
    spare.prepare()
    second = spare.take(SEGMENTS, ["cut/**"], wait_before_close_s=3.0)
    assert set(second.segments) == set(SEGMENTS)
    assert (second is first, second.wait_before_close_s) == (False, 3.0)
    got: list[str] = []
    with Bus(second, intercept=["cut/**"]) as bus:
        bus.subscribe("inside", "**", lambda message: got.append(message.key))
        for key in ("cut/a", "free/b"):
            bus.put("outside", Message(0, key, b"1"))
        assert wait_until(lambda: len(got) == 2, 10)
        assert bus.intercepted == ["cut/**"]
    assert sorted(got) == ["cut/a", "free/b"]
    assert not second.sessions or all(session.is_closed() for session in second.sessions.values())


def test_a_network_of_another_kind_is_closed() -> None:
    spare = SpareNetwork()
    spare.take(SEGMENTS, [], wait_before_close_s=3.0)
    spare.prepare()
    waiting = spare._spare[1] if spare._spare else None
    assert waiting is not None
    other = spare.take(SEGMENTS, ["cut/**"], wait_before_close_s=3.0)
    assert not other.segments
    assert all(session.is_closed() for session in waiting.sessions.values())
    spare.prepare()
    spare.close()
    assert not spare.take(SEGMENTS, ["cut/**"], wait_before_close_s=3.0).segments
    spare.close()
