"""A router for tests that runs in their own process, on free ports.

All topics are intercepted, whatever a test asks for: so routes never change while messages flow, all messages are
recorded, and recording needs no subscriber that could be mistaken for a component.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from riot_bus.control.segment_environment import export, segment_variables, write_session_files
from riot_bus.interceptors.recorder import Recorder
from riot_bus.pipeline.runner import Pipeline
from riot_bus.processes.launcher import ComponentProcess, Launcher
from riot_bus.router.bus import Bus
from riot_bus.testing.capture import Capture
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import environment_of_others

_EVERYTHING = ("**",)


class LiveSegment:
    """Access to a segment for components.

    Attributes:
        name: Name of the segment.
        endpoint: Endpoint to which components connect, such as `tcp/127.0.0.1:41234`.
        variables: Environment variables that connect a process to it: programs that call `zenoh.Config.from_env`,
            ROS 2 nodes with rmw_zenoh, and `riot`.
    """

    def __init__(self, name: str, endpoint: str, exported: Mapping[str, str]) -> None:
        self.name = name
        self.endpoint = endpoint
        self.variables = {**exported, **segment_variables(name, exported)}
        self.variables.pop("RMW_IMPLEMENTATION", None)  # tests may use nodes of other middleware

    @property
    def config_file(self) -> Path:
        """Path of a Zenoh configuration, for `zenoh.Config.from_file`."""
        return Path(self.variables["ZENOH_CONFIG"])

    @property
    def environment(self) -> dict[str, str]:
        """Complete environment of a process in the segment: that of the tests without riot's internal variables."""
        return {**environment_of_others(), **self.variables}

    def open(self) -> Any:
        """Return a Zenoh session of a component in the segment; the caller has to close it."""
        return open_client(self.endpoint).session


@dataclass(frozen=True, slots=True)
class RunningProcess:
    """A process that a test has started."""

    launcher: Launcher
    process: ComponentProcess

    @property
    def pid(self) -> int:
        """Process ID."""
        return self.process.pid

    @property
    def status(self) -> int | None:
        """Exit status, negative for a signal; None while it runs."""
        return None if self.launcher.alive(self.process) else self.process.status

    def wait(self, timeout: float = 10.0) -> int | None:
        """Wait up to `timeout` seconds until the process ends by itself; return its status, None if it still runs."""
        return self.process.status if self.launcher.wait([self.process], timeout=timeout) else None


class LiveRouter:
    """A router on free ports of loopback; a context manager.

    Args:
        segments: Names of at least two segments: one in which tests publish, and one for the components under test.
        registry: Registry of topic names and message types.

    Raises:
        ConfigError: Fewer than two segments.
    """

    def __init__(self, segments: Sequence[str], *, registry: TypeRegistry) -> None:
        if len(set(segments)) < 2:
            hint = "messages pass the router from one segment to another: name two or more"
            named = ", ".join(segments) or "none"
            raise ConfigError(f"fewer than two segments: {named}", where="riot_segments", hint=hint)
        self.registry = registry
        self.segments: dict[str, LiveSegment] = {}
        self._recorder = Recorder(Capture(registry), topic=registry.topic)
        self.bus = Bus(dict.fromkeys(segments, ()), intercept=_EVERYTHING, registry=registry, recorder=self._recorder)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            stack.callback(self._recorder.close)
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="riot-")))
            bus = stack.enter_context(self.bus)
            endpoints = {name: [bus.endpoint(name)] for name in bus.sessions}
            write_session_files(endpoints, folder)
            exported = export(endpoints, files=folder)
            self.segments = {name: LiveSegment(name, found[0], exported) for name, found in endpoints.items()}
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def segment(self, name: str) -> LiveSegment:
        """Return the segment of this name; raise ConfigError if there is none."""
        self.bus.segment(name)
        return self.segments[name]

    @property
    def inner(self) -> LiveSegment:
        """The last segment, which by default contains the components under test."""
        return list(self.segments.values())[-1]

    @contextmanager
    def start(
        self,
        command: Sequence[str],
        *,
        segment: str | None = None,
        subscribes: Sequence[str] = (),
        timeout: float = 30.0,
        cwd: Path | None = None,
        env: Mapping[str, str] | None = None,
    ) -> Iterator[RunningProcess]:
        """Start a process in a segment; at the end, kill it and everything that it has started.

        It is killed even if the process of the tests is killed. Its output goes to the output of the tests.

        Args:
            command: Program and arguments.
            segment: Segment of the process; the last one by default.
            subscribes: Topics to which it, or another component in the segment, has to subscribe before this returns.
            timeout: Longest time to wait for subscriptions, in seconds.
            cwd: Working folder of the process.
            env: Variables added to its environment.

        Raises:
            EnvironmentFaultError: The command cannot be executed.
            AssertionError: It ended before it subscribed, or did not subscribe in time.
        """
        __tracebackhide__ = True
        where = self.inner if segment is None else self.segment(segment)
        environment = {**where.environment, **(env or {})}
        with Launcher(quiet=False) as launcher:
            process = launcher.start(
                command[0], list(map(str, command)), env=environment, cwd=cwd or Path.cwd(), directory=None
            )
            one = RunningProcess(launcher, process)
            self.wait_subscribed(*subscribes, segment=where.name, timeout=timeout, alive=lambda: one.status is None)
            yield one

    def wait_subscribed(
        self, *topics: str, segment: str, timeout: float = 10.0, alive: Callable[[], bool] = lambda: True
    ) -> None:
        """Wait until components of a segment have subscribed to topics.

        Args:
            topics: Topics or key expressions.
            segment: Name of the segment.
            timeout: Longest time to wait, in seconds.
            alive: Function that tells whether waiting still makes sense.

        Raises:
            AssertionError: They did not subscribe in time.
        """
        __tracebackhide__ = True
        keys = [self.registry.key_expression(topic) for topic in topics]
        missing = self.bus.wait_subscribed(segment, keys, timeout=timeout, alive=alive)
        when = f"in {timeout:g} s" if alive() else "before the process ended"
        assert not missing, f"no component in segment {segment!r} has subscribed to {', '.join(missing)} {when}"

    @contextmanager
    def capturing(self, capture: Capture) -> Iterator[None]:
        """Capture all messages; at the end, remove all interceptors and discard the messages that they delayed."""
        self.bus.executor.change(_begin_anew)
        self._recorder.switch(capture)
        try:
            yield
        finally:
            self.pass_all()
            self.bus.give_up_delayed()
            self._recorder.switch(Capture(self.registry, most_bytes=0))
            capture.forget()

    def pass_all(self) -> None:
        """Remove all interceptors, so that all messages pass."""
        self.bus.set_interceptors(())
        if self.bus.services:
            self.bus.set_intercept(_EVERYTHING, services=())


def _begin_anew(pipeline: Pipeline) -> None:
    pipeline.restart()
    pipeline.errors.clear()
