from __future__ import annotations

from dataclasses import replace

import pytest

from riot_bus.vocabulary.message import Message, Qos

MESSAGE = Message(1, "a", b"x", "put", "json", b"y", Qos(1), "system", 7, 2)


def test_copies_differ_by_what_is_asked_alone() -> None:
    assert MESSAGE.with_(key="b") == replace(MESSAGE, key="b")
    assert MESSAGE.with_payload(b"z") == replace(MESSAGE, payload=b"z")
    assert MESSAGE.sent(5, Qos(express=True)) == replace(MESSAGE, time=5, qos=Qos(express=True))


def test_the_digest_is_of_what_a_receiver_sees() -> None:
    same = replace(MESSAGE, time=9, sequence=8, publish_time=None, segment="unit", qos=Qos())
    assert MESSAGE.digest() == same.digest()


@pytest.mark.parametrize(
    "changes",
    [
        {"key": "b"},
        {"payload": b"yx"},
        {"kind": "delete"},
        {"encoding": "jsonx", "attachment": b""},
        {"attachment": None},
    ],
)
def test_the_digest_follows_what_a_receiver_sees(changes: dict[str, object]) -> None:
    assert MESSAGE.digest() != MESSAGE.with_(**changes).digest()
