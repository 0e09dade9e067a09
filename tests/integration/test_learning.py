"""A node whose type nobody else has a definition of is asked for it; its messages then have fields."""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh
from mcap.reader import make_reader

from riot_bus.bus.capture.options import CaptureOptions
from riot_bus.bus.capture.service import CaptureService
from riot_bus.bus.client import open_client
from riot_bus.bus.flags import RouterFlags, merged
from riot_bus.bus.runtime import wait_until
from riot_bus.bus.service import RouterService
from riot_bus.bus.settings import RouterSettings
from riot_bus.log.table import columns
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.attachment import Attachment, build_attachment, parse_attachment
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.keys import DataKey, build_data_key
from riot_bus_ros2.live import SERVICE
from riot_bus_ros2.store import TypeStore
from riot_bus_ros2.tokens import Endpoint, Node, build_token
from tests.integration.router_process import riot
from tests.integration.zenoh_process import ZenohProcess
from tests.type_descriptions import reply

pytestmark = pytest.mark.integration

NAME = "my_pkg/msg/Reading"
OWN = TypeStore(parse_msg("int32 number\nfloat64 value\n", NAME))
HASH = OWN.type_hash(NAME)
SERVICE_HASH = TypeStore().type_hash(SERVICE)
KEY = build_data_key(DataKey(0, "/reading", NAME, HASH))
FREE = ("system=tcp/127.0.0.1:0", "unit=tcp/127.0.0.1:0")
SET = '[[inject]]\ntopic = "/reading"\nfield = "value"\nvalue = -1.0\nwhere = "number > 0"\n'


def payload(number: int) -> bytes:
    return b"\0\1\0\0" + struct.pack("<i4xd", number, number / 2)


class Sensor:
    """A node as rmw_zenoh has it: it announces a topic and answers who asks for its type.

    Args:
        endpoint: Of a router.
        told: What it answers; nothing, not even an end, while there is none.
        announced: Whether it announces itself at once.
    """

    def __init__(self, endpoint: str, told: bytes | None, *, announced: bool = True) -> None:
        self.client = open_client(endpoint)
        self.told = told
        self.asked: list[dict[str, Any]] = []
        self.waiting: list[zenoh.Query] = []
        self.sent = 0
        node = Node(0, self.client.zid, 0, "/sensor")
        service = Endpoint(node, 1, "SS", "/sensor/get_type_description", SERVICE, SERVICE_HASH)
        self.tokens = [node, service, Endpoint(node, 2, "MP", "/reading", NAME, HASH)]
        session = self.client.session
        self.declared: list[Any] = [session.declare_queryable(service.key, self._answer, complete=True)]
        if announced:
            self.announce()

    def announce(self) -> None:
        liveliness = self.client.session.liveliness()
        self.declared += [liveliness.declare_token(build_token(each)) for each in self.tokens]

    def publish(self) -> int:
        self.sent += 1
        attachment = build_attachment(Attachment(self.sent, time.time_ns(), bytes(16)))
        self.client.session.put(KEY, payload(self.sent), attachment=attachment, congestion_control=BLOCK)
        return self.sent

    def _answer(self, query: zenoh.Query) -> None:
        assert query.payload is not None
        assert query.attachment is not None
        parse_attachment(query.attachment.to_bytes())  # rmw_zenoh answers no others
        request = Ros2Adapter().type_named(f"{SERVICE}_Request")
        assert request is not None
        self.asked.append({leaf.path: leaf.value for leaf in request.leaves(query.payload.to_bytes())})
        if self.told is None:
            self.waiting.append(query)
            return
        with query:
            query.reply(query.key_expr, self.told, attachment=query.attachment)


BLOCK = zenoh.CongestionControl.BLOCK


@contextlib.contextmanager
def sensor(endpoint: str, told: bytes | None = None, **more: Any) -> Iterator[Sensor]:
    found = Sensor(endpoint, told, **more)
    with found.client:
        yield found


def service(folder: Path, **flags: Any) -> RouterService:
    settings = merged(RouterSettings(), RouterFlags(segments=FREE, **flags))
    return RouterService(settings, registry=TypeRegistry(load_adapters(["ros2"])), folder=folder, scouting=None)


def schemas(path: Path) -> list[tuple[str, int, bool]]:
    """Name of the type, messages, and whether there is a definition, of each channel that has messages."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    found = []
    for number, count in summary.statistics.channel_message_counts.items():
        schema = summary.schemas[summary.channels[number].schema_id]
        if summary.channels[number].metadata["riot.role"] == "delivered":
            found.append((schema.name, count, bool(schema.data)))
    return found


def numbers(path: Path) -> list[int]:
    found: list[int] = columns(path, ["/reading:number"])["/reading:number"].values.tolist()
    return found


def test_messages_get_fields_while_they_pass(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with service(tmp_path, record=str(path)) as router:
        router.plan_load(SET, "set")
        ends = {name: found[0] for name, found in router.endpoints.items()}
        got: list[float] = []
        with sensor(ends["system"], None) as node, open_client(ends["unit"]) as unit:
            unit.subscribe(KEY, lambda message: got.append(struct.unpack_from("<d", message.payload, 12)[0]))

            def arrived() -> bool:
                node.publish()
                return bool(got)

            assert wait_until(arrived, 20, interval=0.02)
            assert -1.0 not in got
            router.watch()
            assert wait_until(lambda: bool(node.asked), 20, interval=0.01)
            assert -1.0 not in got
            node.told = reply(NAME, OWN)  # from the next question on; traffic goes on meanwhile

            def changed() -> bool:
                node.publish()
                return got[-1] == -1.0

            assert wait_until(changed, 20, interval=0.02)
            for _ in range(10):
                node.publish()
            assert wait_until(lambda: len(got) == node.sent, 20), (len(got), node.sent)
            assert node.asked[0] == {"type_name": NAME, "type_hash": HASH, "include_type_sources": False}
            assert len(node.asked) <= 4
            sent = node.sent
        assert not router.pipeline.errors
        assert not router.losses
    assert got[-10:] == [-1.0] * 10
    (before, after) = schemas(path)
    assert before[0] == after[0] == NAME
    assert (before[2], after[2]) == (False, True)
    assert before[1] + after[1] == sent
    assert numbers(path) == list(range(1, sent + 1))
    code, out, err = riot("types", str(path))
    assert (code, err) == (0, "")
    assert "value" in out


def test_what_is_recorded_has_its_definition_from_the_first_message_on(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    said: list[str] = []
    with ZenohProcess("router") as process, sensor(process.locators[0], reply(NAME, OWN)) as node:
        options = CaptureOptions(endpoint=process.locators[0], output=path, graph=False, control=False)
        with CaptureService(options, warn=said.append) as recorder:
            assert len(node.asked) == 1
            for _ in range(20):
                node.publish()
            assert wait_until(lambda: recorder.status()["messages"] == 20, 20)
    assert not said
    assert schemas(path) == [(NAME, 20, True)]


@pytest.mark.parametrize("ring", [0.0, 60.0])
def test_a_recording_goes_on_with_a_type_that_becomes_known(tmp_path: Path, ring: float) -> None:
    path = tmp_path / "run.mcap"
    said: list[str] = []
    with ZenohProcess("router") as process, sensor(process.locators[0], reply(NAME, OWN), announced=False) as node:
        options = CaptureOptions(
            endpoint=process.locators[0], output=path, graph=False, control=False, ring_seconds=ring
        )
        with CaptureService(options, warn=said.append) as recorder:
            for _ in range(5):
                node.publish()
            assert wait_until(lambda: recorder.status()["messages"] == 5, 20)
            node.announce()
            assert wait_until(lambda: recorder.registry.type_of(KEY) is not None, 20, interval=0.01)
            assert wait_until(lambda: any("has been told" in line for line in said), 20, interval=0.01)
            for _ in range(7):
                node.publish()
            assert wait_until(lambda: recorder.status()["messages"] == 12, 20)
            if ring:
                recorder.dump()
    file = path if not ring else next(tmp_path.glob("run*.mcap"))
    assert schemas(file) == [(NAME, 5, False), (NAME, 7, True)]
    assert numbers(file) == list(range(1, 13))


def test_nodes_that_tell_nonsense_or_nothing(tmp_path: Path) -> None:
    with service(tmp_path, intercept=["/reading"]) as router:
        ends = {name: found[0] for name, found in router.endpoints.items()}
        wrong = TypeStore(parse_msg("int32 number\n", NAME))
        with sensor(ends["system"], reply(NAME, wrong)) as liar, sensor(ends["unit"], b"\0" * (1 << 21)) as noisy:
            router.watch()
            assert wait_until(lambda: len(liar.asked) >= 2 and len(noisy.asked) >= 2, 20, interval=0.01)
            assert router._registry.type_of(KEY) is None


def test_a_node_that_never_answers_holds_up_nobody(tmp_path: Path) -> None:
    with service(tmp_path, intercept=["/reading"]) as router, contextlib.ExitStack() as stack:
        ends = {name: found[0] for name, found in router.endpoints.items()}
        node = stack.enter_context(sensor(ends["system"]))
        router.watch()
        assert wait_until(lambda: bool(node.asked), 20, interval=0.01)
        began = time.monotonic()
        router._recordings.close()  # while the question is open
        assert time.monotonic() - began < 1.5
