from __future__ import annotations

import pytest
import zenoh

from riot_bus.router.services.call import Call, encoding_text, payload_of
from riot_bus.vocabulary.message import Message


class Asked:
    def __init__(self, payload: bytes | None) -> None:
        self.payload = None if payload is None else zenoh.ZBytes(payload)


@pytest.mark.parametrize(
    ("asked", "payload", "expected"),
    [(None, b"", None), (None, b"x", b"x"), (b"", b"", b""), (b"a", b"", b""), (b"a", b"a", b"a")],
)
def test_no_payload_stays_none_unless_somebody_gives_one(
    asked: bytes | None, payload: bytes, expected: bytes | None
) -> None:
    query = Asked(asked)
    assert Call(query, None, 1, {}).payload(Message(0, "k/@request", payload)) == expected
    assert payload_of(query) == (asked or b"")


def test_the_default_encoding_is_empty_in_messages() -> None:
    assert encoding_text(None) == ""
    assert encoding_text(zenoh.Encoding("zenoh/bytes")) == ""
    assert encoding_text(zenoh.Encoding("text/plain;utf-8")) == "text/plain;utf-8"
