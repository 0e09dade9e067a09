"""What a monitor sees of one finished trial."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

from riot_bus.vocabulary.errors import PayloadError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Violation

__all__ = [
    "NO_SIGNS",
    "ComponentView",
    "Invariant",
    "Judgement",
    "Monitor",
    "ResourceSample",
    "Signs",
    "TrialView",
    "judge",
]


@dataclass(frozen=True, slots=True)
class ResourceSample:
    """What a component had of the machine at one moment, all its processes together.

    Attributes:
        time: Nanoseconds since the epoch.
        messages: So many inputs had been published by then.
        memory: Resident bytes.
        files: Open file descriptors.
        threads: Threads.
    """

    time: int
    messages: int
    memory: int
    files: int
    threads: int


@dataclass(frozen=True, slots=True)
class Signs:
    """What a component's state after a trial differs in from that after nominal trials; nothing where none is known.

    Attributes:
        ended: Why it has ended, or has ended inside though its process goes on; empty if it has not, or may.
        silent: Outputs that nominal trials have, and that no nominal input brings back.
        blocked: Functions in which threads stand that stand elsewhere at rest.
        lost: Functions in which threads began that are no longer there.
        grown: What it has much more of than after nominal trials: `memory`, `files`, `threads`, with how much as text.
        stacks: Stacks of all threads, as text.
    """

    ended: str = ""
    silent: Sequence[str] = ()
    blocked: Sequence[str] = ()
    lost: Sequence[str] = ()
    grown: Mapping[str, str] = field(default_factory=dict)
    stacks: str = ""


NO_SIGNS = Signs()


@dataclass(frozen=True, slots=True)
class ComponentView:
    """One component at the end of a trial.

    Attributes:
        status: Exit status, negative for a signal, None if it still ran.
        errors: What it wrote to stderr.
        root: Folder of its code; frames outside it are somebody else's.
        tracebacks: Whether a traceback in stderr of a live process counts as a crash.
        printed: What it wrote to stdout.
        resources: What it had of the machine, over time.
        signs: What its state differs in from that after nominal trials.
    """

    name: str
    status: int | None
    errors: str
    root: Path
    tracebacks: bool = True
    printed: str = ""
    resources: Sequence[ResourceSample] = ()
    signs: Signs = NO_SIGNS


@dataclass(frozen=True, slots=True)
class TrialView:
    """A finished trial.

    Attributes:
        settled: False when components were still busy at the deadline.
        waited: That deadline, seconds.
        outputs: Messages of the watched outputs, in order of reception.
        inputs: Messages that were published to the components, each with the time at which it was.
        end: When watching ended, nanoseconds since the epoch.
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


class Monitor(Protocol):
    """An oracle over one finished trial."""

    def judge(self, view: TrialView) -> Sequence[Violation]:
        """Return what was violated."""
        ...


class Invariant(Monitor, Protocol):
    """A monitor of `[[monitors]]` in riot.toml; it can also judge while things go on."""

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics whose messages it looks at."""
        ...


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the monitors say of a trial.

    Attributes:
        violations: In the order of the monitors.
        broken: A line for each monitor that failed itself.
        seen: How many outputs each invariant had to judge, by its name.
    """

    violations: tuple[Violation, ...]
    broken: tuple[str, ...]
    seen: Mapping[str, int]


def judge(view: TrialView, monitors: Sequence[Monitor]) -> Judgement:
    """Ask all monitors; one that raises is isolated and reported."""
    violations: list[Violation] = []
    broken: list[str] = []
    seen: dict[str, int] = {}
    for monitor in monitors:
        try:
            topics = getattr(monitor, "topics", ())
            if topics:
                seen[_name(monitor)] = _judged(monitor, view, topics)
            violations.extend(monitor.judge(view))
        except Exception as error:
            broken.append(f"{_name(monitor)}: {type(error).__name__}: {error}")
    return Judgement(tuple(violations), tuple(broken), seen)


def _name(monitor: Monitor) -> str:
    """Return what tells a monitor from others of its kind."""
    topics = getattr(monitor, "topics", ())
    where = getattr(monitor, "field", None) or ", ".join(topics)
    return f"{type(monitor).__name__} {where}".strip()


def _judged(monitor: Monitor, view: TrialView, topics: Sequence[str]) -> int:
    """Return how many outputs a monitor looked at: those of its topics that have its field, if it names one."""
    path = str(getattr(monitor, "field", "")).partition(":")[2]
    count = 0
    for message in view.outputs:
        if message.kind == "put" and any(view.registry.matches(topic, message.key) for topic in topics):
            count += not path or _has(view.registry, message, path)
    return count


def _has(registry: TypeRegistry, message: Message, path: str) -> bool:
    kind = registry.type_of(message.key, payload=message.payload, encoding=message.encoding)
    try:
        return kind is not None and kind.read(message.payload, path) is not None
    except PayloadError:
        return False
