from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message
from riot_bus_logtools.archives import archive_endings, export_archive, import_archive

MESSAGES = [Message(time, key, f"{key}{time}".encode()) for time, key in ((10, "a"), (20, "no"), (30, "b"), (40, "a"))]


class Unpacker:
    """Reads lines `TIME KEY PAYLOAD`; the last one may lack its end."""

    def __init__(self) -> None:
        self.left = b""

    def feed(self, data: bytes) -> list[Message]:
        *lines, self.left = (self.left + data).split(b"\n")
        return [self._message(line) for line in lines]

    def end(self) -> list[Message]:
        return [self._message(self.left)] if self.left else []

    def loss(self) -> str:
        return "no line end" if self.left else ""

    @staticmethod
    def _message(line: bytes) -> Message:
        time, key, payload = line.split(b" ")
        return Message(int(time), key.decode(), payload)


class Lines:
    """An adapter that keeps messages in lines, all but those of the key `no`."""

    name = "lines"
    archives: tuple[str, ...] = (".lines", ".ln")

    def unpacker(self) -> Unpacker:
        return Unpacker()

    def packed(self, message: Message) -> bytes | None:
        return None if message.key == "no" else b"%d %b %b\n" % (message.time, message.key.encode(), message.payload)

    def topic(self, key: str) -> None:
        return None

    def key_expression(self, topic: str) -> None:
        return None


class Other(Lines):
    archives = ()


LINES: Any = [Lines()]
ADAPTERS: Any = [object(), Other(), *LINES]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    with LogWriter(tmp_path / "log.mcap", registry=TypeRegistry([])) as writer:
        for message in MESSAGES:
            writer.write(message)
    return tmp_path / "log.mcap"


def exported(log: Path, **more: Any) -> tuple[Any, list[bytes]]:
    done = export_archive(log, log.with_suffix(".lines"), LINES, force=True, **more)
    return done, log.with_suffix(".lines").read_bytes().splitlines()


def test_what_the_format_holds_is_written_and_the_rest_counted(log: Path) -> None:
    done, lines = exported(log)
    assert lines == [b"10 a a10", b"30 b b30", b"40 a a40"]
    assert (done.messages, done.skipped, bool(done.loss)) == (3, 1, False)


def test_some_topics_or_a_part_can_be_exported(log: Path) -> None:
    assert exported(log, topics=["a"])[1] == [b"10 a a10", b"40 a a40"]
    assert exported(log, start=30, end=40)[1] == [b"30 b b30"]


def test_a_file_without_messages_does_not_appear(log: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no message of the log fits into a file \.lines"):
        exported(log, topics=["no"])
    (tmp_path / "empty.ln").touch()
    with pytest.raises(ConfigError, match="nothing in it"):
        import_archive(tmp_path / "empty.ln", tmp_path / "new.mcap", LINES)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["empty.ln", "log.mcap"]


def test_a_log_is_made_of_all_messages_and_says_from_what(tmp_path: Path) -> None:
    (tmp_path / "own.ln").write_bytes(b"10 a a10\n20 b b20")
    done = import_archive(tmp_path / "own.ln", tmp_path / "new.mcap", LINES)
    assert (done.messages, done.damage) == (2, "no line end")
    with LogReader(tmp_path / "new.mcap") as reader:
        assert [(each.time, each.key, each.payload) for each in reader.messages()] == [
            (10, "a", b"a10"),
            (20, "b", b"b20"),
        ]
        assert reader.metadata["imported"] == "own.ln"


def test_formats_are_those_of_the_adapters(log: Path, tmp_path: Path) -> None:
    assert archive_endings(ADAPTERS) == [".lines", ".ln"]
    with pytest.raises(ConfigError, match=r"unknown kind of file '\.line'") as error:
        export_archive(log, tmp_path / "x.line", ADAPTERS)
    assert ".lines" in str(error.value.hint)
    with pytest.raises(ConfigError, match="unknown kind"):
        import_archive(tmp_path / "x.tlog", tmp_path / "new.mcap", [])


def test_a_missing_file_and_one_that_exists(log: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError):
        import_archive(tmp_path / "nothing.ln", tmp_path / "new.mcap", LINES)
    (tmp_path / "there.ln").write_bytes(b"mine")
    with pytest.raises(ConfigError, match="the file exists"):
        export_archive(log, tmp_path / "there.ln", LINES)
    assert (tmp_path / "there.ln").read_bytes() == b"mine"
