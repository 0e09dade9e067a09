"""What `riot play` asks of a player; the player is a double."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner, Result

from riot_bus.cli import play
from riot_bus.play.options import Expectation, PlayOptions
from riot_bus.vocabulary.errors import INTERRUPTED, ConfigError


class Player:
    """Keeps what is to be played, and tells what a test says."""

    def __init__(self) -> None:
        self.played: list[PlayOptions] = []
        self.expected: list[tuple[Any, ...]] = []
        self.finished = True

    def run(self, options: PlayOptions, foreground: object) -> bool:
        self.played.append(options)
        return self.finished

    def expecting(self, options: PlayOptions, expectation: Expectation, _: object, *more: Any) -> bool:
        self.played.append(options)
        self.expected.append((expectation, *more))
        return self.finished


@pytest.fixture
def player(monkeypatch: pytest.MonkeyPatch) -> Player:
    found = Player()
    monkeypatch.setattr("riot_bus.play.running.run_play", found.run)
    monkeypatch.setattr("riot_bus.plugins.hook", lambda name, extension: {"play_expecting": found.expecting}[name])
    return found


def riot(*words: str) -> Result:
    app = typer.Typer(rich_markup_mode=None)
    app.callback()(lambda: None)
    play.register(app)
    return CliRunner().invoke(app, ["play", *words])


@pytest.mark.parametrize(
    ("words", "clock"),
    [
        ((), 0.0),
        (("--clock",), 40.0),
        (("--clock", "-l"), 40.0),
        (("--clock", "100"), 100.0),
        (("--clock", "12.5", "--loop"), 12.5),
        (("--clock=7",), 7.0),
    ],
)
def test_the_clock_may_come_without_a_number(player: Player, words: tuple[str, ...], clock: float) -> None:
    result = riot("a.mcap", *words)
    assert result.exit_code == 0, result.output
    assert [each.clock for each in player.played] == [clock]


def test_a_log_after_the_clock_is_no_number(player: Player) -> None:
    assert riot("--clock", "a.mcap").exit_code == 0
    assert player.played == [PlayOptions(logs=[Path("a.mcap")], clock=40.0)]


def test_options_and_settings_reach_the_player(player: Player) -> None:
    words = ["a", "b", "-e", "tcp/x:1", "--cfg", "mode=client", "-r", "2", "-m", "/a:=/b", "--start-paused"]
    assert riot(*words).exit_code == 0
    (found,) = player.played
    assert (found.logs, found.endpoint, found.config) == ([Path("a"), Path("b")], "tcp/x:1", {"mode": "client"})
    assert (found.rate, list(found.remap), found.paused) == (2.0, ["/a:=/b"], True)


def test_an_interrupted_playback_has_its_own_exit_code(player: Player) -> None:
    player.finished = False
    assert riot("a").exit_code == riot("a", "--expect", "b").exit_code == INTERRUPTED


@pytest.mark.parametrize("option", ["--answers", "--html", "--tolerance", "--tolerances", "--expect-topics"])
def test_what_needs_an_expectation_is_refused_without(player: Player, option: str) -> None:
    result = riot("a", option, "x")
    assert isinstance(result.exception, ConfigError)
    assert result.exception.message == f"{option} cannot be used without --expect"
    assert player.played == []


def test_answers_are_compared_with_what_is_expected(player: Player) -> None:
    words = ["--expect", "b", "--expect-wait", "3", "--tolerance", "/a:x=1", "--tolerances", "t.toml", "--html", "r"]
    result = riot("a", *words)
    assert result.exit_code == 0, result.output
    ((expectation, tolerances, html, form),) = player.expected
    assert (expectation.expect, expectation.expect_wait) == (Path("b"), 3.0)
    assert (list(tolerances[0]), list(tolerances[1])) == (["/a:x=1"], [Path("t.toml")])
    assert (html, form) == (Path("r"), "text")
