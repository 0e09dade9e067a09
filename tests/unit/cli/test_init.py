"""A first riot.toml from links that any adapter knows."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from riot_bus.cli.main import make_app
from riot_bus.vocabulary.errors import ConfigError

TOY = '''
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.types.capabilities import HeardSystem

TEXT = """
[system]
name = "toys"

[components.box]
command = ["true"]
"""


class ToyAdapter:
    name = "toy"


class ToyListener:
    def __init__(self, adapter):
        assert adapter.name == "toy"

    def listen(self, links, *, seconds, unit, warn):
        if unit == "nobody":
            raise ConfigError("nobody was not heard")
        warn(f"warning: {seconds:g} s are short")
        return HeardSystem(TEXT, {"links": list(links), "unit": unit}, ["box  outside"])


class Deaf:
    name = "deaf"
'''


@pytest.fixture(autouse=True)
def toys(plugin_package: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plugin_package(TOY, "riot_bus.adapters", toy="ToyAdapter", deaf="Deaf")
    plugin_package(TOY, "riot_bus.listeners", toy="ToyListener")
    monkeypatch.chdir(tmp_path)


def init(*words: str) -> Result:
    return CliRunner().invoke(make_app("init"), ["init", *words])


def test_an_adapter_of_others_hears_the_system(tmp_path: Path) -> None:
    result = init("--link=toy=box://1", "--link=toy=box://2", "--seconds=0.5")
    assert result.exception is None
    written = "written: riot.toml; next, fill in what it marks with FILL IN, above all the commands"
    assert result.stdout.splitlines() == ["box  outside", written]
    assert result.stderr == "warning: 0.5 s are short\n"
    assert 'name = "toys"' in (tmp_path / "riot.toml").read_text()
    assert "there is a system file already" in str(init("--link=toy=box://1").exception)
    result = init("--link=toy=a=b", "--unit=box", "--force", "--format=json")
    assert json.loads(result.stdout) == {"file": "riot.toml", "links": ["a=b"], "unit": "box"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--ros2", "--link=toy=a"), "--ros2 and --link do not go together"),
        (("--ros2", "--mavlink=udpin:0.0.0.0:1"), "do not go together"),
        (("--ros2", "--start"), "--ros2 and --start do not go together"),
        (("--log=a.mcap", "--record=b.mcap"), "--log and --record do not go together"),
        (("--log=a.mcap",), "a.mcap"),
        (("--link=toy=a", "--mavlink=b"), "cannot listen to mavlink=b, toy=a"),
        (("--link=toy",), "cannot listen to toy"),
        (("--link=deaf=a",), "unknown adapter that listens to links 'deaf'"),
        (("--link=tyo=a",), "did you mean 'toy'"),
        (("--link=toy=a", "--unit=nobody"), "nobody was not heard"),
        (("--mavlink=udpin:127.0.0.1:0", "--unit=x"), "'x' is not the id of a system"),
    ],
)
def test_what_cannot_be_heard_is_an_error(words: tuple[str, ...], message: str) -> None:
    result = init(*words)
    assert isinstance(result.exception, ConfigError)
    assert message in str(result.exception)
    assert not Path("riot.toml").exists()
