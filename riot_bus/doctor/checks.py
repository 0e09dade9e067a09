"""`riot doctor`: checks beforehand, without a running bus, for problems of this host that would spoil a run."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from riot_bus.doctor.host import (
    PortState,
    Runtime,
    SharedMemory,
    open_files,
    port,
    python,
    runtime,
    shared_memory,
    versions,
)
from riot_bus.vocabulary.redaction import redacted
from riot_bus.zenoh.scouting import THIS_HOST, Answer, Scouting, scout

Status = Literal["ok", "warning", "problem"]

_LEAST_PYTHON = (3, 11)  # requires-python in pyproject.toml
_LEAST_ZENOH = (1, 10)  # lower bound of eclipse-zenoh in pyproject.toml
_KNOWN_ZENOH = (1, 10)  # version that docs/limits.md is about; newer ones were not measured
_LEAST_FILES = 1024  # the usual soft limit on Linux, so less was set on purpose
_LEAST_SHARED = 64 << 20  # all that a Docker container has by default, so any use of that gives the warning
_MOST_LEFT_OVER = 1000  # a guess: more than sessions that run at once, each of which has a file

_PORTS = {
    "free": ("free", ""),
    "taken": ("in use", "stop what listens there, or choose another endpoint"),
    "elsewhere": ("this host has no such address", "listen on 127.0.0.1 or an own address"),
    "denied": ("this user may not listen there", "choose a port above 1023"),
    "other": ("not looked at: not TCP", ""),
}
"""What is said about the states of ports, and what to do."""


@dataclass(frozen=True, slots=True)
class Check:
    """Result of one check.

    Attributes:
        name: Subject of the check, such as `open files`.
        status: Whether it is all right.
        cure: Advice; empty if it is all right.
    """

    name: str
    status: Status
    text: str
    cure: str = ""


@dataclass(frozen=True, slots=True)
class Facts:
    """Observations on this host.

    Attributes:
        versions: Installed versions of required packages; None for those that are missing.
        runtime: The bus's assessment of `ZENOH_RUNTIME`.
        ports: State of each endpoint to listen on.
        answers: Answers to multicast scouting; None if it could not be asked.
        memory: The shared memory file system; None if there is none.
        files: Maximum number of open files in a process; None if unlimited.
        processors: Number of processors that this process may use.
    """

    python: tuple[int, int] = _LEAST_PYTHON
    versions: Mapping[str, str | None] = field(default_factory=dict)
    runtime: Runtime = field(default_factory=Runtime)
    ports: Sequence[PortState] = ()
    answers: Mapping[str, Answer] | None = field(default_factory=dict)
    memory: SharedMemory | None = None
    files: int | None = None
    processors: int = 2


def check(*, endpoints: Sequence[str] = (), scouting: Scouting | None = THIS_HOST) -> list[Check]:
    """Check this host.

    Args:
        endpoints: Endpoints that a router is going to listen on, such as `tcp/127.0.0.1:7447`.
        scouting: Parameters of the question who answers multicast scouting; None to not ask.
    """
    return judge(gather(endpoints=endpoints, scouting=scouting))


def gather(*, endpoints: Sequence[str], scouting: Scouting | None) -> Facts:
    """Collect the facts about this host; arguments as for `check`."""
    threads = runtime()  # before the first use of Zenoh, which scouting is
    found, processors = python()
    try:
        answers = scout(scouting) if scouting is not None else {}
    except Exception:
        answers = None
    return Facts(
        python=found,
        versions=versions(),
        runtime=threads,
        ports=[port(each) for each in endpoints],
        answers=answers,
        memory=shared_memory(),
        files=open_files(),
        processors=processors,
    )


def judge(facts: Facts) -> list[Check]:
    """Return the checks that follow from the facts, in a fixed order; pure."""
    single: list[Callable[[Facts], Check]] = [_versions, _runtime, _scouting, _memory, _files, _processors]
    return [*(each(facts) for each in single), *(_port(each) for each in facts.ports)]


def _versions(facts: Facts) -> Check:
    name = "versions"
    text = ", ".join([f"python {_dotted(facts.python)}", *(f"{k} {v or 'missing'}" for k, v in facts.versions.items())])
    missing = sorted(package for package, version in facts.versions.items() if version is None)
    zenoh = _numbers(facts.versions.get("eclipse-zenoh"))
    if facts.python < _LEAST_PYTHON:
        return Check(name, "problem", text, f"use Python {_dotted(_LEAST_PYTHON)} or newer")
    if missing:
        return Check(name, "problem", text, f"pip install {' '.join(missing)}")
    if zenoh and zenoh < _LEAST_ZENOH:
        return Check(name, "problem", text, f"pip install 'eclipse-zenoh>={_dotted(_LEAST_ZENOH)},<2'")
    if zenoh[:2] > _KNOWN_ZENOH:
        return Check(
            name, "warning", text, f"riot was measured with Zenoh {_dotted(_KNOWN_ZENOH)}; run its tests first"
        )
    return Check(name, "ok", text)


def _runtime(facts: Facts) -> Check:
    return Check("ZENOH_RUNTIME", facts.runtime.status, facts.runtime.text, facts.runtime.cure)


def _scouting(facts: Facts) -> Check:
    name = "multicast scouting"
    if facts.answers is None:
        return Check(name, "warning", "could not be asked on this host", "choose another interface")
    reachable = [each for each in facts.answers.values() if each.locators]
    if not reachable:
        return Check(name, "ok", "no session answers")
    who = "; ".join(f"{each.mode} {each.zid} at {', '.join(each.locators)}" for each in reachable)
    return Check(
        name,
        "warning",
        f"Zenoh sessions answer: {who}",
        "components that scout will connect to them around every router: set scouting/multicast/enabled to false in "
        "components (ROS 2: ZENOH_CONFIG_OVERRIDE='scouting/multicast/enabled=false'), or stop those sessions",
    )


def _memory(facts: Facts) -> Check:
    name, memory = "shared memory", facts.memory
    if memory is None:
        return Check(name, "ok", "none on this system; Zenoh goes without")
    text = f"{memory.free >> 20} of {memory.total >> 20} MiB free in {memory.path}"
    if memory.free < _LEAST_SHARED:
        cure = "give the container more (docker run --shm-size=1g), or set transport/shared_memory/enabled to false"
        return Check(name, "warning", text, cure)
    if memory.left_over > _MOST_LEFT_OVER:
        text += f", {memory.left_over} files of Zenoh sessions, most of which ended long ago"
        return Check(name, "warning", text, f"delete {memory.path}/*.zenoh while no Zenoh session runs")
    return Check(name, "ok", text)


def _files(facts: Facts) -> Check:
    name = "open files"
    if facts.files is None or facts.files >= _LEAST_FILES:
        return Check(name, "ok", f"up to {facts.files or 'any number'} in each process")
    return Check(name, "warning", f"only {facts.files} in each process", "ulimit -n 4096")


def _processors(facts: Facts) -> Check:
    name, text = "processors", str(facts.processors)
    if facts.processors >= 2:
        return Check(name, "ok", text)
    return Check(name, "warning", text, "give riot and the components at least two: one alone distorts all timing")


def _port(found: PortState) -> Check:
    text, cure = _PORTS[found.state]
    owner = f" by {found.owner}" if found.owner else ""
    return Check(f"port {redacted(found.endpoint)}", "problem" if cure else "ok", text + owner, cure)


def _numbers(version: str | None) -> tuple[int, ...]:
    return tuple(int(each) for each in (version or "").split(".") if each.isdigit())


def _dotted(version: Collection[int]) -> str:
    return ".".join(map(str, version))
