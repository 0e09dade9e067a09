import json

import pytest

from riot_bus.control.commands import answer
from riot_bus.play.service import PLAY_COMMANDS
from riot_bus.vocabulary.errors import ConfigError


class Player:
    def __init__(self):
        self.told = []

    def status(self):
        return {"told": self.told}

    def __getattr__(self, name):
        return lambda *arguments: self.told.append([name, *arguments])


def ask(command, **arguments):
    found = json.loads(answer(Player(), "one", command, json.dumps(arguments).encode(), {}, commands=PLAY_COMMANDS))
    return found["result"]["told"]


def test_every_command_answers_with_the_status():
    assert ask("play/status") == []
    for name in ("pause", "resume", "stop"):
        assert ask(f"play/{name}") == [[name]]
    assert ask("play/step") == [["step", 1]]
    assert ask("play/step", count=3) == [["step", 3]]
    assert ask("play/seek", time=-2.5) == [["seek", -2.5]]
    assert ask("play/rate", rate=0) == [["set_rate", 0.0]]


def test_only_the_status_is_given_to_those_who_ask_everybody():
    assert [name for name, command in PLAY_COMMANDS.items() if command.reads] == ["play/status"]


@pytest.mark.parametrize(
    ("command", "arguments"),
    [
        ("play/step", {"count": 0}),
        ("play/step", {"count": 1.5}),
        ("play/step", {"count": 10**9}),
        ("play/step", {"count": float("nan")}),
        ("play/seek", {}),
        ("play/seek", {"time": "1"}),
        ("play/seek", {"time": True}),
        ("play/seek", {"time": float("inf")}),
        ("play/seek", {"time": float("nan")}),
        ("play/seek", {"time": 1e300}),
        ("play/rate", {"rate": None}),
        ("play/rate", {"speed": 1}),
        ("play/dance", {}),
    ],
)
def test_nonsense_is_refused(command, arguments):
    with pytest.raises(ConfigError):
        ask(command, **arguments)
