"""Final report of `riot ros-test` on what passed through its router; it stresses if nothing did."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.redaction import escape_control_chars

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from riot_bus.processes.placement import StartedProcesses
    from riot_bus.router.counts import Losses, TopicCounts

_MOST_NAMES = 12  # at about 20 letters each, three lines of a terminal


@dataclass(frozen=True, slots=True, kw_only=True)
class Passage:
    """Messages that passed through the router of one command, and what happened to them.

    Attributes:
        crossed: Number of intercepted messages that had a subscriber in another segment; without service calls, which
            always have a receiver.
        errors: Number of messages on which an interceptor failed, and the first error, by name of the interceptor.
        nodes: Regular expression for the processes chosen for the segment `unit`; None if none were.
    """

    wanted: Sequence[str]
    counts: Mapping[str, TopicCounts]
    crossed: int
    losses: Losses
    hits: Sequence[int] | None = None
    problems: Mapping[str, str] = field(default_factory=dict)
    errors: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    recording: str = ""
    components: Mapping[str, int] = field(default_factory=dict)
    domains: Mapping[str, int] = field(default_factory=dict)
    nodes: str | None = None
    started: StartedProcesses

    @property
    def vacuous(self) -> str:
        """Reason why the results say nothing about what was asked for; empty if they may."""
        calls = any(each.received for topic, each in self.counts.items() if "/@" in topic)
        if self.wanted and not self.crossed and not calls:
            came = counted(self._sum("received"), "message")
            told = f"{came} of {_some(self.wanted)} came, and none had a receiver in another segment"
            return f"NOTHING WAS INTERCEPTED: {told}"
        if self.hits is not None and not any(self.hits):
            return "NOTHING WAS INJECTED: no injection of the plan was carried out on any message"
        if self.errors and not any(map(self._sum, ("changed", "dropped", "added", "held"))):
            return "NOTHING WAS CHANGED: interceptors failed on the messages that they were given"
        if not self.wanted and not self.components and not self.domains:
            return "NOTHING USED THIS ROUTER: no component has connected to it"
        return ""

    def lines(self) -> list[str]:
        """Return the lines of the report: one on what passed, further ones on what is noteworthy."""
        found = [self._passed()]
        found += [f"not injected: {topic}: {problem}" for topic, problem in self.problems.items()]
        found += [
            f"interceptor {name} failed on {counted(number, 'message')}: {first}"
            for name, (number, first) in self.errors.items()
        ]
        if self.started.chosen:
            found.append(f"in segment unit: {_names(self.started.chosen)}")
        if self.losses:
            reasons = ", ".join(f"{reason}: {number}" for reason, number in self.losses.reasons.items())
            unrecorded = sum(self.losses.recordings.values())
            found += [f"LOST: {counted(sum(self.losses.messages.values()), 'message')} ({reasons})"] if reasons else []
            found += [f"LOST: {counted(unrecorded, 'message')} not recorded"] if unrecorded else []
            found += [f"LOST: {each}" for each in self.losses.links]
        if self.vacuous:
            found += [self.vacuous, *(f"  hint: {hint}" for hint in self._hints())]
        return [escape_control_chars(line) for line in found]

    def _sum(self, name: str) -> int:
        return sum(getattr(each, name) for each in self.counts.values())

    def _passed(self) -> str:
        what = "nothing was to be intercepted"
        if self.wanted:
            topics = sum(each.received > 0 for each in self.counts.values())
            figures = (("changed", "changed"), ("forwarded", "delivered"), *((name, name) for name in _AS_CALLED))
            told = ", ".join(f"{self._sum(name)} {word}" for name, word in figures)
            what = f"{counted(self._sum('received'), 'message')} of {counted(topics, 'topic')} intercepted: {told}"
        if self.hits is not None:
            what += f"; {counted(sum(self.hits), 'injection')} carried out"
        recorded = counted(self._sum("recorded"), "message")
        return what + (f"; recording {self.recording} ({recorded})" if self.recording else "")

    def _hints(self) -> Iterable[str]:
        if not self.components and not self.domains:
            yield (
                "no component has connected to this router: nodes of DDS need --dds; programs that are not Python "
                "read ZENOH_CONFIG (Config::from_env) or take an endpoint, such as $RIOT_ENDPOINT"
            )
        if self.nodes is None and "unit" not in self.components:
            yield "all processes are in the segment system: name those for the segment unit with --unit-nodes"
        elif self.nodes is not None and not self.started.chosen:
            others = _names(self.started.others) or "nothing that Python has started"
            yield f"no process is called {self.nodes!r}; started were: {others}"


_AS_CALLED = ("dropped", "added", "held", "lost")


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:_MOST_NAMES]) + (", ..." if len(names) > _MOST_NAMES else "")


def _names(found: Mapping[str, int]) -> str:
    return _some([name if number == 1 else f"{name} ({number} times)" for name, number in found.items()])
