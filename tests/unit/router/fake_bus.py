"""A segment without Zenoh: its session, channel and publishers, and samples as they come from it."""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.pipeline.runner import Pipeline
from riot_bus.router.delivery_queue import DeliveryQueue
from riot_bus.router.pipeline_executor import PipelineExecutor
from riot_bus.router.surroundings import BusAccess, Surroundings
from riot_bus.types.registry import TypeRegistry
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh import libraries
from riot_bus.zenoh.convert import Converter

WAIT_S = 20.0


class ClosedError(Exception):
    """As Zenoh's error of a closed channel."""


class Bytes(bytes):
    """A payload."""

    def to_bytes(self) -> bytes:
        return bytes(self)

    def as_shm(self) -> None:
        return None


class Channel:
    """A channel that is closed by `undeclare`, once it is empty."""

    def __init__(self, samples: Sequence[Any] = ()) -> None:
        self.queue: queue.SimpleQueue[Any] = queue.SimpleQueue()
        for each in samples:
            self.queue.put(each)

    @property
    def handler(self) -> Channel:
        return self

    def try_recv(self) -> Any:
        try:
            found = self.queue.get_nowait()
        except queue.Empty:
            return None
        if found is None:
            self.queue.put(None)
            raise ClosedError
        return found

    def recv(self) -> Any:
        found = self.queue.get(timeout=WAIT_S)
        if found is None:
            self.queue.put(None)
            raise ClosedError
        return found

    def undeclare(self) -> None:
        self.queue.put(None)


class Session:
    """A session whose subscribers get `samples` and what is put into `channel`."""

    def __init__(self, samples: Sequence[Any] = ()) -> None:
        self.channel = Channel(samples)
        self.watched: list[str] = []

    def declare_subscriber(self, expression: str, handler: Any, **options: Any) -> Channel:
        return self.channel


LIBRARY = SimpleNamespace(
    ZError=ClosedError,
    handlers=SimpleNamespace(FifoChannel=lambda size: size, Callback=lambda call, indirect: call),
    Locality=SimpleNamespace(REMOTE="remote", ANY="any"),
)


class Publisher:
    """A publisher that keeps what is put."""

    def __init__(self, puts: list[Any], qos: Qos) -> None:
        self.puts, self.qos = puts, qos

    def put(self, payload: bytes, *, encoding: Any = None, attachment: bytes | None = None) -> None:
        if payload == b"refused":
            raise ClosedError("refused")
        self.puts.append((bytes(payload), self.qos.express, encoding, attachment))

    def delete(self, *, attachment: bytes | None = None) -> None:
        self.puts.append(("delete", self.qos.express, None, attachment))


class Outlet:
    """What is published in a segment."""

    def __init__(self) -> None:
        self.puts: list[Any] = []
        self.messages: list[Message] = []
        self.declared: list[tuple[str, Qos]] = []
        self.longest = 0.0

    def occasional(self, key: str, qos: Qos, text: str) -> Publisher:
        return Publisher(self.puts, qos)

    def publisher(self, key: str, qos: Qos, text: Any = None) -> Publisher:
        self.declared.append((key, qos))
        return Publisher(self.puts, qos)

    def publish(self, message: Message) -> None:
        if message.payload == b"refused":
            raise ClosedError("refused")
        self.messages.append(message)

    def encoding(self, text: str) -> str:
        return text

    def took(self, seconds: float) -> None:
        self.longest = max(self.longest, seconds)

    def close(self) -> None:
        pass

    @property
    def payloads(self) -> list[bytes]:
        return [each[0] for each in self.puts]


class Claims:
    """Everything below `cut/` belongs to `cut/**`."""

    expressions = ("cut/**",)

    def owner(self, key: str) -> str | None:
        return "cut/**" if key.startswith("cut/") else None


class Act:
    """An interceptor that calls a function."""

    def __init__(self, action: Callable[[Any], object]) -> None:
        self.message = action


class Recorder:
    """Keeps what it gets."""

    def __init__(self) -> None:
        self.rows: list[Any] = []

    def original(self, message: Message, changes: Any) -> None:
        self.rows.append(("original", message.payload, message.time))

    def delivered(self, message: Message, changes: Any = ()) -> None:
        self.rows.append(("delivered", message.payload, message.time))


def sample(
    payload: bytes = b"x",
    key: str = "cut/a",
    *,
    priority: int = 5,
    congestion: int = 1,
    express: bool = False,
    encoding: str = "",
    attachment: bytes | None = None,
    kind: int = 0,
    sender: str | None = None,
) -> Any:
    stamp = None if sender is None else SimpleNamespace(get_id=lambda: sender)
    return SimpleNamespace(
        key_expr=key,
        payload=Bytes(payload),
        priority=priority,
        congestion_control=congestion,
        express=express,
        encoding=encoding,
        attachment=None if attachment is None else Bytes(attachment),
        kind=kind,
        timestamp=stamp,
        source_info=None,
    )


def message(payload: bytes = b"x", key: str = "cut/a", **more: Any) -> Message:
    return Message(more.pop("time", 1_000), key, payload, segment="system", **more)


class FakeBus:
    """Two segments, `system` and `unit`, with a pipeline between them."""

    def __init__(self, *actions: Callable[[Any], object], samples: Sequence[Any] = (), budget_s: float = 60.0) -> None:
        self.inner: dict[str, tuple[Any, ...]] = {}  # bridges in this process, by segment
        registry = TypeRegistry(())
        self.pipeline = Pipeline([Act(each) for each in actions], registry=registry, provenance=False)
        self.executor = PipelineExecutor(self.pipeline, budget_s=budget_s)
        self.executor.change(Pipeline.start)
        self.session, self.outlet = Session(samples), Outlet()
        self.access = BusAccess(("system", "unit"))
        self.access.sessions.update(system=self.session, unit=Session())  # type: ignore[arg-type]
        self.access.outlets.update(system=Outlet(), unit=self.outlet)  # type: ignore[arg-type]
        self.access.converters["system"] = Converter("system", self.access.sequence)
        surroundings = Surroundings(Claims())  # type: ignore[arg-type]
        self.deliveries = DeliveryQueue(self.executor, self.access, surroundings, topic=lambda key: f"/{key}")

    def close(self) -> None:
        self.executor.close()
        self.deliveries.close()


@pytest.fixture
def without_zenoh(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let fake sessions be those of a fake library."""
    monkeypatch.setitem(libraries._by_type, Session, LIBRARY)


def eventually(condition: Callable[[], bool]) -> bool:
    """Wait until a condition holds."""
    end = time.monotonic() + WAIT_S
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.001)
    return True
