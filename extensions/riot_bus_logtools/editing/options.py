"""Options of an edit, as plain values; `EditOptions.design` parses them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

from riot_bus.config.arguments import parse_seconds, parse_size
from riot_bus.log.engine.limits import LARGEST_CHUNK
from riot_bus.log.engine.packing import check_compression
from riot_bus.log.naming import parse_remaps
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.flags import Definitions, Flag, Interceptors, Salvage, Seed
from riot_bus_logtools.editing.assignment import Assignment, parse_assignment
from riot_bus_logtools.editing.selection import Selection, parse_selection

_LONGEST_S = 9e9  # 285 years: shifts are nanoseconds in 64 bits with a sign, which span 292
_UNRECORDED = {"inputs", "output", "originals", "chunk_bytes", "definitions", "force", "dry_run"}
_RECORDED_AS = {"changes": "set", "shifts": "shift"}


@dataclass(frozen=True, slots=True)
class Shift:
    """A shift of the times of messages.

    Attributes:
        topic: Name or key expression; None for all topics.
        delta: Nanoseconds that are added to the log time and the publish time.
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
    """The inputs, changes and outputs of an edit: the options of `riot edit`, declared here alone.

    Attributes:
        inputs: MCAP files, or folders of ROS 2 bags; merged by time.
        output: An MCAP file, or, if its name does not end in `.mcap`, the folder of a ROS 2 bag.
        plan: Text of the injection plan, for the record that the output holds.
        types: Type names by topic or key expression.
    """

    inputs: Sequence[Path]
    output: Path
    plan: str | None = None
    types: Mapping[str, str] = field(default_factory=dict)
    start: Annotated[
        str | None, Flag("Begin there: seconds from the beginning, or a date and time.", metavar="TIME")
    ] = None
    end: Annotated[str | None, Flag("End there, likewise; exclusive.", metavar="TIME")] = None
    duration: Annotated[
        float | None, Flag("Keep only this much, such as 90, 90s or 5min.", metavar="TIME", read=parse_seconds)
    ] = None
    latched: Annotated[bool, Flag("Begin with the last messages of latched topics before --start.")] = False
    align: Annotated[bool, Flag("Let all inputs begin at the same time.")] = False
    keep: Annotated[
        Sequence[str],
        Flag(
            "Keep these messages only; repeatable.",
            "--keep --topics",
            "'TOPIC [during A..B] [index I..J] [every N] [where PREDICATE]'",
        ),
    ] = ()
    drop: Annotated[
        Sequence[str], Flag("Leave out these; as for --keep; repeatable.", "--drop --exclude", "'TOPIC ...'")
    ] = ()
    changes: Annotated[
        Sequence[str],
        Flag(
            "Set a field, or change it with += -= *= /=; conditions as for --keep may follow; repeatable.",
            "--set",
            "'TOPIC:FIELD = VALUE ...'",
        ),
    ] = ()
    shifts: Annotated[Sequence[str], Flag("Move messages in time; repeatable.", "--shift", "[TOPIC=]SECONDS")] = ()
    remap: Annotated[
        Sequence[str], Flag("Rename a topic, or all below it: '/a/**:=/b/**'.", "--remap -m", "OLD:=NEW")
    ] = ()
    originals: Annotated[bool, Flag("Also keep messages as they were before interceptors; never in a ROS 2 bag.")] = (
        True
    )
    salvage: Salvage = False
    sort: Annotated[bool, Flag("Write by time, even if the input is in another order.")] = False
    compression: Annotated[
        str | None, Flag("Compression of the output. [default: as the input]", metavar="zstd|lz4|none")
    ] = None
    chunk_bytes: Annotated[
        int, Flag("Size of a chunk before compression.", "--chunk-size", "SIZE", read=parse_size, text="1MiB")
    ] = 1 << 20
    split_bytes: Annotated[
        int | None, Flag("Begin another file at this size, such as 1GB.", "--split-size", "SIZE", read=parse_size)
    ] = None
    split_seconds: Annotated[
        float | None,
        Flag("Begin another file after this much of the log's time.", "--split-duration", "TIME", read=parse_seconds),
    ] = None
    split_topics: Annotated[bool, Flag("Write a file for each topic.")] = False
    definitions: Definitions = ()
    seed: Seed = 0
    force: Annotated[bool, Flag("Replace the output if it exists.", "--force -f")] = False
    dry_run: Annotated[bool, Flag("Write nothing; say what would be kept.", "--dry-run -n")] = False
    interceptors: Interceptors = ()

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
        if not 0 < self.chunk_bytes <= LARGEST_CHUNK:
            raise ConfigError(f"a chunk has 1 to {LARGEST_CHUNK} bytes, not {self.chunk_bytes}", where="--chunk-size")
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
