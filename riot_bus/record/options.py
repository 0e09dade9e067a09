"""Options of a recording as plain values: from a command line, or sent to an agent."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from riot_bus.config.arguments import DEFAULT_ENDPOINT, parse_seconds, parse_size
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.flags import Definitions, Flag, Types, flags_of

if TYPE_CHECKING:
    from riot_bus.monitors.model import Invariant

_LEAST_CHUNK = 1 << 10  # below it headers weigh much
_MOST_KEYS = 200  # each expression costs a subscriber and a thread


@dataclass(frozen=True, slots=True, kw_only=True)
class CaptureOptions:
    """What to record, and how: the options of `riot record`, declared here alone; 0 is never or none.

    Attributes:
        endpoint: The router or peer to connect to.
        keys: Names or key expressions of the topics to record.
        output: Path of the file, or of the folder of the bag; None for a name with the present time in `folder`.
        folder: Folder for files that are requested remotely; None for the folder of `output`, else the working folder.
        bag: Whether to write a ROS 2 bag: a folder with `metadata.yaml`, only for ROS topics.
        monitors: Monitors that, when violated, write the ring.
        notes: Other entries to write into the log.
    """

    endpoint: str = DEFAULT_ENDPOINT
    config: Mapping[str, Any] = field(default_factory=dict)
    keys: Sequence[str] = ("**",)
    output: Path | None = None
    folder: Path | None = None
    bag: bool = False
    monitors: "Sequence[Invariant]" = ()
    notes: Mapping[str, str] = field(default_factory=dict)
    exclude: Annotated[
        Sequence[str], Flag("Leave these out: names or key expressions; repeatable.", metavar="TOPIC", remote=True)
    ] = ()
    overwrite: Annotated[bool, Flag("Replace the file if it exists.")] = False
    compression: Annotated[
        Literal["zstd", "lz4", "none"], Flag("Compression of chunks.", metavar="zstd|lz4|none", remote=True)
    ] = "zstd"
    chunk_bytes: Annotated[
        int,
        Flag(
            "Write a chunk at this size; a crash costs at most one chunk.",
            "--chunk-size",
            "SIZE",
            read=parse_size,
            text="1MiB",
        ),
    ] = 1 << 20
    chunk_seconds: Annotated[
        float,
        Flag(
            "Write a chunk at this age, even if it is smaller.",
            "--chunk-duration",
            "TIME",
            read=parse_seconds,
            text="1s",
        ),
    ] = 1.0
    durable: Annotated[bool, Flag("Make sure that the file survives a power failure.")] = True
    queue_bytes: Annotated[
        int,
        Flag("Memory for messages that wait for a slow disk.", "--queue-size", "SIZE", read=parse_size, text="256MiB"),
    ] = 1 << 28
    split_bytes: Annotated[
        int,
        Flag(
            "Begin another file at this size, such as 1GB.",
            "--split-size",
            "SIZE",
            read=parse_size,
            remote=(0, 1 << 60),
        ),
    ] = 0
    split_seconds: Annotated[
        float,
        Flag(
            "Begin another file after this time, such as 10min.",
            "--split-duration",
            "TIME",
            read=parse_seconds,
            remote=True,
        ),
    ] = 0.0
    max_files: Annotated[
        int,
        Flag("Keep only this many files of this recording, the newest; 0: all.", least=0, remote=(0, 100_000)),
    ] = 0
    ring_seconds: Annotated[
        float,
        Flag("Keep only the last TIME, in memory; write it only when told.", "--ring", "TIME", read=parse_seconds),
    ] = 0.0
    ring_bytes: Annotated[
        int, Flag("Maximum memory for the ring.", "--ring-size", "SIZE", read=parse_size, text="256MiB")
    ] = 1 << 28
    dump_on: Annotated[
        Sequence[str],
        Flag("Write the ring when a message meets this condition; repeatable.", metavar="'TOPIC where PREDICATE'"),
    ] = ()
    dump_after: Annotated[
        float,
        Flag(
            "Wait this long before writing the ring, to include what follows.",
            metavar="TIME",
            read=parse_seconds,
            text="0s",
        ),
    ] = 0.0
    paused: Annotated[bool, Flag("Begin paused.", "--start-paused -p", remote=True)] = False
    throttle: Annotated[
        Sequence[str],
        Flag("Record at most this many messages per second; repeatable.", metavar="TOPIC=HZ", remote=True),
    ] = ()
    duration: Annotated[float, Flag("End after this time.", metavar="TIME", read=parse_seconds, remote=True)] = 0.0
    latched: Annotated[bool, Flag("Fetch what publishers keep for late joiners.", remote=True)] = True
    graph: Annotated[bool, Flag("Write down who talks to whom.")] = True
    profile: Annotated[
        str | None, Flag("MCAP profile. [default: ros2 if there are ROS nodes]", metavar="ros2|none")
    ] = None
    robot: Annotated[str, Flag("The robot's name, for the log.", env="RIOT_ROBOT")] = ""
    types: Types = ()
    definitions: Definitions = ()
    seed: Annotated[int, Flag("Seed of the run, for the log.", env="RIOT_SEED", remote=True)] = 0
    name: Annotated[str, Flag("Name for riot ctl record.", env="RIOT_RECORDER")] = "recorder"
    control: Annotated[bool, Flag("Obey riot ctl record.")] = True

    def check(self) -> None:
        """Raise ConfigError if a value is out of range or two contradict each other."""
        from riot_bus.log.engine.limits import LARGEST_CHUNK
        from riot_bus.log.engine.packing import check_compression
        from riot_bus.zenoh.session_config import check_own_name

        if not self.keys:
            raise ConfigError("nothing is to be recorded", hint="name topics or key expressions, or take --all")
        if len(self.keys) > _MOST_KEYS:
            hint = "wildcards and --exclude say it shorter"
            raise ConfigError(f"{len(self.keys)} key expressions are too many", hint=hint)
        check_compression(self.compression, "--compression")
        if not _LEAST_CHUNK <= self.chunk_bytes <= LARGEST_CHUNK:
            hint = f"{_LEAST_CHUNK} to {LARGEST_CHUNK}"
            raise ConfigError(f"a chunk cannot have {self.chunk_bytes} bytes", where="--chunk-size", hint=hint)
        for each, flag, names in flags_of(CaptureOptions):
            value = getattr(self, each.name)
            if (flag.read or flag.least is not None) and not 0.0 <= value < math.inf:
                raise ConfigError(f"{value} is not a number of 0 or more", where=names[0])
        check_own_name(self.name, "record")
        self._check_ring()
        parse_throttles(self.throttle)

    def _check_ring(self) -> None:
        from riot_bus.vocabulary.predicate import parse_predicate
        from riot_bus.vocabulary.selector import parse_selector

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
                raise ConfigError(f"{text!r} is not a condition of messages", where="--dump-on", hint=hint)
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
