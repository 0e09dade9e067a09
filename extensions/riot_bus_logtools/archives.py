"""Converts logs from and to file formats of other tools that adapters know (`riot_bus.types.capabilities`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from riot_bus.given_files import given_file
from riot_bus.log.loss import Loss
from riot_bus.log.reader import LogReader
from riot_bus.log.writer import LogWriter
from riot_bus.new_file import new_file
from riot_bus.types.capabilities import ConvertsFiles, Unpacker
from riot_bus.types.model import Adapter
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError, did_you_mean, install_hint
from riot_bus.vocabulary.message import Message


@dataclass(frozen=True, slots=True)
class ArchiveDone:
    """Result of a conversion.

    Attributes:
        skipped: Number of messages of other kinds, which the format cannot hold.
        damage: Part of the other file that could not be read, empty if there is none.
    """

    messages: int
    skipped: int = 0
    loss: Loss = field(default_factory=Loss)
    damage: str = ""


def archive_endings(adapters: Sequence[Adapter]) -> list[str]:
    """Return the file name endings that adapters know."""
    return sorted({ending for each in adapters if isinstance(each, ConvertsFiles) for ending in each.archives})


def export_archive(
    log: Path | str,
    out: Path | str,
    adapters: Sequence[Adapter],
    *,
    topics: Sequence[str] | None = None,
    start: int | None = None,
    end: int | None = None,
    force: bool = False,
    salvage: bool = False,
) -> ArchiveDone:
    """Write a log's delivered messages in the format that the ending of a file names; the file appears when complete.

    Times are nanoseconds, the end is exclusive; topics are names or key expressions.

    Raises:
        ConfigError: The file exists, no adapter knows its format, or no message is of that kind.
        EnvironmentFaultError: The file cannot be written.
    """
    out = Path(out)
    owner = _owner(out, adapters)
    registry = TypeRegistry(adapters)
    wanted = None if topics is None else [registry.key_expression(topic) for topic in topics]
    written = skipped = 0
    with LogReader(log, salvage=salvage) as reader, new_file(out, force=force, source=Path(log)) as temporary:
        try:
            with open(temporary, "wb") as file:
                for message in reader.messages(topics=wanted, start=start, end=end):
                    record = owner.packed(message)
                    if record is None:
                        skipped += 1
                        continue
                    file.write(record)
                    written += 1
        except OSError as error:
            raise EnvironmentFaultError(f"cannot write: {error.strerror or error}", where=str(out)) from error
        if not written:
            raise ConfigError(f"no message of the log fits into a file {out.suffix}", where=str(log))
        return ArchiveDone(written, skipped, reader.loss)


def import_archive(
    file: Path | str, out: Path | str, adapters: Sequence[Adapter], *, force: bool = False
) -> ArchiveDone:
    """Convert a file in a format of another tool to a log; the log appears when complete.

    Raises:
        ConfigError: The file is missing or holds nothing of its kind, the log exists, or no adapter knows the format.
        EnvironmentFaultError: The log cannot be written.
    """
    file, out = Path(file), Path(out)
    unpacker = _owner(file, adapters).unpacker()
    count = 0
    registry = TypeRegistry(adapters)
    with new_file(out, force=force, source=file) as temporary:
        with LogWriter(temporary, registry=registry, metadata={"imported": file.name}) as writer:
            for message in _unpacked(file, unpacker):
                writer.write(message)
                count += 1
        if not count:
            raise ConfigError(f"there is nothing in it that a file {file.suffix} holds", where=str(file))
    return ArchiveDone(count, damage=unpacker.loss())


def _unpacked(file: Path, unpacker: Unpacker) -> Iterator[Message]:
    try:
        with given_file(file).open("rb") as source:
            while data := source.read(1 << 20):
                yield from unpacker.feed(data)
    except OSError as error:
        raise ConfigError(f"cannot be read: {error.strerror or error}", where=str(file)) from error
    yield from unpacker.end()


def _owner(file: Path, adapters: Sequence[Adapter]) -> ConvertsFiles:
    for each in adapters:
        if isinstance(each, ConvertsFiles) and file.suffix in each.archives:
            return each
    known = archive_endings(adapters)
    hint = did_you_mean(file.suffix, known) or f"its adapter is not installed; .tlog: {install_hint('mavlink')}"
    raise ConfigError(f"unknown kind of file {file.suffix!r}", where=str(file), hint=hint)
