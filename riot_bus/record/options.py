"""Options of a recording as plain values: from a command line, or sent to an agent."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.log.engine.packing import check_compression
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.predicate import parse_predicate
from riot_bus.vocabulary.selector import parse_selector
from riot_bus.zenoh.session_config import OWN_CHUNK

if TYPE_CHECKING:
    from riot_bus.monitors.model import Invariant

__all__ = ["DEFAULT_ENDPOINT", "CaptureOptions", "parse_throttles"]

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
_LEAST_CHUNK, _LARGEST_CHUNK = 1 << 10, 1 << 28  # headers weigh much below; above, `iter_columns` has no room
_MOST_KEYS = 200  # each expression costs a subscriber and a thread


@dataclass(frozen=True, slots=True, kw_only=True)
class CaptureOptions:
    """What to record, and how.

    Attributes:
        endpoint: The router or peer to connect to.
        config: Further Zenoh configuration of the session.
        name: Name under which it is controlled.
        keys: Names or key expressions of the topics to record.
        exclude: Names or key expressions of the topics not to record.
        output: Path of the file, or of the folder of the bag; None for a name with the present time in `folder`.
        folder: Folder for files that are requested remotely; None for the folder of `output`, else the working folder.
        overwrite: Whether the first file may replace an existing one.
        bag: Whether to write a ROS 2 bag: a folder with `metadata.yaml`, only for ROS topics.
        profile: MCAP profile; None for `ros2` if there are ROS nodes.
        compression: `zstd`, `lz4` or `none`.
        chunk_bytes: Size of a chunk before compression.
        chunk_seconds: Age at which a chunk ends, which limits the loss in a crash.
        durable: Whether to force data to the disk as often, so that it survives a crash of the machine.
        queue_bytes: Bytes that may wait in memory for the disk.
        split_bytes: Size at which another file is begun; 0 for never.
        split_seconds: Age at which another file is begun; 0 for never.
        max_files: Number of files of this recording beyond which the oldest are deleted; 0 to keep all.
        ring_seconds: Seconds of messages to keep in memory and to write only on request; 0 to write all messages.
        ring_bytes: Memory for these messages, in bytes, compressed.
        dump_on: Selectors with predicates; a message that meets one writes the ring.
        monitors: Monitors that, when violated, write the ring as well.
        dump_after: Seconds to wait before that, so that what follows is in the file as well.
        paused: Whether to begin paused.
        throttle: Limits on messages per second, `TOPIC=HZ`.
        duration: Seconds after which it ends; 0 for never.
        latched: Whether to fetch what advanced publishers keep for late joiners, such as latched ROS topics.
        graph: Whether to record who communicates with whom.
        types: Types of topics, `TOPIC=TYPE`.
        definitions: Files that define message types.
        seed: Seed to write into the log.
        robot: Name of the robot to write into the log.
        notes: Other entries to write into the log.
        control: Whether it can be controlled while it records.
    """

    endpoint: str = DEFAULT_ENDPOINT
    config: Mapping[str, Any] = field(default_factory=dict)
    name: str = "recorder"
    keys: Sequence[str] = ("**",)
    exclude: Sequence[str] = ()
    output: Path | None = None
    folder: Path | None = None
    overwrite: bool = False
    bag: bool = False
    profile: str | None = None
    compression: str = "zstd"
    chunk_bytes: int = 1 << 20
    chunk_seconds: float = 1.0
    durable: bool = True
    queue_bytes: int = 1 << 28
    split_bytes: int = 0
    split_seconds: float = 0.0
    max_files: int = 0
    ring_seconds: float = 0.0
    ring_bytes: int = 1 << 28
    dump_on: Sequence[str] = ()
    monitors: Sequence[Invariant] = ()
    dump_after: float = 0.0
    paused: bool = False
    throttle: Sequence[str] = ()
    duration: float = 0.0
    latched: bool = True
    graph: bool = True
    types: Sequence[str] = ()
    definitions: Sequence[Path] = ()
    seed: int = 0
    robot: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)
    control: bool = True

    def check(self) -> None:
        """Raise ConfigError if a value is out of range or two contradict each other."""
        if not self.keys:
            raise ConfigError("nothing is to be recorded", hint="name topics or key expressions, or take --all")
        if len(self.keys) > _MOST_KEYS:
            hint = "wildcards and --exclude say it shorter"
            raise ConfigError(f"{len(self.keys)} key expressions are too many", hint=hint)
        check_compression(self.compression, "--compression")
        if not _LEAST_CHUNK <= self.chunk_bytes <= _LARGEST_CHUNK:
            hint = f"{_LEAST_CHUNK} to {_LARGEST_CHUNK}"
            raise ConfigError(f"a chunk cannot have {self.chunk_bytes} bytes", where="--chunk-size", hint=hint)
        for name in ("chunk_seconds", "split_seconds", "ring_seconds", "dump_after", "duration"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ConfigError(f"{value} is no number of 0 or more", where=f"--{name.replace('_', '-')}")
        for name in ("queue_bytes", "split_bytes", "ring_bytes", "max_files"):
            if getattr(self, name) < 0:
                raise ConfigError(f"{getattr(self, name)} is less than 0", where=f"--{name.replace('_', '-')}")
        if not self.name or not all(each.isalnum() or each in "-_." for each in self.name):
            hint = f"letters, digits, '-', '_' and '.': it is part of the key {OWN_CHUNK}/NAME/record"
            raise ConfigError(f"{self.name!r} is no name", where="--name", hint=hint)
        self._check_ring()
        parse_throttles(self.throttle)

    def _check_ring(self) -> None:
        if not self.ring_seconds and (self.dump_on or self.monitors or self.dump_after):
            raise ConfigError("--dump-on and --monitors need a ring to write", hint="such as --ring 30s")
        if self.ring_seconds and (self.split_bytes or self.split_seconds):
            raise ConfigError("--ring writes files when it is told to, and --split-... would have nothing to split")
        if self.max_files and not (self.split_bytes or self.split_seconds or self.ring_seconds):
            hint = "add --split-size or --split-duration"
            raise ConfigError("--max-files needs more than one file", hint=hint)
        for text in self.dump_on:
            selector = parse_selector(text)
            if selector.where is None or selector.field is not None:
                hint = "write it like '/scan where range_max > 10'"
                raise ConfigError(f"{text!r} is no condition of messages", where="--dump-on", hint=hint)
            parse_predicate(selector.where)


def parse_throttles(texts: Sequence[str]) -> dict[str, float]:
    """Parse `TOPIC=HZ`; raises ConfigError if a text is not of this form."""
    found = {}
    for text in texts:
        topic, _, rate = text.rpartition("=")
        try:
            hertz = float(rate)
        except ValueError:
            hertz = 0.0
        if not topic or not 0.0 < hertz < math.inf:
            hint = "write TOPIC=HZ, such as /camera=5"
            raise ConfigError(f"{text!r} does not say how often", where="--throttle", hint=hint)
        found[topic] = hertz
    return found
