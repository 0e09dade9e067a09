"""What a unit does in nominal trials: needed to tell working from idling, and a live unit from a silent one."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from riot_bus.monitors.mined import NO_RULES, Mined
from riot_bus.sut.activity import STILL, Idle

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from riot_bus.monitors.model import ResourceSample
    from riot_bus.sut.python_report import ThreadStack
    from riot_bus.vocabulary.message import Message

__all__ = ["UNKNOWN", "Baseline", "NominalTrial", "baseline_of", "probe_of"]

_PROBE = 16
"""Messages of a probe, at least: few, as each trial that passes pays for them."""


class Growth(NamedTuple):
    """Bytes of memory, open files and threads that a unit has more at the end of a trial than at its begin."""

    memory: int
    files: int
    threads: int


NO_GROWTH = Growth(0, 0, 0)
_MUCH = Growth(32 << 20, 32, 32)
"""Growth beyond twice the nominal one that is no chance: allocators keep some MB, pools open some files and threads."""
_PER_BYTE = 8
"""Bytes that a byte of input may cost for good: it is decoded, copied, and kept as the last one."""


def growth_of(samples: Sequence[ResourceSample]) -> Growth:
    """Return what a component has more of at the last sample than at the first."""
    if not samples:
        return NO_GROWTH
    first, last = samples[0], samples[-1]
    return Growth(last.memory - first.memory, last.files - first.files, last.threads - first.threads)


@dataclass(frozen=True, slots=True)
class NominalTrial:
    """What one nominal trial has shown.

    Attributes:
        log_answers: Outputs while the log was played, by topic.
        probe_answers: Outputs while the probe was played after it, by topic.
        stacks: Where Python threads stood at rest.
        main_ended: Whether a Python main thread had come to its end.
        status: Exit status, None if the unit still ran.
        growth: What it has more of at the end than at the begin: bytes of memory, files, threads.
        mute: Monitors that stay silent on a copy of the trial that is to violate them, and why.
        outputs: All outputs, in order of reception.
        probed: Index of the first one that came after the probe had begun; None if there was no probe.
    """

    log_answers: Mapping[str, int]
    probe_answers: Mapping[str, int]
    stacks: Sequence[ThreadStack]
    main_ended: bool
    status: int | None
    growth: Growth = NO_GROWTH
    mute: tuple[str, ...] = ()
    outputs: tuple[Message, ...] = ()
    probed: int | None = None


@dataclass(frozen=True, slots=True)
class Baseline:
    """What all nominal trials of a unit have in common.

    Attributes:
        idle: What the unit does without any input.
        trials: Nominal trials behind it; 0 if nothing is known, and then nothing can be told from it.
        log: The nominal log.
        probe: Some messages of it that a live unit answers.
        log_answers: Least number of outputs that the whole log brought, by topic; topics without any are left out.
        probe_answers: Likewise of the probe after the log.
        at_rest: Functions in which Python threads stood at rest, and how many there were at least.
        threads: Functions in which Python threads began, and how many there were at least.
        main_ends: Whether the main thread ends though the process goes on.
        ends: Whether the unit ends by itself with status 0.
        growth: The most that it grew.
        mute: Monitors that stayed silent on each trial's copy that was to violate them, and why.
        ordered: Whether trials keep the order of the log across topics, if riot.toml leaves it open.
        mined: What answers to the probe have in common.
        alarms: Signatures that nominal trials have shown that were judged by it.
        busy: Seconds of a processor that nominal trials took, per second; 0 if that is not known.
    """

    idle: Idle = STILL
    trials: int = 0
    log: tuple[Message, ...] = ()
    probe: tuple[Message, ...] = ()
    log_answers: Mapping[str, int] = field(default_factory=dict)
    probe_answers: Mapping[str, int] = field(default_factory=dict)
    at_rest: Mapping[str, int] = field(default_factory=dict)
    threads: Mapping[str, int] = field(default_factory=dict)
    main_ends: bool = True
    ends: bool = True
    growth: Growth = NO_GROWTH
    mute: tuple[str, ...] = ()
    ordered: bool = False
    mined: Mined = NO_RULES
    alarms: tuple[str, ...] = ()
    busy: float = 0.0

    @property
    def untold(self) -> tuple[str, ...]:
        """What cannot be told of the unit's trials, and why."""
        if not self.trials:
            return ("whether it still works after a trial: no nominal trials have passed to compare it with",)
        found = []
        if not self.probe_answers:
            found.append("whether it falls silent: it publishes nothing in answer to nominal input")
        if not self.at_rest:
            found.append("where its threads stand: it is no Python program, or runs without site")
        return tuple(found)

    def blocked(self, stacks: Sequence[ThreadStack], *, anywhere: bool) -> tuple[str, ...]:
        """Return the functions in which threads stand that stand elsewhere at rest.

        Args:
            stacks: Where threads stand.
            anywhere: Whether threads count as well that are not missing where threads stand at rest, such as new ones.
        """
        standing = Counter(stack.functions[0] for stack in stacks)
        if not anywhere and all(standing[name] >= count for name, count in self.at_rest.items()):
            return ()
        return tuple(sorted(standing.keys() - self.at_rest.keys()))

    def grown(self, growth: Growth, *, messages: int, input_bytes: int) -> dict[str, str]:
        """Return what has grown out of all proportion, with how much as text.

        Args:
            growth: What the unit has more of after the trial.
            messages: Inputs of the trial.
            input_bytes: Their size.
        """
        usual = Growth(*(max(0, each) for each in self.growth))
        allowed = Growth(*(2 * nominal + much for nominal, much in zip(usual, _MUCH, strict=True)))
        found = {}
        if growth.memory > allowed.memory + _PER_BYTE * input_bytes:
            total, per, nominal = (
                each / 1e6 for each in (growth.memory, growth.memory / max(1, messages), usual.memory)
            )
            found["memory"] = f"{total:.0f} MB more ({per:.1f} MB a message), nominally {nominal:.0f}"
        if growth.files > allowed.files:
            found["files"] = f"{growth.files} more are open, nominally {usual.files}"
        if growth.threads > allowed.threads:
            found["threads"] = f"{growth.threads} more run, nominally {usual.threads}"
        return found

    def lost(self, stacks: Iterable[ThreadStack]) -> tuple[str, ...]:
        """Return the functions in which threads began that are no longer there."""
        now = Counter(stack.functions[-1] for stack in stacks)
        return tuple(sorted(name for name, count in self.threads.items() if now[name] < count))


UNKNOWN = Baseline()
"""Nothing is known, and nothing is concluded."""


def probe_of(log: Sequence[Message]) -> tuple[Message, ...]:
    """Return a short nominal stretch: the last messages of a log, and before them the last one of each other key."""
    first = max(0, len(log) - _PROBE)
    last = {message.key: number for number, message in enumerate(log)}
    return tuple(message for number, message in enumerate(log) if number >= first or last[message.key] == number)


def baseline_of(
    trials: Sequence[NominalTrial], *, idle: Idle, log: Sequence[Message], ordered: bool = False
) -> Baseline:
    """Return what nominal trials have in common."""
    if not trials:
        return Baseline(idle=idle, ordered=ordered)
    return Baseline(
        idle=idle,
        ordered=ordered,
        trials=len(trials),
        log=tuple(log),
        probe=probe_of(log),
        log_answers=_least([trial.log_answers for trial in trials]),
        probe_answers=_least([trial.probe_answers for trial in trials]),
        at_rest=_least([Counter(stack.functions[0] for stack in trial.stacks) for trial in trials]),
        threads=_least([Counter(stack.functions[-1] for stack in trial.stacks) for trial in trials]),
        main_ends=any(trial.main_ended for trial in trials),
        ends=any(trial.status is not None for trial in trials),
        mute=tuple(line for line in trials[0].mute if all(line in trial.mute for trial in trials)),
        growth=Growth(*(max(each) for each in zip(*(trial.growth for trial in trials), strict=True))),
    )


def _least(counts: Sequence[Mapping[str, int]]) -> dict[str, int]:
    """Return the least of each count; what is not in all is left out."""
    least = {name: min(count.get(name, 0) for count in counts) for name in counts[0]}
    return {name: count for name, count in least.items() if count}
