"""What a monitor sees of one finished trial."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from riot_bus.types.registry import TypeRegistry
    from riot_bus.vocabulary.message import Message
    from riot_bus.vocabulary.trial import Violation

__all__ = ["NO_SIGNS", "ComponentView", "Invariant", "Monitor", "ResourceSample", "Signs", "TrialView", "judge"]


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
        stacks: Stacks of all threads, as text.
    """

    ended: str = ""
    silent: Sequence[str] = ()
    blocked: Sequence[str] = ()
    lost: Sequence[str] = ()
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


def judge(view: TrialView, monitors: Sequence[Monitor]) -> tuple[tuple[Violation, ...], tuple[str, ...]]:
    """Ask all monitors; one that raises is isolated and reported.

    Returns:
        The violations in the order of the monitors, and one line per monitor that failed itself.
    """
    violations: list[Violation] = []
    broken: list[str] = []
    for monitor in monitors:
        try:
            violations.extend(monitor.judge(view))
        except Exception as error:
            broken.append(f"{type(monitor).__name__}: {type(error).__name__}: {error}")
    return tuple(violations), tuple(broken)
