"""Options of a playback as plain values: from a command line, or sent to an agent."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

from riot_bus.config.arguments import DEFAULT_ENDPOINT
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.flags import Definitions, Flag, Interceptors, Salvage, Seed, Types, flags_of

if TYPE_CHECKING:
    from riot_bus.log.engine.limits import LogLimits

_LONGEST_S = 1e9  # 32 years, which fit into 64 bits as nanoseconds, too


@dataclass(frozen=True, slots=True, kw_only=True)
class PlayOptions:
    """What to play, and how: the options of `riot play`, declared here alone.

    Attributes:
        logs: MCAP files, or folders that hold the files of one recording; merged by time.
        limits: Limits for reading each log; None for the usual ones.
    """

    logs: Sequence[Path]
    endpoint: str = DEFAULT_ENDPOINT
    config: Mapping[str, Any] = field(default_factory=dict)
    limits: "LogLimits | None" = None
    rate: Annotated[float, Flag("Speed; 0 is as fast as possible.", "-r", remote=(0, 1e6))] = 1.0
    loop: Annotated[bool, Flag("Begin again at the end.", "-l", remote=True)] = False
    delay: Annotated[float, Flag("Wait before each pass.", "-d", "SECONDS", remote=True)] = 0.0
    start_offset: Annotated[float, Flag("Leave out this much at the beginning.", metavar="SECONDS", remote=True)] = 0.0
    duration: Annotated[float | None, Flag("Play this much of the logs' time.", metavar="SECONDS", remote=True)] = None
    until: Annotated[
        str | None, Flag("End there: seconds from the beginning, or a date and time.", metavar="TIME", remote=True)
    ] = None
    align: Annotated[bool, Flag("Let all logs begin at the same time.", remote=True)] = False
    topics: Annotated[
        Sequence[str], Flag("Play these: names or key expressions; repeatable.", metavar="TOPIC", remote=True)
    ] = ()
    exclude: Annotated[Sequence[str], Flag("Leave these out: likewise; repeatable.", metavar="TOPIC", remote=True)] = ()
    remap: Annotated[
        Sequence[str], Flag("Rename a topic, or all below it: '/a/**:=/b/**'.", "-m", "OLD:=NEW", remote=True)
    ] = ()
    paused: Annotated[bool, Flag("Begin paused.", "--start-paused -p", remote=True)] = False
    hold: Annotated[bool, Flag("Stay at the end, for late joiners of latched topics.")] = False
    clock: Annotated[
        float,
        Flag(
            "Publish /clock for ROS 2's simulated time; without HZ, 40 times a second.",
            metavar="[HZ]",
            remote=(0, 1000),
        ),
    ] = 0.0
    wait: Annotated[
        float,
        Flag("Wait at most this long until all topics have subscribers.", metavar="SECONDS", remote=(0, 600)),
    ] = 2.0
    lockstep: Annotated[
        Sequence[str],
        Flag("Wait after each message until this key is quiet (--quiet); repeatable.", metavar="KEYEXPR", remote=True),
    ] = ()
    ack: Annotated[
        str | None, Flag("Wait after each message until one comes on this key.", metavar="KEYEXPR", remote=True)
    ] = None
    quiet: Annotated[
        float,
        Flag("Time without a message that counts as quiet, for --lockstep.", metavar="SECONDS", remote=True),
    ] = 0.05
    settle_timeout: Annotated[
        float, Flag("Longest wait after a message, for --lockstep and --ack.", metavar="SECONDS", remote=True)
    ] = 5.0
    inject: Annotated[Path | None, Flag("Injections into what is played.", metavar="PLAN.toml", env="RIOT_INJECT")] = (
        None
    )
    interceptors: Interceptors = ()
    seed: Seed = 0
    domain: Annotated[
        int | None,
        Flag("ROS domain to publish in. [default: as recorded; for bags ROS_DOMAIN_ID, else 0]", remote=(0, 232)),
    ] = None
    latched: Annotated[
        Sequence[str],
        Flag("Keep the last messages for late joiners, whatever was recorded.", metavar="TOPIC[=DEPTH]", remote=True),
    ] = ()
    salvage: Salvage = False
    types: Types = ()
    definitions: Definitions = ()
    name: Annotated[str, Flag("Name for riot ctl play.", env="RIOT_PLAYER")] = "player"
    control: Annotated[bool, Flag("Obey riot ctl play.")] = True

    def check(self) -> None:
        """Raise ConfigError if a value is out of range or two contradict each other."""
        from riot_bus.log.playback.player import check_rate
        from riot_bus.zenoh.session_config import check_own_name

        if not self.logs:
            raise ConfigError("no log to play is named", hint="write riot play LOG.mcap")
        check_rate(self.rate)
        for each, _, names in flags_of(PlayOptions):
            kind, value = get_args(each.type)[0], getattr(self, each.name)
            if float in (kind, *get_args(kind)) and value is not None and not 0.0 <= value <= _LONGEST_S:
                raise ConfigError(f"{value} is not from 0 to 1e9", where=names[0])
        if not 0.0 <= self.clock <= 1000.0:
            raise ConfigError(f"{self.clock:g} Hz is too high", where="--clock", hint="at most 1000")
        if self.duration is not None and self.until is not None:
            raise ConfigError("--duration and --until both say where to end", hint="choose one")
        if self.ack is not None and self.lockstep:
            raise ConfigError("--ack and --lockstep both say when to go on", hint="choose one")
        check_own_name(self.name, "play")


@dataclass(frozen=True, slots=True, kw_only=True)
class Expectation:
    """What is expected of the answers to a playback: the options of `riot play --expect`, declared here alone."""

    expect: Annotated[Path, Flag("Record the system's answers, and compare them with this log.", metavar="LOG")]
    expect_topics: Annotated[
        Sequence[str],
        Flag("Compare these. [default: all of the --expect log that are not played]", metavar="TOPIC"),
    ] = ()
    expect_wait: Annotated[
        float, Flag("Wait at most this long for answers when all is played.", metavar="SECONDS", least=0)
    ] = 10.0
    answers: Annotated[Path | None, Flag("With --expect: keep the answers in this file.", metavar="FILE")] = None


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
