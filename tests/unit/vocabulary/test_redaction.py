from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.vocabulary.redaction import redacted

SECRET = st.text("abcdefXYZ0123456789;=+/_-.", min_size=8).map(lambda text: f"KEY{text}")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("tls/host:1#a=b;c=d", "tls/host:1#..."),
        (
            "segment a listens on tls/[::1]:7447#x=/etc/key and tcp/h:1",
            "segment a listens on tls/[::1]:7447#... and tcp/h:1",
        ),
        ("a=quic/h:1#x,tls/h:2#y", "a=quic/h:1#...,tls/h:2#..."),
        ("'unixsock-stream//tmp/a.sock?rel=1#z'", "'unixsock-stream//tmp/a.sock?rel=1#...'"),
        ("s3://key:secret@bucket/log.mcap", "s3://...@bucket/log.mcap"),
        ("issue #7 of tcp/h:1", "issue #7 of tcp/h:1"),
        ("tcp/127.0.0.1:7447", "tcp/127.0.0.1:7447"),
        ("", ""),
    ],
)
def test_what_an_endpoint_holds_is_not_shown(text: str, shown: str) -> None:
    assert redacted(text) == shown
    assert redacted(shown) == shown


@given(SECRET, st.sampled_from(["message", "where", "hint"]))
def test_no_error_tells_what_stands_behind_an_endpoint(secret: str, place: str) -> None:
    endpoint = f"tls/h:1#connect_private_key_base64={secret}"
    texts = {"message": "no", "where": None, "hint": None, place: f"not {endpoint!r}, nor {endpoint}"}
    error = EnvironmentFaultError(str(texts["message"]), where=texts["where"], hint=texts["hint"])
    assert secret not in f"{error} {error.args} {error.message} {error.where} {error.hint}"
