"""Writes the metadata that rosbag2 needs of a bag: `metadata.yaml` beside its files, and the same text in each file.

Written in version 8 of the format, with QoS as numbers in a text, which every ROS 2 release since Humble reads. Where
the channels of an edited bag have QoS as names, it is version 9.
Source: rosbag2_storage's metadata_io and its MCAP plug-in.
"""

from __future__ import annotations

import json
import re
import textwrap
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from riot_bus.given_files import given_file
from riot_bus.log.engine.limits import DEFAULT_LIMITS
from riot_bus.new_file import write_whole
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from mcap.records import Channel, Schema

    from riot_bus.log.writer import LogWriter

RECORD = "rosbag2"
"""Name of the metadata record of a file."""
FIELD = "serialized_metadata"
"""Key of the text in that record."""
_NAMES = re.compile(r"(?:history|reliability|durability|liveliness):\s*[A-Za-z]")
_DISTRO = re.compile(r'^ros_distro:\s*"?([\w.-]*)"?\s*$', re.MULTILINE)
_CUSTOM = re.compile(r"^custom_data:(?:[ \t]*\n(?:[ \t]+.*(?:\n|\Z))+|[^\n]*)", re.MULTILINE)
_HEAD = "rosbag2_bagfile_information:\n"


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic of a bag."""

    name: str
    type_name: str
    encoding: str
    qos: str = ""
    type_hash: str = ""
    messages: int = 0


@dataclass(frozen=True, slots=True)
class BagFile:
    """A file of a bag; times in nanoseconds, 0 if it is empty."""

    name: str
    topics: Sequence[BagTopic] = ()
    start: int = 0
    end: int = 0

    @property
    def messages(self) -> int:
        """Number of messages in the file."""
        return sum(each.messages for each in self.topics)


@dataclass(frozen=True, slots=True)
class BagDetails:
    """The metadata of a bag that does not follow from its messages; an edit keeps that of its input.

    Attributes:
        custom: The user's own data, as YAML.
    """

    present: bool = False
    mapping: Mapping[str, str] = field(default_factory=dict)
    distro: str = ""
    custom: str = "custom_data: ~"


def bag_details(text: str, mapping: Mapping[str, str] | None = None) -> BagDetails:
    """Return the details in the text of a `metadata.yaml`, or of a metadata record `rosbag2` with this mapping."""
    text = text[: DEFAULT_LIMITS.definitions]
    if text.startswith(_HEAD):
        text = textwrap.dedent(text.removeprefix(_HEAD))
    distro, custom = _DISTRO.search(text), _CUSTOM.search(text)
    return BagDetails(
        present=True,
        mapping=mapping or {},
        distro=distro[1] if distro else "",
        custom=custom[0].rstrip("\n") if custom else "custom_data: ~",
    )


def bag_file(name: str, writer: LogWriter) -> BagFile:
    """Return the content of a log so far; call `LogWriter.flush` before."""
    schemas, channels = writer.definitions()
    return bag_of(name, channels, schemas, writer.counts(), *writer.span())


def bag_of(
    name: str, channels: Sequence[Channel], schemas: Sequence[Schema], counts: Mapping[int, int], start: int, end: int
) -> BagFile:
    """Return the content of a file."""
    types = {each.id: each.name for each in schemas}
    topics = [
        BagTopic(
            each.topic,
            types.get(each.schema_id, ""),
            each.message_encoding,
            each.metadata.get("offered_qos_profiles", ""),
            each.metadata.get("topic_type_hash", ""),
            counts.get(each.id, 0),
        )
        for each in channels
    ]
    return BagFile(name, topics, start, end)


def bag_text(files: Sequence[BagFile], details: BagDetails | None = None) -> str:
    """Return the text of `metadata.yaml`."""
    details = details or BagDetails()
    named = any(_NAMES.search(topic.qos) for file in files for topic in file.topics)
    filled = [each for each in files if each.messages]
    start = min((each.start for each in filled), default=0)
    end = max((each.end for each in filled), default=start)
    lines = [
        _HEAD.rstrip(),
        f"  version: {9 if named else 8}",  # Humble reads 8; from 9 on, QoS are names, not numbers
        "  storage_identifier: mcap",
        "  duration:",
        f"    nanoseconds: {end - start}",
        "  starting_time:",
        f"    nanoseconds_since_epoch: {start}",
        f"  message_count: {sum(each.messages for each in files)}",
        *_list("  topics_with_message_count:", [line for each in _merged(files) for line in _topic(each, named=named)]),
        '  compression_format: ""',
        '  compression_mode: ""',
        *_list("  relative_file_paths:", [f"    - {_quoted(each.name)}" for each in files]),
        *_list("  files:", [line for each in files for line in _file(each)]),
        textwrap.indent(details.custom, "  "),
        f'  ros_distro: "{details.distro}"',
    ]
    return "\n".join(lines) + "\n"


def bag_record(file: BagFile, details: BagDetails | None = None) -> dict[str, str]:
    """Return the mapping of the metadata record `rosbag2` of one file; there the outermost key is missing."""
    text = textwrap.dedent(bag_text([file], details).removeprefix(_HEAD))
    return {**(details.mapping if details is not None else {}), FIELD: text}


def bag_epilogue(writer: LogWriter) -> tuple[str, dict[str, str]]:
    """Return the metadata record that rosbag2 looks for at the end of a file; for `LogWriter`."""
    return RECORD, bag_record(bag_file(Path(writer.path).name, writer))


def write_metadata(folder: Path, files: Sequence[BagFile]) -> None:
    """Write `metadata.yaml` atomically, without waiting for the disk, since a recording goes on; raises OSError."""
    write_whole(folder / "metadata.yaml", bag_text(files), sync=False)


def _merged(files: Iterable[BagFile]) -> list[BagTopic]:
    found: dict[tuple[str, str], BagTopic] = {}
    for file in files:
        for each in file.topics:
            known = found.get((each.name, each.type_name))
            messages = each.messages + (known.messages if known is not None else 0)
            found[each.name, each.type_name] = replace(each, messages=messages)
    return list(found.values())


def _topic(topic: BagTopic, *, named: bool) -> list[str]:
    qos = f" {_quoted(topic.qos)}"
    if named:
        qos = "\n" + textwrap.indent(topic.qos.strip("\n"), " " * 10) if topic.qos.strip() else " []"
    return [
        "    - topic_metadata:",
        f"        name: {_quoted(topic.name)}",
        f"        type: {_quoted(topic.type_name)}",
        f"        serialization_format: {_quoted(topic.encoding)}",
        f"        offered_qos_profiles:{qos}",
        f"        type_description_hash: {_quoted(topic.type_hash)}",
        f"      message_count: {topic.messages}",
    ]


def _file(file: BagFile) -> list[str]:
    return [
        f"    - path: {_quoted(file.name)}",
        "      starting_time:",
        f"        nanoseconds_since_epoch: {file.start}",
        "      duration:",
        f"        nanoseconds: {file.end - file.start}",
        f"      message_count: {file.messages}",
    ]


def _list(head: str, lines: Sequence[str]) -> list[str]:
    return [head, *lines] if lines else [f"{head} []"]


def _quoted(text: str) -> str:
    """Return a text in double quotes for YAML, which are the same as in JSON."""
    return json.dumps(text, ensure_ascii=True)


def files_of(path: Path) -> list[Path]:
    """Return the MCAP files of a bag's folder, in the order of their numbers; for anything else, the path itself.

    Raises ConfigError for a folder without such files, or with one that is a pipe, a device or a link out of it.
    """
    if not path.is_dir():
        return [path]
    found = sorted((each for each in path.glob("*.mcap") if each.exists() and not each.is_dir()), key=_natural)
    if found:
        return [given_file(each, inside=path) for each in found]
    if any(path.glob("*.mcap.zstd")):
        raise ConfigError("the files of this bag are compressed as a whole", where=str(path), hint="unzstd *.mcap.zstd")
    hint = "logs are .mcap files; rosbags-convert makes one of a .bag or .db3"
    raise ConfigError("this folder holds no .mcap files", where=str(path), hint=hint)


def _natural(path: Path) -> list[tuple[int, str]]:
    parts = re.split(r"([0-9]+)", path.name)
    return [(int(part), "") if place % 2 else (0, part) for place, part in enumerate(parts)]
