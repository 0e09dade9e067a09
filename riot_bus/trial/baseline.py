"""Baselines: how a unit behaves in nominal trials, to tell working from idling, and a live unit from a silent one."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from riot_bus.monitors.mined import NO_RULES, Mined
from riot_bus.processes.activity import STILL, Idle

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from riot_bus.monitors.model import ResourceSample
    from riot_bus.processes.python_report import ThreadStack
    from riot_bus.vocabulary.message import Message

_PROBE = 16
"""Least number of messages of a probe: small, since each passing trial spends time on them."""


class Growth(NamedTuple):
    """Increase of a unit's memory in bytes, open files and threads from the start to the end of a trial."""

    memory: int = 0
    files: int = 0
    threads: int = 0


NO_GROWTH = Growth()
_MUCH = Growth(32 << 20, 32, 32)
"""Allowed growth above twice the nominal one: allocators keep some MB, pools open some files and threads."""
_PER_BYTE = 8
"""Allowed permanent growth in bytes per byte of input, which is decoded, copied, and kept as the last message."""


def growth_of(samples: Sequence[ResourceSample]) -> Growth:
    """Return the growth of a component from the first sample to the last one."""
    if not samples:
        return NO_GROWTH
    first, last = samples[0], samples[-1]
    return Growth(last.memory - first.memory, last.files - first.files, last.threads - first.threads)


@dataclass(frozen=True, slots=True)
class NominalTrial:
    """Observations of one nominal trial.

    Attributes:
        log_answers: Number of outputs while the log was played, by topic.
        probe_answers: Number of outputs while the probe was played after the log, by topic.
        main_ended: Whether a Python main thread had ended.
        status: Exit status, None if the unit still ran.
        mute: Monitors that miss the violation in a copy of the trial made to violate them, and why.
        probed: Index of the first output after the start of the probe; None if there was no probe.
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
    """Common behaviour of all nominal trials of a unit.

    Attributes:
        trials: Number of nominal trials; 0 if nothing is known, so that nothing can be concluded.
        probe: Some messages of the log that a live unit answers.
        log_answers: Least number of outputs for the whole log, by topic; topics without any are left out.
        probe_answers: Least number of outputs for the probe after the log, by topic; topics without any are left out.
        at_rest: Functions in which Python threads stood at rest, with the least number of threads in each.
        threads: Functions in which Python threads began, with the least number of threads of each.
        main_ends: Whether the main thread ends although the process continues.
        ends: Whether the unit ends by itself with status 0.
        mute: Monitors that miss the violation in a copy of each trial made to violate them, and why.
        ordered: Whether trials keep the order of the log across topics, if riot.toml leaves it open.
        mined: Mined rules that all answers to the probe follow.
        alarms: Signatures of violations in nominal trials that were judged by this baseline.
        busy: Processor time of nominal trials in seconds per second; 0 if it is not known.
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
    def follows(self) -> tuple[Message, ...]:
        """Messages that follow those of a trial, to see whether the unit still works; none if nothing is known."""
        return self.probe if self.trials and self.probe_answers else ()

    @property
    def untold(self) -> tuple[str, ...]:
        """Properties of the unit's trials that cannot be judged, and why."""
        if not self.trials:
            return ("whether it still works after a trial: no nominal trials have passed to compare it with",)
        found = []
        if not self.probe_answers:
            found.append("whether it falls silent: it publishes nothing in answer to nominal input after the log")
        if not self.at_rest:
            found.append("where its threads stand: it is not a Python program, or runs without site")
        return tuple(found)

    def blocked(self, stacks: Sequence[ThreadStack], *, anywhere: bool) -> tuple[str, ...]:
        """Return the functions in which threads stand now, but no thread stands at rest.

        Args:
            stacks: Present stacks of the threads.
            anywhere: Whether threads such as new ones count even if no thread is missing from its place at rest.
        """
        standing = Counter(stack.functions[0] for stack in stacks)
        if not anywhere and all(standing[name] >= count for name, count in self.at_rest.items()):
            return ()
        return tuple(sorted(standing.keys() - self.at_rest.keys()))

    def grown(self, growth: Growth, *, messages: int, input_bytes: int) -> dict[str, str]:
        """Return the resources that have grown too much, each with a text that says how much."""
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

    def excess(self, growth: Growth, *, input_bytes: int) -> float:
        """Return the growth that neither nominal growth nor the input explains, as a share of what is allowed above it.

        Returns:
            The largest share among memory, files and threads; 0 if nothing is known.
        """
        if not self.trials:
            return 0.0
        more = (now - max(0, usual) for now, usual in zip(growth, self.growth, strict=True))
        explained = (_PER_BYTE * input_bytes, 0, 0)
        return max(0.0, *((each - own) / much for each, own, much in zip(more, explained, _MUCH, strict=True)))

    def lost(self, stacks: Iterable[ThreadStack]) -> tuple[str, ...]:
        """Return the functions in which now missing threads began."""
        now = Counter(stack.functions[-1] for stack in stacks)
        return tuple(sorted(name for name, count in self.threads.items() if now[name] < count))


UNKNOWN = Baseline()
"""Nothing is known, and nothing is concluded."""


def probe_of(log: Sequence[Message]) -> tuple[Message, ...]:
    """Return a short part of a nominal log: its last messages, preceded by the last one of each other key.

    Keys with a single message are left out, unless there are no others: units may rightly refuse to get it twice.
    """
    counts = Counter(message.key for message in log)
    some = [message for message in log if counts[message.key] > 1] or log
    first = max(0, len(some) - _PROBE)
    last = {message.key: number for number, message in enumerate(some)}
    return tuple(message for number, message in enumerate(some) if number >= first or last[message.key] == number)


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
    """Return the least of each count, without names that are missing or 0 in one of them."""
    least = {name: min(count.get(name, 0) for count in counts) for name in counts[0]}
    return {name: count for name, count in least.items() if count}
