"""Pipes, devices and sockets in place of a log, and links and pipes in a folder of logs: refused, and nothing waits."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from riot_bus.cli.main import make_app
from riot_bus.log.rosbag2 import files_of
from riot_bus.vocabulary.errors import ConfigError, RiotError
from riot_bus_fleet.logs.catalogue import Catalogue
from riot_bus_fleet.logs.index import index
from riot_bus_mavlink.dialect import load_dialect
from riot_bus_mavlink.signing import read_key
from riot_bus_protobuf.source import ProtobufTypes
from riot_bus_ros2.adapter import Ros2Adapter
from tests.log_mutants import foreign

APP = make_app()
COMMANDS = [
    ["info", "BAD"],
    ["info", "--no-scan", "BAD"],
    ["show", "BAD"],
    ["types", "BAD"],
    ["export", "BAD", "-o", "out.csv", "--field", "/a:b"],
    ["export", "BAD", "-o", "out.tlog"],
    ["import", "BAD.tlog", "out.mcap"],
    ["diff", "good.mcap", "BAD"],
    ["diff", "BAD", "good.mcap"],
    ["edit", "BAD", "out.mcap"],
    ["edit", "good.mcap", "BAD", "out.mcap"],
    ["play", "BAD"],
    ["backchain", "BAD", "--to", "/a:b"],
    ["edit", "good.mcap", "out.mcap", "--inject", "BAD"],
    ["diff", "good.mcap", "good.mcap", "--tolerances", "BAD"],
    ["backchain", "good.mcap", "--to", "/a:b", "--system", "BAD"],
    ["fleet", "index", "BAD", "--catalogue", "catalogue.sqlite"],
]


def make(path: Path, kind: str) -> Path:
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as end:
            end.bind(path.name)  # a longer path would not fit
    return path


def error_of(*words: str) -> str:
    done = CliRunner().invoke(APP, list(words), catch_exceptions=True)
    assert isinstance(done.exception, RiotError), (done.output, done.exception)
    assert isinstance(done.exception, ConfigError)
    return str(done.exception)


@pytest.mark.parametrize("kind", ["pipe", "device", "socket"])
@pytest.mark.parametrize(
    "words", COMMANDS, ids=lambda words: f"{words[0]}-{words.index(next(w for w in words if 'BAD' in w))}"
)
def test_every_command_refuses_what_is_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "good.mcap").write_bytes(foreign("zstd"))
    name = make(tmp_path / ("x.tlog" if "BAD.tlog" in words else "x.mcap"), kind).name
    error = error_of(*(name if "BAD" in word else word for word in words))
    assert f"{name}: this is no regular file" in error


@pytest.mark.parametrize(
    "read",
    [
        lambda path: Ros2Adapter().load([path.parent / "p" / "msg" / "A.msg"]),
        lambda path: ProtobufTypes().load([path]),
        lambda path: load_dialect("", [path]),
        lambda path: read_key(path),
    ],
    ids=["msg", "protobuf", "dialect", "key"],
)
def test_definitions_and_keys_are_files(tmp_path: Path, read: Callable[[Path], object]) -> None:
    (tmp_path / "p" / "msg").mkdir(parents=True)
    make(tmp_path / "p" / "msg" / "A.msg", "pipe")
    with pytest.raises(ConfigError, match="no regular file"):
        read(make(tmp_path / "x.xml", "pipe"))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A folder of logs: one file, a link to it, and a folder whose name looks like that of a log."""
    folder = tmp_path / "bag"
    (folder / "d.mcap").mkdir(parents=True)
    (folder / "a_0.mcap").write_bytes(foreign("zstd"))
    (folder / "a_1.mcap").symlink_to("a_0.mcap")
    (tmp_path / "private.mcap").write_bytes(foreign("zstd"))
    return folder


def test_links_inside_of_a_folder_are_followed_and_it_may_be_a_link(bag: Path, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(bag)
    assert [each.name for each in files_of(tmp_path / "link")] == ["a_0.mcap", "a_1.mcap"]
    with Catalogue(None) as catalogue:
        report = index(catalogue, [str(tmp_path / "link")])
    assert (report.logs, report.damaged, report.failures) == (2, 0, [])


@pytest.mark.parametrize(
    ("kind", "reason"),
    [("link", "leads out of the folder 'bag'"), ("pipe", "no regular file"), ("device", "leads out of the folder")],
)
def test_nothing_else_in_a_folder_is_opened(bag: Path, tmp_path: Path, kind: str, reason: str) -> None:
    bad = bag / "a_2.mcap"
    if kind == "link":
        bad.symlink_to("../private.mcap")
    else:
        make(bad, kind)
    for words in (["diff", bag, bag], ["edit", bag, tmp_path / "o.mcap"], ["play", bag], ["info", bag]):
        assert reason in error_of(*map(str, words))
    with Catalogue(None) as catalogue:
        report = index(catalogue, [str(tmp_path / "bag")])
    assert (report.logs, report.damaged) == (2, 0)
    assert [reason in each for each in report.failures] == [True]


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_the_metadata_beside_a_log_is_a_file_of_its_folder(bag: Path, tmp_path: Path, kind: str) -> None:
    beside = bag / "metadata.yaml"
    if kind == "link":
        (tmp_path / "secret.yaml").write_text("custom_data: private")
        beside.symlink_to("../secret.yaml")
    else:
        make(beside, kind)
    assert "metadata.yaml: this" in error_of("edit", str(bag / "a_0.mcap"), str(tmp_path / "out"))
