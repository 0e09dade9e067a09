"""The use of a router by one test: what it intercepts, injects, starts and captures, and whether it took effect."""

from __future__ import annotations

import inspect
import json
import warnings
from collections import Counter
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from riot_bus.inject.interceptor import Injector
from riot_bus.inject.plan import read_plan
from riot_bus.interceptors.catalogue import build
from riot_bus.interceptors.parsing import parse
from riot_bus.pipeline.conditions import Selective, When
from riot_bus.pipeline.stage import stages_of
from riot_bus.router.counts import TopicCounts
from riot_bus.router.interception import topics_of
from riot_bus.router.receivers import Receivers
from riot_bus.router.services.selection import split
from riot_bus.testing.capture import Capture
from riot_bus.vocabulary.counting import counted
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.injection import Injection
from riot_bus.vocabulary.message import Message

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from riot_bus.log.writer import LogWriter
    from riot_bus.testing.capture import Captured
    from riot_bus.testing.live_router import LiveRouter, RunningProcess

_DRAINED_S = 5.0
_SETTLED_S = 0.5
_NOTHING = "@nothing"
"""A key that no message has."""


@contextmanager
def router_test(
    router: LiveRouter,
    *,
    folder: Path,
    out: Path,
    seed: int = 0,
    log: LogWriter | None = None,
    types: Sequence[str] = (),
    definitions: Sequence[Path] = (),
) -> Iterator[RouterTest]:
    """Yield the `RouterTest` of a test, and remove all its effects afterwards.

    Paths of plans are relative to `folder`, and campaigns write into `out`. The log gets all messages, and is closed at
    the end. `types` (`TOPIC=TYPE`) and their `definitions` are those of topics in expected logs.
    """
    capture = Capture(router.registry, log)
    with router.capturing(capture), ExitStack() as stack:
        one = RouterTest(router, capture, stack, folder=folder, out=out, seed=seed)
        one.known_types = {"types": types, "definitions": definitions}
        yield one


class RouterTest:
    """The use of a router by one test: what is intercepted and injected, and the messages since the test began."""

    def __init__(
        self, router: LiveRouter, capture: Capture, stack: ExitStack, *, folder: Path, out: Path, seed: int
    ) -> None:
        self.record = capture
        """Messages that crossed the router: `wait_for(topic, count)`, `await arrived(topic, count)`."""
        self.seed = seed
        self.known_types: dict[str, Any] = {}
        """Types of expected logs: the arguments `types` and `definitions` of `difference_from`."""
        self._router, self._stack = router, stack
        self._folder, self._out = folder, out
        self._topics: list[str] = []
        self._interceptors: list[object] = []
        self._needed: list[tuple[str, Callable[[], str]]] = []
        self._started: list[tuple[str, RunningProcess]] = []
        self._receivers = stack.enter_context(Receivers(router.bus))
        self._sent: Counter[tuple[str, str]] = Counter()
        self._injections = 0
        self._before, self._flows = router.bus.counts(), router.bus.flows()
        self._lost = dict(router.bus.losses.reasons)

    def intercept(self, *topics: str, required: bool = True) -> None:
        """Let the test's interceptors see messages from now on.

        Args:
            topics: Topics or key expressions; `KEY/@request` for a service's calls.
            required: Whether the test fails if no message of a topic has a subscriber in another segment.

        Raises:
            ConfigError: One cannot be intercepted.
        """
        __tracebackhide__ = True
        self._apply(topics=[*self._topics, *topics])
        if required:
            self._need_each(topics)

    def inject(self, *plans: str | Path | Injection, required: bool = True) -> None:
        """Carry out injections from now on.

        Args:
            plans: Files of injection plans, relative to the test's own, or single injections.
            required: Whether the test fails if one is not applied to any message with a subscriber in another segment.

        Raises:
            ConfigError: A file is not a plan.
        """
        __tracebackhide__ = True
        found: list[Injection] = []
        for plan in plans:
            found += [plan] if isinstance(plan, Injection) else read_plan(self._folder / plan)
        injector = Injector(found, seed=self.seed)
        self._apply(interceptors=[*self._interceptors, injector])
        for number, each in enumerate(found) if required else ():
            field = f":{each.field}" if each.field else ""
            self._need(
                f"injection {self._injections + number} ({each.fault} of {each.topic}{field})",
                _carried_out(injector, number),
            )
        if required:
            self._need_each({each.topic for each in found})
        self._injections += len(found)

    def interceptor(self, given: Any, topics: Sequence[str] | None = None, *, required: bool = True) -> Any:
        """Let an interceptor see messages from now on; usable as a decorator.

        Args:
            given: Function of an event, interceptor, or text such as `drop every=5 select=/odom`.
            topics: Topics that it sees; None for its own topics, or those named to `intercept`.
            required: Whether the test fails if it is never called.

        Returns:
            The argument `given`.

        Raises:
            ConfigError: It is not an interceptor.
        """
        __tracebackhide__ = True
        made = self._interceptor(given)
        if topics is not None:
            made = Selective(made, When(select=tuple(topics), seed=self.seed))
        self._apply(interceptors=[*self._interceptors, made])
        if required:
            (stage,) = stages_of([made])
            self._need(f"interceptor {stage.name}", lambda: self._asked(made))
        return given

    def start(self, command: Sequence[str], **options: Any) -> RunningProcess:
        """Start a process that runs as long as the test; the test fails if the process exits by itself with an error.

        Args:
            command: Program and arguments; the working folder is that of the test's file.
            options: Options of `LiveRouter.start`.
        """
        __tracebackhide__ = True
        one = self._stack.enter_context(self._router.start(command, **{"cwd": self._folder, **options}))
        self._started.append((" ".join(map(str, command)), one))
        return one

    def put(self, topic: str, payload: bytes | Mapping[str, Any], *, segment: str | None = None, **more: Any) -> None:
        """Publish a message as a component would.

        Args:
            topic: Topic name or key.
            payload: Bytes, or an object that is sent as JSON.
            segment: Segment in which to publish; by default the first one.
            more: Further attributes of the message.

        Raises:
            ConfigError: The topic is not a single key, or its messages are not JSON.
        """
        __tracebackhide__ = True
        registry, where = self._router.registry, segment or next(iter(self._router.segments))
        key = registry.key_expression(topic)
        if "*" in key:
            hint = "give its whole key, or publish with a node of your own"
            raise ConfigError(f"{topic!r} is not a single key: {key}", where="put", hint=hint)
        if isinstance(payload, bytes | bytearray | memoryview):
            data = bytes(payload)
        else:
            kind = registry.type_of(key)
            if kind is not None and kind.name != "json":
                raise ConfigError(f"messages of {topic} are {kind.name}, not JSON", where="put", hint="give bytes")
            data = json.dumps(payload).encode()
        self._router.bus.put(where, Message(0, key, data, **more))
        self._sent[key, where] += 1

    def wait_subscribed(self, *topics: str, segment: str | None = None, timeout: float = 10.0) -> None:
        """Wait until components of a segment, the last one by default, have subscribed to topics.

        Raises:
            AssertionError: They have not in time.
        """
        __tracebackhide__ = True
        self._router.wait_subscribed(*topics, segment=segment or self._router.inner.name, timeout=timeout)

    def sent(self, selector: str, *, since: int = 0) -> list[Captured]:
        """Return what components have sent so far; see `Capture.sent`."""
        self._router.bus.drain(_SETTLED_S)
        return self.record.sent(selector, since=since)

    def delivered(self, selector: str, *, since: int = 0) -> list[Captured]:
        """Return the messages delivered so far; see `Capture.delivered`."""
        self._router.bus.drain(_SETTLED_S)
        return self.record.delivered(selector, since=since)

    def counts(self) -> dict[str, TopicCounts]:
        """Return the message counts since the test began, by topic."""
        now = {topic: _less(now, self._before.get(topic)) for topic, now in self._router.bus.counts().items()}
        return {topic: each for topic, each in now.items() if each != TopicCounts()}

    def explore(self, system: str | Path, *, out: str | Path | None = None, **options: Any) -> Any:
        """Test a unit of a riot.toml with exceptional values; see `riot_bus.testing.exploration.explore`.

        Args:
            system: Path of riot.toml; paths are relative to the folder of the test's file.
            out: Output folder; by default a folder of this test beside its log.
            options: Further arguments of `explore`.

        Returns:
            The record of the campaign.
        """
        __tracebackhide__ = True
        from riot_bus.testing.exploration import explore

        folder = self._out if out is None else self._folder / out
        return explore(self._folder / system, folder, **{"seed": self.seed, **options})

    def expect(self, log: str | Path, **options: Any) -> None:
        """Fail unless the delivered messages match those of a log, as `riot diff` compares them.

        Args:
            log: The log; paths are relative to the folder of the test's file.
            options: `topics`, `exclude`, `tolerances`, `timing`, `order`, `timeout`; see
                `riot_bus_logtools.comparison.expected_log.difference_from`.

        Raises:
            AssertionError: They differ; the text says where.
            ConfigError: The log or a tolerance cannot be used, or nothing can be compared.
        """
        __tracebackhide__ = True
        from riot_bus.plugins import hook

        given = options.pop("tolerances", ())
        several = [given] if isinstance(given, str | Path) else given
        tolerances = [each if "=" in str(each) else self._folder / each for each in several]
        self._router.bus.drain(_SETTLED_S)
        found = hook("difference_from", "riot_bus_logtools")(
            self._folder / log,
            self.record,
            self._router.registry,
            tolerances=tolerances,
            **{**self.known_types, **options},
        )
        assert found.same, "\n".join(found.lines())

    def unshown(self) -> list[str]:
        """Return reasons why the test does not show what it seems to, as far as is known while messages may still come.

        A required interception or injection was not applied, or its messages had no subscriber in another segment; an
        interceptor raised; a message was lost; a process started by the test ended with an error.
        """
        bus = self._router.bus
        found = [f"{what} {why}" for what, told in self._needed if (why := told())]
        for name, errors in bus.executor.pipeline.errors.items():
            found.append(f"interceptor {name} raised in {counted(errors.count, 'message')}, first: {errors.first}")
        for reason, number in bus.losses.reasons.items():
            if (lost := number - self._lost.get(reason, 0)) > 0:
                found.append(f"{counted(lost, 'message')} lost: {reason}")
        found += [f"{told} has ended with status {one.status}" for told, one in self._started if one.status]
        return found

    def problems(self) -> list[str]:
        """End interception and wait until all messages have passed; return `unshown` and errors in the counts."""
        bus = self._router.bus
        told = self.unshown()  # first, since processes that the test has started may end later
        self._router.pass_all()
        through, counts = bus.drain(_DRAINED_S), self.counts()
        if not through and not any(each.held for each in counts.values()):
            late = f"messages are still on their way {_DRAINED_S:g} s after the test"
            warnings.warn(f"riot: counts are not checked, since {late}", stacklevel=2)
        for topic, each in counts.items():
            came, went = each.received + each.added, each.forwarded + each.dropped + each.lost + each.held
            if through and came != went:
                told.append(f"counts of {topic} do not balance: {came} came, {went} are accounted for: {each}")
            if each.held > 0:
                told.append(f"{counted(each.held, 'message')} of {topic} still delayed, and given up now")
            if each.unrecorded:
                told.append(f"{counted(each.unrecorded, 'message')} of {topic} not recorded")
        return told

    def _interceptor(self, given: Any) -> object:
        if isinstance(given, str):
            use, options = parse(given)
            seed = {"seed": self.seed} if self.seed else {}
            return build(use, {**seed, **options}, where="riot.interceptor", root=self._folder)
        if hasattr(given, "message") and not inspect.isclass(given):
            return given
        if inspect.isclass(given) or inspect.iscoroutinefunction(given) or not callable(given):
            hint = "give a function of an event, an object with message(event), or text such as 'drop every=5'"
            raise ConfigError(f"{given!r} is not an interceptor", where="riot.interceptor", hint=hint)
        name = getattr(given, "__name__", type(given).__name__)
        return SimpleNamespace(name=name, message=given)

    def _apply(self, *, topics: Sequence[str] | None = None, interceptors: Sequence[object] | None = None) -> None:
        """Use these topics and interceptors from now on; change nothing if they are rejected."""
        topics = self._topics if topics is None else topics
        interceptors = self._interceptors if interceptors is None else interceptors
        bus, registry = self._router.bus, self._router.registry
        names, services = split(topics)
        for topic in names:
            When(select=topic)
        everything = When(select=tuple(names) or _NOTHING, seed=self.seed)
        bus.set_interceptors(
            [each if topics_of(each) is not None else Selective(each, everything) for each in interceptors]
        )
        wanted = [registry.key_expression(service) for service in services]
        if wanted != bus.services:
            bus.set_intercept(bus.intercepted, services=wanted)
        self._topics, self._interceptors = list(topics), list(interceptors)

    def _need(self, what: str, told: Callable[[], str]) -> None:
        self._needed.append((what, told))

    def _need_each(self, topics: Iterable[str]) -> None:
        for topic in topics:
            self._receivers.watch(self._router.registry.key_expression(topic))
            self._need(f"messages of {topic}:", partial(self._missed, topic))

    def _sources(self, topic: str) -> set[str]:
        """Return the segments from which messages of a topic have come since the test began."""
        flows = {place: number - self._flows.get(place, 0) for place, number in self._router.bus.flows().items()}
        registry = self._router.registry
        came = [place for places in (flows, self._sent) for place, number in places.items() if number > 0]
        return {segment for key, segment in came if registry.matches(topic, key)}

    def _missed(self, topic: str) -> str:
        """Return why intercepting messages of a topic has no effect; empty if it has one."""
        sources = self._sources(topic)
        if not sources:
            return "none was intercepted"
        heard = self._receivers.heard(self._router.registry.key_expression(topic))
        if any(segment != source for segment in heard for source in sources):
            return ""
        where = f"subscribers are in {', '.join(sorted(heard))}" if heard else "no component has subscribed to them"
        return (
            f"they came from segment {', '.join(sorted(sources))}, and {where}; between processes of one segment "
            "riot sees nothing"
        )

    def _asked(self, made: object) -> str:
        topics = topics_of(made)
        if topics is None:
            topics = self._topics
            if not topics:
                return "saw nothing: name the topics that it is to see, by `intercept` or `topics`"
        return "" if any(self._sources(topic) for topic in topics) else f"saw nothing: none of {', '.join(topics)} came"


def _carried_out(injector: Injector, number: int) -> Callable[[], str]:
    def told() -> str:
        if injector.hits[number]:
            return ""
        problems = (
            injector.problems.values() if len(injector.injections) == 1 else ()
        )  # with several injections, it is unknown which one caused a problem
        return "was not carried out" + "".join(f": {problem.message}" for problem in problems)

    return told


def _less(now: TopicCounts, before: TopicCounts | None) -> TopicCounts:
    if before is None:
        return now
    names = TopicCounts.__dataclass_fields__
    return TopicCounts(**{name: getattr(now, name) - getattr(before, name) for name in names})
