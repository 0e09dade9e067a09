"""A router for tests that runs in their own process, on free ports, and what each test does with it."""

from __future__ import annotations

import json
import tempfile
import time
from collections import Counter
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from riot_bus.control.segment_environment import export, segment_variables, write_session_files
from riot_bus.inject.interceptor import Injector
from riot_bus.inject.plan import read_plan
from riot_bus.interceptors.parsing import from_text
from riot_bus.pipeline.runner import Pipeline
from riot_bus.router.bus import Bus
from riot_bus.router.counts import TopicCounts
from riot_bus.router.interception import Interception, topics_of
from riot_bus.router.recorder import Recorder
from riot_bus.testing.capture import Capture
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import intersects, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from riot_bus.log.writer import LogWriter
    from riot_bus.pipeline.event import Event
    from riot_bus.testing.capture import Captured
    from riot_bus.types.registry import TypeRegistry

__all__ = ["LiveRouter", "LiveSegment", "RouterTest"]

_DRAINED_S = 5.0
_SETTLED_S = 0.5
_OBSERVED_S = 3.0


class LiveSegment:
    """How a component gets into a segment.

    Attributes:
        name: Of the segment.
        endpoint: Where components connect, such as `tcp/127.0.0.1:41234`.
        variables: Environment by which a process uses it: programs that call `zenoh.Config.from_env`, ROS 2 nodes with
            rmw_zenoh, and `riot`.
    """

    def __init__(self, name: str, endpoint: str, exported: Mapping[str, str]) -> None:
        self.name = name
        self.endpoint = endpoint
        self.variables = {**exported, **segment_variables(name, exported)}
        self.variables.pop("RMW_IMPLEMENTATION", None)  # nodes of other middleware are tests' own matter

    @property
    def config_file(self) -> Path:
        """A Zenoh configuration, for `zenoh.Config.from_file`."""
        return Path(self.variables["ZENOH_CONFIG"])

    def open(self) -> Any:
        """Return a Zenoh session of a component there; close it."""
        return open_client(self.endpoint).session


class LiveRouter:
    """A router on free ports of loopback; a context manager.

    Args:
        segments: Their names; the first is where tests are unless they say otherwise.
        registry: Knows topic names and types.
    """

    def __init__(self, segments: Sequence[str], *, registry: TypeRegistry) -> None:
        self.registry = registry
        self.segments: dict[str, LiveSegment] = {}
        self.bus = Bus(dict.fromkeys(segments, ()), registry=registry)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
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
        """Return how to get into a segment; raises ConfigError if there is none of this name."""
        self.bus.segment(name)
        return self.segments[name]

    @contextmanager
    def test(self, *, folder: Path, out: Path, seed: int = 0, log: LogWriter | None = None) -> Iterator[RouterTest]:
        """Yield what a test works with; afterwards nothing is intercepted or recorded any more.

        Args:
            folder: Where relative paths of plans start from.
            out: Folder for what campaigns write.
            seed: Seed of everything random.
            log: Records all that passes; closed at the end.
        """
        bus, capture = self.bus, Capture(self.registry, log)
        recorder = Recorder(capture, topic=self.registry.topic)
        bus.gate.change(_begin_anew)
        bus.set_recorder(recorder)
        bus.wait_observed(_OBSERVED_S)
        try:
            yield RouterTest(self, recorder, capture, folder=folder, out=out, seed=seed)
        finally:
            bus.set_interceptors(())
            bus.set_intercept((), services=())
            bus.set_recorder(None)
            recorder.close()
            capture.forget()


def _begin_anew(pipeline: Pipeline) -> None:
    pipeline.restart()
    pipeline.errors.clear()


class RouterTest:
    """One test's use of a router: what is intercepted and injected, what was sent and delivered since it began.

    Args:
        router: The router.
        recorder: Records what crosses, by means of
        capture: what keeps it.
        folder: Where relative paths start from.
        out: Folder for what campaigns write.
        seed: Seed of everything random.
    """

    def __init__(
        self, router: LiveRouter, recorder: Recorder, capture: Capture, *, folder: Path, out: Path, seed: int
    ) -> None:
        self.record = capture
        """What has crossed: `wait_for(topic, count)`, `await arrived(topic, count)`."""
        self.seed = seed
        self._router, self._recorder = router, recorder
        self._folder, self._out = folder, out
        self._put: Counter[str] = Counter()
        self._keys: list[str] = []
        self._interceptors: list[object] = []
        self._needed: dict[str, Callable[[], bool]] = {}
        self._before = router.bus.counts()
        self._lost = dict(router.bus.losses.reasons)

    def intercept(self, *topics: str, required: bool = True) -> None:
        """Let messages go through the interceptors from now on, instead of past them.

        Args:
            topics: Topics or key expressions.
            required: Whether the test fails if no such message comes.

        Raises:
            ConfigError: One cannot be intercepted.
        """
        self._keys += topics
        if required:
            self._needed |= {f"no message of {topic} was intercepted": self._came(topic) for topic in topics}
        self._apply()

    def inject(self, *plans: str | Path | Injection, required: bool = True) -> None:
        """Carry out injections from now on; their topics are intercepted.

        Args:
            plans: Files of injection plans, relative to the test's own, or single injections.
            required: Whether the test fails if one of them changes no message.

        Raises:
            ConfigError: A file is no plan.
        """
        found: list[Injection] = []
        for plan in plans:
            found += [plan] if isinstance(plan, Injection) else read_plan(self._folder / plan)
        injector = Injector(found, seed=self.seed)
        if required:
            for number, each in enumerate(found):
                field = f":{each.field}" if each.field else ""
                text = f"injection {number} ({each.fault} of {each.topic}{field}) was not carried out"
                self._needed[text] = partial(_carried_out, injector, number)
        self._interceptors.append(injector)
        self._apply()

    def interceptor(self, given: object, topics: Sequence[str] | None = None) -> Any:
        """Let an interceptor see messages from now on; a decorator as well.

        Args:
            given: A function of an event, an interceptor, or text such as `drop every=5 select=/odom`.
            topics: Topics that are intercepted for it; None for its own, or what is intercepted anyway.

        Returns:
            What was given.

        Raises:
            ConfigError: It is no interceptor, or would see nothing.
        """
        made = from_text(given) if isinstance(given, str) else given
        if callable(made) and not hasattr(made, "message"):
            made = _Function(made)
        self._interceptors.append(made)
        self._keys += topics or ()
        self._apply()
        return given

    def put(self, topic: str, payload: bytes | Mapping[str, Any], *, segment: str | None = None, **more: Any) -> None:
        """Publish a message as a component would.

        Args:
            topic: Topic name or key.
            payload: Bytes, or an object that is sent as JSON.
            segment: Where; by default the first one.
            more: Further attributes of the message.
        """
        data = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
        key = self._router.registry.key_expression(topic)
        self._router.bus.put(segment or next(iter(self._router.segments)), Message(0, key, data, **more))
        self._put[key] += 1

    def wait_subscribed(self, *topics: str, segment: str, timeout: float = 10.0) -> None:
        """Wait until components of a segment have subscribed to topics.

        Meanwhile, of what components send, only intercepted messages are recorded: who records all would be taken for a
        subscriber.

        Raises:
            AssertionError: They have not in time.
        """
        bus = self._router.bus
        keys = [self._router.registry.key_expression(topic) for topic in topics]
        wait_until(self._all_put_is_recorded, _SETTLED_S)
        bus.set_recorder(self._recorder, record=())
        bus.wait_observed(_OBSERVED_S)
        deadline = time.monotonic() + timeout
        try:
            missing = bus.wait_subscribed(segment, keys, timeout=timeout)
            # What is not intercepted comes from other segments as soon as these have heard of it, too.
            native = [key for key in keys if not any(intersects(each, key) for each in bus.intercepted)]
            for other in self._router.segments if native and not missing else ():
                missing += bus.wait_subscribed(other, native, timeout=max(0.0, deadline - time.monotonic()))
        finally:
            bus.set_recorder(self._recorder)
            bus.wait_observed(_OBSERVED_S)
        assert not missing, f"nobody in segment {segment!r} has subscribed to {', '.join(missing)} in {timeout:g} s"

    def sent(self, selector: str) -> list[Captured]:
        """Return what components have sent so far; see `Capture.sent`."""
        self._router.bus.drain(_SETTLED_S)
        return self.record.sent(selector)

    def delivered(self, selector: str) -> list[Captured]:
        """Return what was delivered so far; see `Capture.delivered`."""
        self._router.bus.drain(_SETTLED_S)
        return self.record.delivered(selector)

    def counts(self) -> dict[str, TopicCounts]:
        """Return what has happened to intercepted and recorded messages since the test began, by topic."""
        return {topic: _less(now, self._before.get(topic)) for topic, now in self._router.bus.counts().items()}

    def explore(self, system: str | Path, *, out: str | Path | None = None, **options: Any) -> None:
        """Test a unit of a riot.toml with exceptional values; see `riot_bus.testing.exploration.explore`.

        Args:
            system: Path of riot.toml; paths are relative to the folder of the test's file.
            out: Folder for everything that is written; by default one of the test's own beside its log.
            options: Further arguments of `explore`.
        """
        from riot_bus.testing.exploration import explore

        folder = self._out if out is None else self._folder / out
        explore(self._folder / system, folder, **{"seed": self.seed, **options})

    def problems(self) -> list[str]:
        """Wait until all is through, then return why the test has not shown what it seems to.

        Nothing came of what was to be intercepted or injected, an interceptor raised, a message was lost on the way, or
        counts do not balance.
        """
        self._router.bus.drain(_DRAINED_S)
        found = [text for text, happened in self._needed.items() if not happened()]
        found += [f"interceptor {_name(each)} saw nothing: nothing is intercepted" for each in self._idle()]
        bus = self._router.bus
        for name, errors in bus.gate.pipeline.errors.items():
            found.append(f"interceptor {name} raised in {counted(errors.count, 'message')}, first: {errors.first}")
        for reason, number in bus.losses.reasons.items():
            if (lost := number - self._lost.get(reason, 0)) > 0:
                found.append(f"{counted(lost, 'message')} lost: {reason}")
        for topic, each in self.counts().items():
            came, went = each.received + each.added, each.forwarded + each.dropped + each.lost + each.held
            if came != went:
                found.append(f"counts of {topic} do not balance: {came} came, {went} are accounted for: {each}")
            if each.unrecorded:
                found.append(f"{counted(each.unrecorded, 'message')} of {topic} not recorded")
        return found

    def _all_put_is_recorded(self) -> bool:
        return all(len(self.record.sent(key)) >= number for key, number in self._put.items())

    def _came(self, wanted: str) -> Callable[[], bool]:
        registry = self._router.registry

        def came() -> bool:
            counts = self.counts().items()
            return any(each.received and registry.matches(wanted, registry.key_expression(on)) for on, each in counts)

        return came

    def _idle(self) -> list[object]:
        """Return the interceptors that would see nothing."""
        return [] if self._keys else [each for each in self._interceptors if topics_of(each) is None]

    def _apply(self) -> None:
        bus, registry = self._router.bus, self._router.registry
        idle = self._idle()
        seeing = [each for each in self._interceptors if each not in idle]
        wanted = Interception(lambda: bus, keys=self._keys, interceptors=seeing, plan=None, registry=registry)
        bus.set_interceptors(wanted.interceptors(None))
        if (wanted.expressions, wanted.services) != (bus.intercepted, bus.services):
            bus.set_intercept(wanted.expressions, services=wanted.services)
            bus.wait_observed(_OBSERVED_S)


class _Function:
    """A function as an interceptor."""

    def __init__(self, function: Callable[[Event], object]) -> None:
        self.name = getattr(function, "__name__", type(function).__name__)
        self._function = function

    def message(self, event: Event) -> None:
        """Call it."""
        self._function(event)


def _carried_out(injector: Injector, number: int) -> bool:
    return injector.hits[number] > 0


def _name(interceptor: object) -> str:
    return str(getattr(interceptor, "name", None) or type(interceptor).__name__)


def _less(now: TopicCounts, before: TopicCounts | None) -> TopicCounts:
    if before is None:
        return now
    names = TopicCounts.__dataclass_fields__
    return TopicCounts(**{name: getattr(now, name) - getattr(before, name) for name in names})
