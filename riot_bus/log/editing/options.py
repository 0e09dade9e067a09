"""Options of an edit, as plain values; `EditOptions.design` parses them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from riot_bus.log.editing.assignment import Assignment, parse_assignment
from riot_bus.log.editing.selection import Selection, parse_selection
from riot_bus.log.engine.packing import check_compression
from riot_bus.log.naming import parse_remaps
from riot_bus.vocabulary.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["Design", "EditOptions", "Shift"]

_LONGEST_S = 9e9  # 285 years: shifts are nanoseconds in 64 bits with a sign, which span 292
_LARGEST_CHUNK = 1 << 28  # as in record.options: memory holds whole chunks; readers refuse more than 1 GiB
_UNRECORDED = {"inputs", "output", "originals", "chunk_bytes", "definitions", "force", "dry_run"}
_RECORDED_AS = {"changes": "set", "shifts": "shift"}


@dataclass(frozen=True, slots=True)
class Shift:
    """A shift of the times of messages.

    Attributes:
        topic: Name or key expression; None for all topics.
        delta: Nanoseconds that are added.
    """

    topic: str | None
    delta: int


@dataclass(frozen=True, slots=True)
class Design:
    """The steps of an edit, in the order of the attributes."""

    keep: Sequence[Selection]
    drop: Sequence[Selection]
    changes: Sequence[Assignment]
    shifts: Sequence[Shift]
    remaps: Mapping[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class EditOptions:
    """The inputs, changes and outputs of an edit.

    Attributes:
        inputs: MCAP files, or folders of ROS 2 bags; merged by time.
        output: An MCAP file, or, if its name does not end in `.mcap`, the folder of a ROS 2 bag.
        start: Where to begin, as `naming.parse_time` takes it; None at the beginning.
        end: Where to end, exclusive.
        duration: Seconds from `start` on, in place of `end`.
        latched: Whether to begin with the last messages of latched topics from before `start`.
        align: Whether all logs begin at the same time, whenever they were recorded.
        keep: Selections, of which a message must meet one; empty for all.
        drop: Selections, of which a message may meet none.
        changes: Assignments, such as `TOPIC:FIELD = VALUE`.
        interceptors: Names of the interceptors, for the record that the output holds.
        plan: Text of the injection plan, for the same record.
        seed: Seed of everything that is random, for the same record.
        shifts: Shifts of times, as `SECONDS` or `TOPIC=SECONDS`.
        remap: New names of topics, as `OLD:=NEW`.
        originals: Whether originals and provenance stay; never in the folder of a ROS 2 bag.
        salvage: Whether to take messages of damaged chunks that an index confirms.
        sort: Whether to sort by time even if there is only one input.
        compression: `zstd`, `lz4` or `none`; None for that of the first input.
        chunk_bytes: Size of a chunk before compression.
        split_seconds: Seconds of the log's time after which another file begins.
        split_bytes: Size of a file at which another one begins.
        split_topics: Whether each topic gets a file of its own.
        types: Type names by topic or key expression.
        definitions: Files that define message types.
        force: Whether existing files are replaced.
        dry_run: Whether nothing is written, only reported.
    """

    inputs: Sequence[Path]
    output: Path
    start: str | None = None
    end: str | None = None
    duration: float | None = None
    latched: bool = False
    align: bool = False
    keep: Sequence[str] = ()
    drop: Sequence[str] = ()
    changes: Sequence[str] = ()
    interceptors: Sequence[str] = ()
    plan: str | None = None
    seed: int = 0
    shifts: Sequence[str] = ()
    remap: Sequence[str] = ()
    originals: bool = True
    salvage: bool = False
    sort: bool = False
    compression: str | None = None
    chunk_bytes: int = 1 << 20
    split_seconds: float | None = None
    split_bytes: int | None = None
    split_topics: bool = False
    types: Mapping[str, str] = field(default_factory=dict)
    definitions: Sequence[Path] = ()
    force: bool = False
    dry_run: bool = False

    @property
    def folder(self) -> bool:
        """Whether the output is the folder of a ROS 2 bag."""
        return self.output.suffix != ".mcap"

    @property
    def splits(self) -> bool:
        """Whether there may be several files."""
        return self.split_topics or self.split_seconds is not None or self.split_bytes is not None

    def design(self) -> Design:
        """Return the parsed steps; raises ConfigError if an option is wrong."""
        if not self.inputs:
            raise ConfigError("no log to edit is named", hint="write riot edit IN.mcap OUT.mcap")
        if self.compression is not None:
            check_compression(self.compression, "--compression")
        if self.duration is not None and self.end is not None:
            raise ConfigError("--duration and --end both say where to end", hint="choose one")
        for option, value in (("--duration", self.duration), ("--split-duration", self.split_seconds)):
            if value is not None and not 0.0 < value <= _LONGEST_S:
                raise ConfigError(f"{value} s is not above 0, or above {_LONGEST_S:g} s", where=option)
        if not 0 < self.chunk_bytes <= _LARGEST_CHUNK:
            raise ConfigError(f"a chunk has 1 to {_LARGEST_CHUNK} bytes, not {self.chunk_bytes}", where="--chunk-size")
        if self.split_bytes is not None and self.split_bytes <= 0:
            raise ConfigError(f"a file has at least 1 byte, not {self.split_bytes}", where="--split-size")
        return Design(
            [parse_selection(text, "--keep") for text in self.keep],
            [parse_selection(text, "--drop") for text in self.drop],
            [parse_assignment(text, "--set") for text in self.changes],
            [_shift(text) for text in self.shifts],
            parse_remaps(self.remap),
        )

    def to_json(self) -> dict[str, Any]:
        """Return the options as JSON values, for the record that the output holds."""
        found = {_RECORDED_AS.get(name, name): value for name, value in asdict(self).items() if name not in _UNRECORDED}
        found["without_originals"] = not self.originals or self.folder
        return {name: value for name, value in found.items() if value}


def _shift(text: str) -> Shift:
    topic, equals, seconds = text.rpartition("=")
    try:
        delta = float(seconds)
    except ValueError:
        delta = math.nan
    if not -_LONGEST_S <= delta <= _LONGEST_S or (equals and not topic.strip()):
        hint = "write --shift -0.5, or --shift /odom=0.1"
        raise ConfigError(f"{text!r} does not say how far in seconds", where="--shift", hint=hint)
    return Shift(topic.strip() or None, round(delta * 1e9))
