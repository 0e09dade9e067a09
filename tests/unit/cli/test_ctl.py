"""What `riot ctl` asks whom; the other end is a double."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from riot_bus.cli import ctl
from riot_bus.config.arguments import DEFAULT_ENDPOINT
from riot_bus.graph.model import ConnectedComponent, Graph

Question = tuple[str, str | None, str, str]
"""Endpoint, name and command that were asked, and the kind of process."""


class Network:
    """Keeps what was asked, and answers each question alike."""

    def __init__(self) -> None:
        self.asked: list[Question] = []
        self.payload: Any = None
        self.parameters = ""
        self.config: Any = None
        self.routers = ["base"]

    def ask(
        self, endpoint: str, name: str | None, command: str, payload: bytes | None, *, kind: str, **more: Any
    ) -> dict[str, Any]:
        self.asked.append((endpoint, name, command, kind))
        self.payload, self.parameters, self.config = payload, more["parameters"], more["config"]
        return {"intercepted": ["/a"]}


@pytest.fixture
def network(monkeypatch: pytest.MonkeyPatch) -> Network:
    found = Network()
    monkeypatch.setattr("riot_bus.control.remote.ask", found.ask)
    monkeypatch.setattr("riot_bus.control.remote.find_routers", lambda endpoint, config: found.routers)
    monkeypatch.setattr("riot_bus.play.text.status_lines", lambda answer: ["the player's"])
    monkeypatch.setattr("riot_bus.record.text.answer_lines", lambda answer: ["the recorder's"])
    return found


def riot(*words: str) -> Result:
    app = typer.Typer(rich_markup_mode=None)
    ctl.register(app)
    return CliRunner().invoke(app, words)


def test_interception_is_changed_by_keys(network: Network) -> None:
    result = riot("ctl", "intercept", "add", "/a", "b/**")
    assert result.output == "intercepted: /a\n"
    riot("ctl", "intercept", "remove", "c", "--format", "json")
    assert network.asked == [(DEFAULT_ENDPOINT, None, f"intercept/{each}", "router") for each in ("add", "remove")]
    assert json.loads(network.payload) == {"keys": ["c"]}


@pytest.mark.parametrize(
    "words",
    [
        ("-e", "tcp/x:1", "--router", "base", "plan", "clear"),
        ("plan", "clear", "-e", "tcp/x:1", "--router", "base"),
        ("plan", "--endpoint=tcp/x:1", "clear", "--router=base"),
    ],
)
def test_options_of_the_connection_may_stand_anywhere(network: Network, words: tuple[str, ...]) -> None:
    assert riot("ctl", *words, "--cfg", "mode=client").exit_code == 0
    assert network.asked == [("tcp/x:1", "base", "plan/clear", "router")]
    assert network.config == {"mode": "client"}


def test_words_after_two_dashes_are_no_options(network: Network) -> None:
    assert riot("ctl", "intercept", "add", "--", "-e", "x").exit_code == 0
    assert json.loads(network.payload) == {"keys": ["-e", "x"]}
    assert network.asked[0][0] == DEFAULT_ENDPOINT
    assert riot("ctl", "plan", "clear", "-e").exit_code == 2


def test_a_plan_is_read_here_and_sent(network: Network, tmp_path: Path) -> None:
    (tmp_path / "p.toml").write_bytes(b"text")
    assert riot("ctl", "plan", "load", str(tmp_path / "p.toml")).exit_code == 0
    assert (network.payload, network.parameters) == (b"text", "name=p.toml")


@pytest.mark.parametrize(
    ("words", "command", "payload"),
    [
        (("pause",), "pause", {}),
        (("step",), "step", {"count": 1}),
        (("step", "3"), "step", {"count": 3}),
        (("seek", "2.5"), "seek", {"time": 2.5}),
        (("rate", "0"), "rate", {"rate": 0}),
    ],
)
def test_a_player_is_asked_by_its_name(
    network: Network, words: tuple[str, ...], command: str, payload: dict[str, float]
) -> None:
    assert riot("ctl", "play", *words, "--player", "one").output == "the player's\n"
    assert network.asked == [(DEFAULT_ENDPOINT, "one", f"play/{command}", "player")]
    assert json.loads(network.payload) == payload
    assert riot("ctl", "play", "step", "0").exit_code == 2


@pytest.mark.parametrize(
    ("words", "routers", "whom"),
    [
        (("start", "a.mcap"), ["base"], (None, "record/start", "router")),
        (("start",), [], (None, "record/start", "recorder")),
        (("stop", "--recorder", "r"), ["base"], ("r", "record/stop", "recorder")),
        (("stop", "--router", "base"), [], ("base", "record/stop", "router")),
        (("pause",), ["base"], (None, "record/pause", "recorder")),
    ],
)
def test_a_recording_is_the_routers_unless_none_answers_or_it_is_of_riot_record(
    network: Network, words: tuple[str, ...], routers: list[str], whom: tuple[str | None, str, str]
) -> None:
    network.routers = routers
    result = riot("ctl", "record", *words)
    assert result.output == ("the recorder's\n" if whom[2] == "recorder" else "intercepted: /a\n")
    assert network.asked == [(DEFAULT_ENDPOINT, *whom)]
    assert json.loads(network.payload) == ({"path": "a.mcap"} if "a.mcap" in words else {})


@pytest.mark.parametrize(("form", "lines"), [("json", 1), ("text", 0)])
def test_each_graph_that_is_watched_is_printed(monkeypatch: pytest.MonkeyPatch, form: str, lines: int) -> None:
    class Remote(SimpleNamespace):
        def __init__(self, endpoint: str, name: str | None, *, config: object) -> None:
            super().__init__(endpoint=endpoint, name=name)

        def __enter__(self) -> Remote:
            return self

        def __exit__(self, *error: object) -> None:
            pass

    both = [Graph(components=(ConnectedComponent("in", each),)) for each in ("aa", "bb")]
    monkeypatch.setattr("riot_bus.control.remote.Remote", Remote)
    monkeypatch.setattr("riot_bus.control.remote.graphs", lambda remote, *, watch: both if watch else both[:1])
    watched = riot("graph", "--watch", "--format", form).output
    assert watched.index("aa") < watched.index("bb")
    assert not lines or len(watched.splitlines()) == 2
    assert "bb" not in riot("graph", "--format", form).output
