from __future__ import annotations

import json
from typing import Any

import pytest

from riot_bus.control.commands import VERSION, Command, CommandRequest, answer, number_of, refusal, reporting
from riot_bus.vocabulary.errors import ConfigError, DataLossError


class Service:
    """A service that keeps what it was told."""

    def __init__(self) -> None:
        self.keys: list[str] = []

    def status(self) -> dict[str, Any]:
        return {"keys": self.keys}

    def add(self, request: CommandRequest) -> str:
        self.keys += request.keys()
        return "nobody gets this"


COMMANDS = {"keys/add": reporting(Service.add, urgent=True), "nonce": Command(lambda _, request: request.nonce())}


def request(payload: bytes | dict[str, Any], **parameters: str) -> CommandRequest:
    return CommandRequest(payload if isinstance(payload, bytes) else json.dumps(payload).encode(), parameters)


def test_a_command_is_answered_with_the_status_afterwards() -> None:
    service = Service()
    found = json.loads(answer(service, "base", "keys/add", b'{"keys": ["/odom"]}', {}, commands=COMMANDS))
    assert found == {"version": VERSION, "router": "base", "command": "keys/add", "result": {"keys": ["/odom"]}}
    assert (COMMANDS["keys/add"].urgent, COMMANDS["keys/add"].reads) == (True, False)


def test_an_unknown_command_is_refused_with_those_like_it() -> None:
    with pytest.raises(ConfigError, match="no command 'keys/ad'") as caught:
        answer(Service(), "base", "keys/ad", b"", {}, commands=COMMANDS)
    assert "keys/add" in str(caught.value.hint)
    with pytest.raises(ConfigError) as caught:
        answer(Service(), "base", "x" * 10**6, b"", {}, commands=COMMANDS)
    assert len(str(caught.value)) < 300


def test_arguments_are_those_that_are_known() -> None:
    assert request(b"").arguments("a") == {}
    assert request({"a": 1}).arguments("a", "b") == {"a": 1}
    with pytest.raises(ConfigError, match="unknown argument 'pth'") as caught:
        request({"pth": 1}).arguments("path")
    assert "'path'" in str(caught.value.hint)


@pytest.mark.parametrize(
    ("payload", "message"),
    [
        (b"[1]", "not a JSON object"),
        (b"{", "not JSON"),
        (b"[" * 60_000, "not JSON"),
        (b"ab\xff", "not UTF-8: invalid start byte at byte 2"),
        (b" " * (1 << 16) + b"{}", "65538 bytes is too large"),
    ],
)
def test_payloads_that_are_no_object_are_refused(payload: bytes, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        request(payload).arguments()


def test_keys_and_paths_are_texts() -> None:
    assert request({"keys": ["a", "b"]}).keys() == ["a", "b"]
    assert request({"path": "a.mcap"}).path() == "a.mcap"
    assert request(b"").path() is request({"path": None}).path() is None
    for wrong in (b"", b'{"keys": "a"}', b'{"keys": [1]}'):
        with pytest.raises(ConfigError, match="'keys' is not a list of texts"):
            request(wrong).keys()
    with pytest.raises(ConfigError, match="'path' is not a text"):
        request({"path": 3}).path()


@pytest.mark.parametrize("wrong", [True, "1", None, [], 1e13, -1e13, float("nan"), float("inf"), 10**400])
def test_only_numbers_of_a_sensible_size_are_numbers(wrong: Any) -> None:
    with pytest.raises(ConfigError, match="'rate' is not a number") as caught:
        number_of(wrong, "rate")
    assert caught.value.hint == 'such as {"rate": 2.5}'


def test_a_number_may_have_a_default() -> None:
    assert request({"count": 3}).number("count", 1) == 3.0
    assert request(b"").number("count", 1) == 1.0
    with pytest.raises(ConfigError, match="is not a number"):
        request(b"").number("count")


def test_names_of_a_sender_are_cut_and_shown_only_if_they_can_be() -> None:
    assert request(b"", name="a.toml").name() == "a.toml"
    assert request(b"").name() == request(b"", name="a\x1b[31m").name() == "plan"
    assert len(request(b"", name="x" * 999).name()) == len(request(b"", nonce="x" * 999).nonce()) == 200


def test_a_refusal_says_what_where_and_what_to_do() -> None:
    found = json.loads(refusal("base", DataLossError("gone", where="a.mcap", hint="look")))
    assert found == {
        "version": VERSION,
        "router": "base",
        "message": "gone",
        "where": "a.mcap",
        "hint": "look",
        "exit_code": 3,
    }
    ours = json.loads(refusal("base", KeyError("x")))
    assert (ours["message"], ours["exit_code"], ours["hint"]) == ("failure of ours: KeyError('x')", 1, None)
