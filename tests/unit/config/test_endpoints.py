from __future__ import annotations

import pytest

from riot_bus.config.endpoints import Endpoint, overlap, parse_endpoint, split_endpoints
from riot_bus.vocabulary.errors import ConfigError


def test_an_endpoint_has_parts_and_is_written_as_it_was() -> None:
    text = "tls/[::1]:7447?rel=1#key=a;flag"
    found = parse_endpoint(text)
    assert found == Endpoint("tls", "[::1]:7447", "rel=1", "key=a;flag")
    assert (str(found), found.host, found.port) == (text, "::1", 7447)
    assert found.parameters == {"key": "a", "flag": ""}
    assert str(found.with_parameters({"a": "1", "b": ""})) == "tls/[::1]:7447?rel=1#a=1;b"


@pytest.mark.parametrize(
    ("text", "local", "wildcard"),
    [
        ("tcp/localhost:1", True, False),
        ("tcp/127.0.0.2:1", True, False),
        ("tcp/[::ffff:127.0.0.1]:1", True, False),
        ("tcp/0.0.0.0:1", False, True),
        ("tcp/[::]:1", False, True),
        ("tcp/robot:1", False, False),
        ("unixsock-stream//tmp/x", True, False),
    ],
)
def test_which_endpoints_only_this_machine_reaches(text: str, *, local: bool, wildcard: bool) -> None:
    assert (parse_endpoint(text).is_local, parse_endpoint(text).is_wildcard) == (local, wildcard)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("tcp", "not an endpoint"),
        ("tpc/a:1", "did you mean 'tcp'"),
        ("tcp/a", "has no port"),
        ("tcp/:1", "has no host"),
        ("tcp/::1", "not clear"),
        ("tcp/::1:7447", "not clear"),
        ("tcp/a:65536", "not a port"),
        ("tcp/a:x", "not a port"),
        ("tcp/a:1,foo/b:2", "unknown protocol 'foo'"),
        ("tcp/a:0", "no client can connect"),
        ("unixsock-stream/x", "no absolute path"),
        (f"unixsock-stream//{'x' * 107}", "too long"),
    ],
)
def test_what_cannot_work_says_why(text: str, problem: str) -> None:
    with pytest.raises(ConfigError, match=problem):
        parse_endpoint(text, connect=True)


def test_only_a_comma_before_a_protocol_separates() -> None:
    assert split_endpoints("tcp/a:1, tls/b:2#x=1,2,") == ["tcp/a:1", "tls/b:2#x=1,2"]


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("tcp/localhost:1", "tls/127.0.0.1:1", True),
        ("tcp/0.0.0.0:1", "tcp/a:1", True),
        ("tcp/a:1", "tcp/b:1", False),
        ("tcp/a:1", "udp/a:1", False),
        ("tcp/a:0", "tcp/a:0", False),
        ("unixsock-stream//a", "unixsock-stream//a", True),
        ("unixsock-stream//a", "tcp/a:1", False),
    ],
)
def test_which_listeners_conflict(one: str, other: str, *, same: bool) -> None:
    assert overlap(parse_endpoint(one), parse_endpoint(other)) == same
