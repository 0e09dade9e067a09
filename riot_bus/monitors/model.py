"""The view of a finished trial that monitors judge, and the judgement of all monitors."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Protocol, cast, runtime_checkable

from riot_bus.vocabulary.errors import PayloadError, did_you_mean

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Violation

_ALWAYS_HELD_UP = 0.05
"""Share of the time that a thread may wait for a processor on a machine that has nothing else to do."""


@dataclass(frozen=True, slots=True)
class ResourceSample:
    """Resources used by a component at one moment, by all its processes together.

    Attributes:
        time: Nanoseconds since the epoch.
        messages: Number of inputs published by then.
        memory: Resident memory, bytes.
        files: Number of open file descriptors.
        threads: Number of threads.
    """

    time: int
    messages: int
    memory: int
    files: int
    threads: int


@dataclass(frozen=True, slots=True)
class Signs:
    """Differences of a component's state after a trial from that after nominal trials; empty where they are not known.

    Attributes:
        ended: Reason why it has ended, perhaps while its process still runs; empty if it has not, or is allowed to.
        silent: Outputs of nominal trials that no nominal input brings back.
        blocked: Functions in which threads block that wait elsewhere at rest.
        lost: Start functions of threads that no longer exist.
        grown: Resources much larger than after nominal trials: `memory`, `files`, `threads`, with the size as text.
        stacks: Stacks of all threads, as text.
        known: Whether it hangs where an earlier trial waited in full, so that this one did not.
    """

    ended: str = ""
    silent: Sequence[str] = ()
    blocked: Sequence[str] = ()
    lost: Sequence[str] = ()
    grown: Mapping[str, str] = field(default_factory=dict)
    stacks: str = ""
    known: bool = False


NO_SIGNS = Signs()


@dataclass(frozen=True, slots=True)
class ComponentView:
    """One component at the end of a trial.

    Attributes:
        status: Exit status, negative for a signal, None if it still ran.
        errors: Text that it wrote to stderr.
        root: Folder of its code; frames outside it belong to others.
        tracebacks: Whether a traceback in stderr of a live process counts as a crash.
        printed: Text that it wrote to stdout.
        stack: File and function of each native frame at the signal that ended it, innermost first.
        resources: Its use of resources over time.
        signs: Differences of its state from that after nominal trials.
        excess: Resource limit for which it was ended, and the usage as text; None if it was not.
        unread: Number of bytes in the middle of its output that are missing in `errors` and `printed`.
    """

    name: str
    status: int | None
    errors: str
    root: Path
    tracebacks: bool = True
    printed: str = ""
    stack: Sequence[tuple[str, str]] = ()
    resources: Sequence[ResourceSample] = ()
    signs: Signs = NO_SIGNS
    excess: tuple[str, str] | None = None
    unread: int = 0


@dataclass(frozen=True, slots=True)
class TrialView:
    """A finished trial.

    Attributes:
        settled: False when components were still busy at the deadline.
        waited: That deadline, seconds.
        outputs: Messages of the watched outputs, in order of reception.
        inputs: Messages published to the components, each with its time of publication.
        probed: Index of the first output that came after the last probe had begun; None if there was none.
        end: Time at which watching ended, nanoseconds since the epoch.
        held_up: Seconds for which components or riot waited for a processor since the first input.
    """

    components: Sequence[ComponentView]
    settled: bool
    waited: float
    registry: TypeRegistry
    outputs: Sequence[Message] = ()
    begin: int = 0
    end: int = 0
    stalled: Sequence[str] = field(default_factory=list)
    inputs: Sequence[Message] = ()
    probed: int | None = None
    held_up: float = 0.0

    @property
    def late(self) -> float:
        """Seconds by which outputs may be late because the machine was busy; 0 if it was no busier than usual."""
        return self.held_up if self.held_up * 1e9 > _ALWAYS_HELD_UP * (self.end - self.start) else 0.0

    @property
    def start(self) -> int:
        """Time of the first input, nanoseconds since the epoch; `begin` where no inputs are known."""
        return min((message.time for message in self.inputs), default=self.begin)


class Monitor(Protocol):
    """An oracle over one finished trial."""

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return what was violated."""
        ...


class Invariant(Monitor, Protocol):
    """A monitor of `[[monitors]]` in riot.toml; it can also judge a running system."""

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics whose messages it looks at."""
        ...


@runtime_checkable
class TellsUnseen(Protocol):
    """A monitor that knows whether a trial had something for it to judge; for others, their topics decide."""

    def unseen(self, view: TrialView) -> str | None:
        """Return why there was nothing to judge, None if there was something."""
        ...


@runtime_checkable
class MissesMessages(Protocol):
    """A monitor that is violated when messages of some topics are missing, perhaps only since a topic is misspelt."""

    @property
    def missed(self) -> Sequence[str]:
        """Topics whose missing messages are a violation."""
        ...


@runtime_checkable
class Forges(Protocol):
    """A monitor that can show that it is able to fire."""

    def forge(self, view: TrialView) -> TrialView:
        """Return a copy of a trial that violates the monitor; raises PayloadError if none can be made."""
        ...


@dataclass(frozen=True, slots=True)
class Judgement:
    """Results of all monitors for one trial.

    Attributes:
        violations: Violations in the order of the monitors.
        broken: A line for each monitor that failed itself, and each component whose output was not read in full.
        unseen: A line for each monitor that had nothing to judge, with the reason.
        baseless: Reasons by signature, for violations by missing messages where the topics had no message at all:
            they may be misspelt.
    """

    violations: tuple[Violation, ...] = ()
    broken: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()
    baseless: Mapping[str, str] = field(default_factory=dict)


def judge(view: TrialView, monitors: Sequence[Monitor]) -> Judgement:
    """Ask all monitors; one that raises is isolated and reported."""
    violations: list[Violation] = []
    broken = [f"{each.name}: it wrote so much that the middle was not read" for each in view.components if each.unread]
    unseen: list[str] = []
    baseless: dict[str, str] = {}
    for name, monitor in zip(names_of(monitors), monitors, strict=True):
        error: Exception | None = None
        try:
            found = tuple(monitor.judge(view))
        except Exception as raised:
            found, error = (), raised
        violations.extend(found)
        reason = None
        if not found and (error is None or isinstance(error, PayloadError)):  # such as for a field that no message has
            try:
                reason = why_nothing_to_judge(monitor, view)
            except Exception as raised:
                error = error or raised
        topics = monitor.missed if found and isinstance(monitor, MissesMessages) else ()
        missed = [why_no_message(view, topic) for topic in topics]
        if missed and all(missed):
            baseless |= {each.signature: str(missed[0]) for each in found}
        if reason is not None:
            unseen.append(f"{name}: {reason}")
        elif error is not None:
            broken.append(f"{name}: {type(error).__name__}: {error}")
    return Judgement(tuple(violations), tuple(broken), tuple(unseen), baseless)


def names_of(monitors: Iterable[Monitor]) -> list[str]:
    """Return unique names of monitors; equal names are numbered."""
    seen: Counter[str] = Counter()
    found = []
    for monitor in monitors:
        name = name_of(monitor)
        seen[name] += 1
        found.append(name if seen[name] == 1 else f"{name} ({seen[name]})")
    return found


def name_of(monitor: Monitor) -> str:
    """Return a name that distinguishes a monitor from others of its kind."""
    topics = getattr(monitor, "topics", ())
    where = getattr(monitor, "field", None) or getattr(monitor, "when", None) or ", ".join(topics)
    return f"{type(monitor).__name__} {where}".strip()


def why_nothing_to_judge(monitor: Monitor, view: TrialView) -> str | None:
    """Return why a trial has nothing for a monitor, None if it has something."""
    if _tells_unseen(type(monitor)):
        return cast("TellsUnseen", monitor).unseen(view)
    topics: Sequence[str] = getattr(monitor, "topics", ())
    reasons = [why_no_message(view, topic) for topic in topics]
    return next((reason for reason in reasons if reason), None) if all(reasons) else None


@cache
def _tells_unseen(kind: type[Monitor]) -> bool:
    """Return whether monitors of a class are `TellsUnseen`; to ask each one in each trial is slow."""
    return issubclass(kind, TellsUnseen)


def why_no_message(view: TrialView, topic: str) -> str | None:
    """Return a text that no output has a topic, with the most similar topics; None if one has."""
    keys = {message.key for message in view.outputs if message.kind == "put"}
    if any(view.registry.matches(topic, key) for key in keys):
        return None
    hint = did_you_mean(topic, map(view.registry.topic, keys))
    return f"no message of {topic!r} came" + (f"; {hint}" if hint else "")
