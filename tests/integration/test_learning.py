"""A node whose type nobody else has a definition of is asked for it; its messages then have fields."""

from __future__ import annotations

import contextlib
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import pytest
import zenoh
import zenoh.ext
from mcap.reader import make_reader

from riot_bus.config.router_settings import RouterSettings
from riot_bus.control.router_flags import RouterOptions
from riot_bus.control.router_options import merged
from riot_bus.control.router_service import RouterService
from riot_bus.log.tables.table import columns
from riot_bus.record.options import CaptureOptions
from riot_bus.record.service import CaptureService
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.zenoh import type_learner as learner_module
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until
from riot_bus_ros2.adapter import Ros2Adapter
from riot_bus_ros2.attachment import Attachment, build_attachment, parse_attachment
from riot_bus_ros2.definitions import parse_msg
from riot_bus_ros2.gid import gid_of
from riot_bus_ros2.keys import DataKey, build_data_key
from riot_bus_ros2.live import SERVICE
from riot_bus_ros2.store import TypeStore
from riot_bus_ros2.tokens import Node, NodeEndpoint, build_token
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
        version: Of its attachments.
    """

    def __init__(
        self, endpoint: str, told: bytes | None, *, announced: bool = True, version: Literal[1, 2] = 2
    ) -> None:
        self.client = open_client(endpoint, config={"timestamping/enabled": True})  # as rmw_zenoh has it
        self.version = version
        self.told = told
        self.asked: list[dict[str, Any]] = []
        self.waiting: list[zenoh.Query] = []
        self.sent = 0
        node = Node(0, self.client.zid, 0, "/sensor")
        service = NodeEndpoint(node, 1, "SS", "/sensor/get_type_description", SERVICE, SERVICE_HASH)
        self.tokens: list[Node | NodeEndpoint] = [node, service, NodeEndpoint(node, 2, "MP", "/reading", NAME, HASH)]
        session = self.client.session
        self.declared: list[Any] = [session.declare_queryable(service.key, self._answer, complete=True)]
        self.publisher: Any = zenoh.ext.declare_advanced_publisher(
            session, KEY, congestion_control=BLOCK, cache=zenoh.ext.CacheConfig(max_samples=1)
        )
        self.plain = session.declare_publisher(KEY)  # an advanced one does not tell whether somebody subscribes
        if announced:
            self.announce()

    def heard(self) -> bool:
        """Return whether there is a subscriber; wait for it, since a message is lost before it is known."""
        return wait_until(lambda: self.plain.matching_status.matching, 60)

    def announce(self) -> None:
        liveliness = self.client.session.liveliness()
        self.declared += [liveliness.declare_token(build_token(each)) for each in self.tokens]

    def publish(self) -> int:
        self.sent += 1
        gid = gid_of(build_token(self.tokens[-1]))
        attachment = build_attachment(Attachment(self.sent, time.time_ns(), gid, self.version))
        self.publisher.put(payload(self.sent), attachment=attachment)
        return self.sent

    def publishes_until(self, condition: Callable[[], bool]) -> bool:
        return wait_until(lambda: bool(self.publish()) and condition(), 60, interval=0.02)

    def _answer(self, query: zenoh.Query) -> None:
        assert query.payload is not None
        assert query.attachment is not None
        assert parse_attachment(query.attachment.to_bytes()).version == self.version  # rmw_zenoh takes no others
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
    settings = merged(RouterSettings(), RouterOptions(segments=FREE, **flags))
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


@pytest.mark.parametrize(("version", "services"), [(1, []), (2, ["/**"])])
def test_messages_get_fields_while_they_pass(tmp_path: Path, version: Literal[1, 2], services: list[str]) -> None:
    """Also where services are intercepted, so that each segment has stand-ins for those of the other."""
    path = tmp_path / "run.mcap"
    with service(tmp_path, record=str(path), services=services) as router:
        router.plan_load(SET, "set")
        ends = {name: found[0] for name, found in router.endpoints.items()}
        got: list[float] = []
        with sensor(ends["system"], None, version=version) as node, open_client(ends["unit"]) as unit:
            unit.subscribe(KEY, lambda message: got.append(struct.unpack_from("<d", message.payload, 12)[0]))

            assert node.publishes_until(lambda: bool(got))
            assert -1.0 not in got
            missed = int(2 * got[0]) - 1  # before the router knew who had subscribed
            router.watch()
            assert node.publishes_until(lambda: bool(node.asked))
            assert -1.0 not in got
            node.told = reply(NAME, OWN)  # from the next question on; traffic goes on meanwhile

            assert node.publishes_until(lambda: got[-1] == -1.0)
            for _ in range(10):
                node.publish()
            assert wait_until(lambda: len(got) == node.sent - missed, 60), (len(got), node.sent)
            assert node.asked[0] == {"type_name": NAME, "type_hash": HASH, "include_type_sources": False}
            assert len(node.asked) <= 4
            sent = node.sent
        assert not router.pipeline.errors
        assert not router.bus.losses
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
    """Publishers that keep messages for late joiners are heard before they publish again."""
    path = tmp_path / "run.mcap"
    said: list[str] = []
    with ZenohProcess("router") as process, sensor(process.locators[0], reply(NAME, OWN)) as node:
        options = CaptureOptions(endpoint=process.locators[0], output=path, graph=False, control=False)
        node.publish()
        with CaptureService(options, warn=said.append) as recorder:
            assert len(node.asked) == 1
            assert node.heard()
            for _ in range(20):
                node.publish()
            assert wait_until(lambda: recorder.status()["messages"] == 20, 60)
    assert not said
    assert schemas(path) == [(NAME, 20, True)]  # the kept one is not announced, so it is not asked for


@pytest.mark.parametrize("ring", [0.0, 60.0])
def test_a_recording_goes_on_with_a_type_that_becomes_known(tmp_path: Path, ring: float) -> None:
    path = tmp_path / "run.mcap"
    said: list[str] = []
    with ZenohProcess("router") as process, sensor(process.locators[0], reply(NAME, OWN), announced=False) as node:
        options = CaptureOptions(
            endpoint=process.locators[0], output=path, graph=False, control=False, ring_seconds=ring
        )
        with CaptureService(options, warn=said.append) as recorder:
            assert node.heard()
            for _ in range(5):
                node.publish()
            assert wait_until(lambda: recorder.status()["messages"] == 5, 60)
            node.announce()
            assert node.publishes_until(lambda: recorder.registry.type_of(KEY) is not None)
            assert wait_until(lambda: any("has been told" in line for line in said), 60, interval=0.01)
            for _ in range(7):
                node.publish()
            assert wait_until(lambda: recorder.status()["messages"] == node.sent, 60)
            if ring:
                recorder.dump()
    file = path if not ring else next(tmp_path.glob("run*.mcap"))
    (before, after) = schemas(file)
    assert (before[0], before[2], after[0], after[2]) == (NAME, False, NAME, True)
    assert after[1] >= 7
    assert numbers(file) == list(range(1, node.sent + 1))


def test_nodes_that_tell_nonsense_or_nothing(tmp_path: Path) -> None:
    with service(tmp_path, intercept=["/reading"]) as router:
        ends = {name: found[0] for name, found in router.endpoints.items()}
        wrong = TypeStore(parse_msg("int32 number\n", NAME))
        with sensor(ends["system"], reply(NAME, wrong)) as liar, sensor(ends["unit"], b"\0" * (1 << 21)) as noisy:
            router.watch()
            assert liar.publishes_until(lambda: bool(noisy.publish()) and len(liar.asked) > 1 and len(noisy.asked) > 1)
            assert router._registry.type_of(KEY) is None


def test_a_node_that_never_answers_holds_up_nobody(tmp_path: Path) -> None:
    with service(tmp_path, intercept=["/reading"]) as router, contextlib.ExitStack() as stack:
        ends = {name: found[0] for name, found in router.endpoints.items()}
        node = stack.enter_context(sensor(ends["system"]))
        router.watch()
        assert node.publishes_until(lambda: bool(node.asked))
        began = time.monotonic()
        router._recordings.close()  # while the question is open
        assert time.monotonic() - began < 1.5


def test_nobody_is_asked_for_ever(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learner_module, "_AGAIN_S", (0.05, 0.05))
    wrong = reply(NAME, TypeStore(parse_msg("int32 number\n", NAME)))
    with service(tmp_path, intercept=["/reading"]) as router, sensor(router.endpoints["system"][0], wrong) as node:
        router.watch()
        learner = router._recordings._announcements._learner
        assert node.publishes_until(lambda: len(node.asked) == 3 and not learner._pursued)
        for _ in range(5):
            node.publish()
        learner.look(KEY)  # as when somebody else announces the topic
        assert node.publishes_until(lambda: len(node.asked) == 6 and not learner._pursued)


def test_what_nobody_looks_at_is_not_listened_to(tmp_path: Path) -> None:
    told = reply(NAME, OWN)
    with service(tmp_path) as router, sensor(router.endpoints["system"][0], told) as node:
        router.watch()
        pursued = router._recordings._announcements._learner._pursued
        assert node.publishes_until(lambda: KEY in pursued and pursued[KEY].missing is not None)
        assert pursued[KEY].missing
        assert pursued[KEY].probe is None
        assert not node.asked
        router.intercept_add(["/reading"])
        assert node.publishes_until(lambda: router._registry.type_of(KEY) is not None)
        assert len(node.asked) == 1
        assert wait_until(lambda: KEY not in pursued, 60)
