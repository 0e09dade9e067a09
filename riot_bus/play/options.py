"""Options of a playback as plain values: from a command line, or sent to an agent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from riot_bus.log.limits import LogLimits
from riot_bus.log.naming import parse_remaps, parse_time
from riot_bus.log.playback.player import check_rate
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.session_config import OWN_CHUNK

__all__ = ["DEFAULT_ENDPOINT", "PlayOptions", "parse_latched", "parse_remaps", "parse_until"]

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
_LONGEST_S = 1e9  # 32 years, which fit into 64 bits as nanoseconds, too


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayOptions:
    """What to play, and how.

    Attributes:
        logs: MCAP files, or folders that hold the files of one recording; merged by time.
        endpoint: The router to publish to.
        config: Further Zenoh configuration of the client.
        name: Name under which it is controlled.
        rate: Speed; 0 is as fast as possible.
        loop: Whether to start again at the end.
        delay: Seconds before each pass.
        start_offset: Seconds of the logs that are left out at the beginning.
        duration: Seconds of the logs to play.
        until: Where to end: seconds from the beginning, or a point in time.
        align: Whether all logs begin at the same time, whenever they were recorded.
        topics: Names or key expressions of the topics to play; empty for all.
        exclude: Names or key expressions of the topics not to play.
        remap: New names of topics, `OLD:=NEW`.
        paused: Whether to begin paused.
        hold: Whether to stay after the end, so that late joiners get latched messages.
        clock: Frequency of `/clock`, hertz; 0 not to publish it.
        wait: Longest time in seconds to wait for subscribers of all topics.
        lockstep: Keys that must be quiet before the next message.
        ack: A key on which each message is acknowledged before the next one.
        quiet: Seconds for which these keys must be quiet.
        settle_timeout: Seconds after which the next message comes anyway.
        inject: File of an injection plan.
        interceptors: Interceptors, as for `riot router --interceptor`.
        salvage: Whether messages of damaged chunks are taken as far as an index confirms them.
        limits: Limits for reading each log; None for the usual ones.
        types: Types of topics, `TOPIC=TYPE`.
        definitions: Files that define message types.
        seed: Seed of everything that is random.
        domain: ROS domain to publish in.
        latched: Topics to latch whatever was recorded, `TOPIC` or `TOPIC=DEPTH`.
        control: Whether it can be controlled while it plays.
    """

    logs: Sequence[Path]
    endpoint: str = DEFAULT_ENDPOINT
    config: Mapping[str, Any] = field(default_factory=dict)
    name: str = "player"
    rate: float = 1.0
    loop: bool = False
    delay: float = 0.0
    start_offset: float = 0.0
    duration: float | None = None
    until: str | None = None
    align: bool = False
    topics: Sequence[str] = ()
    exclude: Sequence[str] = ()
    remap: Sequence[str] = ()
    paused: bool = False
    hold: bool = False
    clock: float = 0.0
    wait: float = 2.0
    lockstep: Sequence[str] = ()
    ack: str | None = None
    quiet: float = 0.05
    settle_timeout: float = 5.0
    inject: Path | None = None
    interceptors: Sequence[str] = ()
    salvage: bool = False
    limits: LogLimits | None = None
    types: Sequence[str] = ()
    definitions: Sequence[Path] = ()
    seed: int = 0
    domain: int | None = None
    latched: Sequence[str] = ()
    control: bool = True

    def check(self) -> None:
        """Raise ConfigError if a value is out of range or two contradict each other."""
        if not self.logs:
            raise ConfigError("no log to play is named", hint="write riot play LOG.mcap")
        check_rate(self.rate)
        for name in ("delay", "start_offset", "duration", "clock", "wait", "quiet", "settle_timeout"):
            value = getattr(self, name)
            if value is not None and not 0.0 <= value <= _LONGEST_S:
                raise ConfigError(f"{value} is not from 0 to 1e9", where=f"--{name.replace('_', '-')}")
        if not 0.0 <= self.clock <= 1000.0:
            raise ConfigError(f"{self.clock:g} Hz is too high", where="--clock", hint="at most 1000")
        if self.duration is not None and self.until is not None:
            raise ConfigError("--duration and --until both say where to end", hint="choose one")
        if self.ack is not None and self.lockstep:
            raise ConfigError("--ack and --lockstep both say when to go on", hint="choose one")
        if not self.name or not all(each.isalnum() or each in "-_." for each in self.name):
            hint = f"letters, digits, '-', '_' and '.': it is part of the key {OWN_CHUNK}/NAME/play"
            raise ConfigError(f"{self.name!r} is no name", where="--name", hint=hint)


def parse_latched(texts: Sequence[str]) -> dict[str, int]:
    """Parse `TOPIC` or `TOPIC=DEPTH`; raises ConfigError if a text is not of this form."""
    found = {}
    for text in texts:
        topic, depth = text.rsplit("=", 1) if "=" in text else (text, "1")
        if not topic or not depth.isdecimal() or not 0 < int(depth) <= 1 << 20:
            hint = "write TOPIC or TOPIC=DEPTH, such as /map=1"
            raise ConfigError(f"{text!r} does not say what to latch", where="--latched", hint=hint)
        found[topic] = int(depth)
    return found


def parse_until(text: str, start: int) -> int:
    """Return a time of the logs in nanoseconds; see `riot_bus.log.naming.parse_time`."""
    return parse_time(text, start, where="--until")
