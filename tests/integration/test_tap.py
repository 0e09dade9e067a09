"""What is routed natively and recorded: all of it, in order, however fast it comes."""

from __future__ import annotations

import itertools

import pytest

from riot_bus.router.tap import Tap
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.convert import Converter
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import wait_until

pytestmark = pytest.mark.integration

BLOCK = Qos(congestion="block")
WAIT_S = 60.0


def test_a_tap_sees_every_message_in_order_and_survives_what_its_user_raises() -> None:
    seen: list[int] = []

    def take(message: Message) -> None:
        seen.append(int(message.payload))
        if len(seen) == 100:
            raise RuntimeError("on purpose")

    with Network({"unit": ()}) as network:
        segment = network.segments["unit"]
        tap = Tap(segment.session, "tapped/*", take=take, convert=Converter("unit", itertools.count()))
        with open_client(segment.endpoints[0]) as client:
            client.declare("tapped/k", BLOCK)
            assert wait_until(tap.idle, WAIT_S)
            for number in range(50_000):
                client.put(Message(0, "tapped/k", str(number).encode(), qos=BLOCK))
            client.put(Message(0, "other/k", b"0", qos=BLOCK))
            assert wait_until(lambda: len(seen) == 50_000 and tap.idle(), WAIT_S)
        tap.close()
        tap.close()
        assert tap.idle()
    assert seen == list(range(50_000))


def test_a_tap_ends_with_its_session() -> None:
    with Network({"unit": ()}) as network:
        segment = network.segments["unit"]
        tap = Tap(segment.session, "**", take=lambda message: None, convert=Converter("unit", itertools.count()))
    tap.close()
    assert tap.idle()
