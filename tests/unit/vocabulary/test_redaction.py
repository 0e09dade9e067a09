from __future__ import annotations

import json
import re

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, RiotError
from riot_bus.vocabulary.redaction import redacted, without_commands


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("tls/host:1#a=b;c=d", "tls/host:1#..."),
        ("unit=tls/[::1]:1?rel=1#a, tcp/y:2", "unit=tls/[::1]:1?rel=1#..., tcp/y:2"),
        ("(quic/h:1#a=b): no answer", "(quic/h:1#...): no answer"),
        ("['TLS/h:1#a', \"tls/h:2#b c\"]", "['TLS/h:1#...', \"tls/h:2#...\"]"),
        ("unknown protocol 'tsl' in 'tsl/h:1#a=b c'", "unknown protocol 'tsl' in 'tsl/h:1#...'"),
        ("tcp/user:pass@word@h:1 https://user:password@h/x", "tcp/...@h:1 https://...@h/x"),
        ("--cfg transport/auth/usrpwd/password=secret x", "--cfg transport/auth/usrpwd/password=... x"),
        ("unit:a/listen_private_key_base64=LS0t", "unit:a/listen_private_key_base64=..."),
    ],
)
def test_secrets_are_left_out(text: str, shown: str) -> None:
    assert redacted(text) == shown
    assert redacted(shown) == shown


@pytest.mark.parametrize(
    "text",
    [
        "tcp/127.0.0.1:7447?prio=6-7",
        "see docs/router.md#mutual-tls, issue #7 and a/b#7",
        "/tmp/a#b.mcap",
        "@riot/r7/agent/play and a/b:x@y",
        "s3://bucket/a:b@c.mcap",
        "--cfg transport/auth/usrpwd/password=@/etc/riot/password",
        "the segment asks for a password",
    ],
)
def test_all_else_stays(text: str) -> None:
    assert redacted(text) == text


anything = st.text(st.characters(codec="utf-8"), max_size=20)
solid = st.text(st.characters(codec="utf-8", exclude_categories=("Z", "C")), max_size=20)
SECRET = "s3kR1t"


def told(error: RiotError) -> str:
    return "\n".join([str(error), repr(error), error.message, error.where or "", error.hint or ""])


@given(
    anything, anything, st.sampled_from(["tls", "tcp", "ws", "no-such"]), st.sampled_from(["", "unit=", "a=tcp/b:1,"])
)
def test_what_is_behind_the_hash_of_a_quoted_endpoint_is_in_no_error(
    before: str, after: str, protocol: str, front: str
) -> None:
    endpoint = f"{front}{protocol}/host:1#key={before}{SECRET}{after}"
    error = ConfigError(f"{endpoint!r} is wrong", where=f"in {[endpoint]}", hint=f"mend {endpoint!r}")
    assert SECRET not in told(error)
    assert "host:1#..." in str(error)


@given(solid, solid)
def test_nor_of_one_that_is_not_quoted(before: str, after: str) -> None:
    endpoint = f"tls/host:1#key={before}{SECRET}{after}"
    error = EnvironmentFaultError(f"nobody answers at {endpoint}, tcp/b:1", where=endpoint, hint=f"({endpoint})")
    assert SECRET not in told(error)


def test_long_texts_take_no_longer_than_they_are_long() -> None:
    for part in ("#", "tls/a#;", "'tls/a#\\", "a:", "tcp/a:", "password=", "//a:", "'#"):
        redacted(part * 100_000)  # by backtracking this would not end


def obeyed(text: str) -> bool:
    """Return whether a build obeys a text: actions/runner reads lines, trims them, and looks for `##[` anywhere."""
    lines = re.split(r"\r\n|\n|\r", text)
    return any(line.lstrip().startswith("::") or re.search(r"##\w*\[", line) for line in lines)


@pytest.mark.parametrize("variable", ["GITHUB_ACTIONS", "TF_BUILD", "TEAMCITY_VERSION"])
@given(
    pieces=st.lists(st.sampled_from([":", "::", "#", "##", "[", "vso[", "x", " ", "\t", "\n", "\r", "\x85", "\u3000"]))
)
@example(pieces=["::stop-commands::tok"])
@example(pieces=["x ##[add-mask]riot"])
@example(pieces=["[", "\n", "::", "x", "##", "["])
def test_no_text_is_a_command_where_a_build_runs(variable: str, pieces: list[str]) -> None:
    text = "".join(pieces)
    with pytest.MonkeyPatch.context() as patch:
        for each in ("GITHUB_ACTIONS", "TF_BUILD", "TEAMCITY_VERSION"):
            patch.delenv(each, raising=False)
        assert without_commands(text) == text
        patch.setenv(variable, "true")
        shown = without_commands(text)
        assert not obeyed(shown)
        assert shown.replace("\u200b", "").replace("\\u0023", "#") == text
        assert obeyed(text) or shown == text, "only commands are changed"
        document = json.dumps({"a": [text]}, indent=1)
        assert not obeyed(without_commands(document))
        assert json.loads(without_commands(document)) == {"a": [text]}


def test_disarming_takes_linear_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TF_BUILD", "True")
    for piece in (" ", "\n", "#", ":", "#a", " \n:"):
        assert len(without_commands(piece * 1_000_000)) >= 1_000_000
