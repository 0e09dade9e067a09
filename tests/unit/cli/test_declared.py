"""An option that is declared once is on the command line, in its help, in the options and in a robot's request."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import pytest
import typer
from click.testing import Result
from typer.testing import CliRunner

from riot_bus.cli import play, record
from riot_bus.cli.declared import declared
from riot_bus.config.arguments import parse_seconds, parse_size
from riot_bus.play.options import PlayOptions
from riot_bus.record.options import CaptureOptions
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.flags import Flag, flags_of
from riot_bus_fleet.agent import request
from riot_bus_fleet.cli import robots as fleet_robots

OPERATION = {"operation": "0123456789abcdef", "on_lost_controller": "continue"}


@dataclass(frozen=True, kw_only=True)
class Playing(PlayOptions):
    """What `riot play` has, and one option more, declared here and nowhere else."""

    volume: Annotated[float | None, Flag("How loud.", "-v", "DB", "RIOT_VOLUME", remote=(0, 11))] = None


@dataclass(frozen=True, kw_only=True)
class Options:
    count: Annotated[int, Flag("How many.", least=0, remote=(0, 9))] = 3
    size: Annotated[int, Flag("How much.", "--room", "SIZE", read=parse_size, text="1KiB")] = 1024
    after: Annotated[float, Flag("When.", read=parse_seconds)] = 0.0
    topics: Annotated[Sequence[str], Flag("Which topics.", remote=True)] = ()
    services: Annotated[Sequence[str] | None, Flag("Which services.")] = None
    pack: Annotated[Literal["a", "b"], Flag("How it is packed.", remote=True)] = "a"
    keep: Annotated[bool, Flag("Keep it.")] = True
    loop: Annotated[bool, Flag("Again.", "-l")] = False
    hidden: int = 7


def run(kind: type, words: str, *, remote: bool = False) -> Result:
    app = typer.Typer(rich_markup_mode=None)

    def command(*, form: str = "text", **given: Any) -> None:
        typer.echo(json.dumps(given, sort_keys=True))

    app.command()(declared(kind, remote=remote)(command))
    return CliRunner().invoke(app, words.split(), env={"RIOT_VOLUME": "4"})


def test_a_new_option_of_play_is_declared_in_one_place() -> None:
    assert json.loads(run(Playing, "-v 11").output)["volume"] == 11.0
    assert json.loads(run(Playing, "--rate 2").output) | {"control": True} == json.loads(
        run(Playing, "--rate=2 --volume=4", remote=True).output
    ) | {"control": True, "hold": False, "salvage": False, "name": "player"}
    shown = run(Playing, "--help", remote=True).output
    assert re.search(r"-v, --volume DB\s+How loud\.\s+\[env var: RIOT_VOLUME", shown)
    asked = request._with_options(Playing)(request.PlayRequest)
    found = request.parse_request(asked, json.dumps({**OPERATION, "logs": ["a"], "volume": 11}).encode())
    assert vars(found)["volume"] == 11.0
    with pytest.raises(ConfigError, match="volume: Input should be less than or equal to 11"):
        request.parse_request(asked, json.dumps({**OPERATION, "logs": ["a"], "volume": 12}).encode())


def test_values_are_those_of_the_fields() -> None:
    assert json.loads(run(Options, "").output) == {"count": 3, "keep": True, "loop": False, "pack": "a", "size": 1024}
    words = "--count 0 --room 2k --after 1min --topics a --topics b --services c --no-keep -l --pack b"
    assert json.loads(run(Options, words).output) == {
        "count": 0, "size": 2000, "after": 60.0, "topics": ["a", "b"], "keep": False, "loop": True, "pack": "b",
        "services": ["c"],
    }  # fmt: skip


@pytest.mark.parametrize(("words", "remote"), [("--hidden 1", False), ("--count -1", False), ("--room 2k", True)])
def test_what_is_no_option(words: str, *, remote: bool) -> None:
    assert run(Options, words, remote=remote).exit_code == 2


def test_a_value_that_cannot_be_read_is_told_with_its_option() -> None:
    assert str(run(Options, "--room x").exception).startswith("--room: 'x' is not a size")


@pytest.mark.parametrize("kind", [PlayOptions, CaptureOptions])
def test_defaults_as_written_are_the_defaults(kind: type) -> None:
    for each, flag, names in flags_of(kind):
        if flag.read and flag.text is not None:
            assert flag.read(flag.text, names[0]) == each.default, each.name


@pytest.mark.parametrize(
    ("kind", "asked", "commands"),
    [
        (PlayOptions, request.PlayRequest, (play.play, fleet_robots.play)),
        (CaptureOptions, request.RecordRequest, (record.record, fleet_robots.record)),
    ],
)
def test_commands_and_requests_have_all_options(kind: Any, asked: Any, commands: tuple[Any, Any]) -> None:
    for each, flag, _ in flags_of(kind):
        here, there = (each.name in command.__signature__.parameters for command in commands)
        assert here, each.name
        assert (there and each.name in asked.model_fields) == bool(flag.remote or each.name == "inject"), each.name
