"""ROS 2 bags are played into the keys, tokens and attachments of rmw_zenoh, for others who know nothing of riot_bus."""

from __future__ import annotations

import json
import threading
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from riot_bus.log.reader import LogReader
from riot_bus.play.options import PlayOptions
from riot_bus.play.service import PlayService
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import release, wait_until
from riot_bus_ros2.attachment import parse_attachment
from riot_bus_ros2.gid import gid_of
from riot_bus_ros2.store import TypeStore
from tests.bags import LATCHED, STRING_HASH, STRING_KEY, VOLATILE, write_bag
from tests.integration.play_tools import BEGIN, MS, SECOND, Listener, play, write
from tests.integration.third_party.sdk import RosNode
from tests.integration.zenoh_process import ZenohProcess
from tests.robot_bag import GRID, ODOMETRY, STRING, TF, robot_bag

pytestmark = pytest.mark.integration

POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
OURS = {
    ODOMETRY: [
        "header.stamp.sec",
        "header.stamp.nanosec",
        "pose.pose.position.x",
        "twist.twist.angular.z",
        "child_frame_id",
    ],
    TF: ["transforms[0].header.frame_id", "transforms[0].transform.rotation.w"],
    POSE: ["header.frame_id", "pose.pose.position.y", "pose.covariance[35]"],
    GRID: ["info.width", "info.resolution", "data[3]"],
    STRING: ["data"],
}
"""Fields to compare, as our types name them; and as the third party's node does."""
THEIRS = {name: [path.replace("[", ".").replace("]", "") for path in paths] for name, paths in OURS.items()}


@pytest.fixture
def router() -> Iterator[str]:
    with ZenohProcess("router") as process:
        yield process.locators[0]


def definitions(*type_names: str) -> dict[str, str]:
    """Definition files of types and of all that they consist of."""
    found = {}
    for name in type_names:
        text = TypeStore().schema(name).data.decode()
        for number, part in enumerate(text.split("=" * 80 + "\n")):
            title, _, rest = part.partition("\n") if number else (f"MSG: {name}", "\n", part)
            package, _, short = title.removeprefix("MSG: ").rpartition("/")
            found[f"{package.removesuffix('/msg')}/msg/{short}.msg"] = rest
    return found


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return robot_bag(tmp_path / "robot.mcap")


def recorded(bag: Path) -> dict[str, tuple[str, list[list[Any]]]]:
    """By topic: its type, and the fields of its messages in their order, as our own types read them."""
    found: dict[str, tuple[str, list[list[Any]]]] = {}
    with LogReader(bag) as reader:
        registry = TypeRegistry(load_adapters())
        kinds = {
            source.topic: registry.add_schema(source.topic, source.schema, source.encoding)
            for source in reader.sources().values()
        }
        for message in reader.messages():
            kind = kinds[message.key]
            assert kind is not None
            values = [kind.read(message.payload, path) for path in OURS[kind.name]]
            found.setdefault(message.key, (kind.name, []))[1].append(values)
    return found


def node_at(python: Path, router: str, folder: Path, name: str = "listener") -> RosNode:
    """A node of the third party."""
    environment = {"ZENOH_CONFIG_OVERRIDE": f'mode="client";connect/endpoints=["{router}"]'}
    node = RosNode(python, router, environment=environment, folder=folder, name=name)
    node.do("define", definitions=definitions(ODOMETRY, TF, GRID, POSE))
    return node


def received(node: RosNode, topic: str, kind: str, count: int) -> list[list[Any]]:
    wait_until(lambda: node.do("count", topic) >= count, 60, interval=0.02)
    found: list[list[Any]] = node.do("values", topic, paths=THEIRS[kind])
    return found


def test_a_third_party_takes_a_bag_for_a_robot(python: Path, router: str, bag: Path, tmp_path: Path) -> None:
    expected = recorded(bag)
    with node_at(python, router, tmp_path) as node:
        for topic, (kind, _) in expected.items():
            node.do("subscribe", topic, type=kind)
        result = play(router, bag, rate=0.0, domain=0)
        assert result, result
        for topic, (kind, values) in expected.items():
            assert received(node, topic, kind, len(values)) == values, topic
        assert node.errors() == ""
    assert result.published == sum(len(values) for _, values in expected.values())


def test_late_joiners_of_a_third_party_get_what_is_latched(
    python: Path, router: str, bag: Path, tmp_path: Path
) -> None:
    latched = {"/tf_static", "/map", "/robot_description"}
    expected = {topic: found for topic, found in recorded(bag).items() if topic in latched}
    options = PlayOptions(logs=[bag], endpoint=router, rate=0.0, domain=0, wait=0.0, hold=True)
    with PlayService(options, warn=lambda line: None) as service:
        assert wait_until(lambda: service.status()["state"] == "ended", 60)
        with node_at(python, router, tmp_path) as node:
            assert wait_until(lambda: expected.keys() <= set(node.do("topics")), 60)
            for topic, (kind, values) in expected.items():
                node.do("subscribe", topic, type=kind, latched=True)
                assert received(node, topic, kind, 1) == values[-1:], topic  # the SDK asks for no more
            assert node.errors() == ""
    assert "/tf_static" in expected


def test_the_third_party_sees_a_node_with_publishers(python: Path, router: str, tmp_path: Path) -> None:
    bag = robot_bag(tmp_path / "robot.mcap")
    options = PlayOptions(logs=[bag], endpoint=router, domain=0, paused=True, wait=0.0)
    with PlayService(options, warn=lambda line: None), node_at(python, router, tmp_path) as node:
        found: dict[str, list[str]] = {}

        def shown() -> bool:
            found.update(node.do("topics"))
            return "/map" in found

        assert wait_until(shown, 60)
    assert found["/odom"] == [ODOMETRY]
    assert found["/tf_static"] == found["/tf"] == [TF]


class Advanced:
    """Subscribes as rmw_zenoh does: an advanced subscriber, that asks for history if it is transient local."""

    def __init__(self, endpoint: str, key: str, *, latched: int = 0) -> None:
        from zenoh import ext

        self.client = open_client(endpoint)
        self.samples: list[tuple[bytes, bytes | None]] = []
        self._bell = threading.Condition()
        history = ext.HistoryConfig(detect_late_publishers=True, max_samples=latched) if latched else None
        self._subscriber: Any = ext.declare_advanced_subscriber(
            self.client.session,
            key,
            self._take,
            history=history,
            recovery=ext.RecoveryConfig(heartbeat=True) if latched else None,
            subscriber_detection=True,
        )

    def _take(self, sample: Any) -> None:
        attachment = sample.attachment
        with self._bell:
            self.samples.append((sample.payload.to_bytes(), None if attachment is None else attachment.to_bytes()))
            self._bell.notify_all()

    def wait(self, count: int) -> list[tuple[bytes, bytes | None]]:
        with self._bell:
            self._bell.wait_for(lambda: len(self.samples) >= count, 30)
            return list(self.samples)

    def __enter__(self) -> Advanced:
        return self

    def __exit__(self, *error: object) -> None:
        release(self._subscriber)
        self.client.close()


def strings(path: Path, count: int, qos: str, *, name: str = "/chatter", hashed: str = STRING_HASH) -> Path:
    log = [(BEGIN + number * MS, name, f"message {number}") for number in range(count)]
    return write_bag(path, {name: (qos, hashed)}, log)


def test_attachments_are_new_and_tokens_fit_them(router: str, tmp_path: Path) -> None:
    bag = strings(tmp_path / "bag.mcap", 20, VOLATILE)
    with Advanced(router, f"0/chatter/{STRING_KEY}") as subscriber, open_client(router) as client:
        options = PlayOptions(logs=[bag], endpoint=router, domain=0, wait=20.0, hold=True)
        with PlayService(options) as service:
            found = subscriber.wait(20)
            tokens = [
                str(reply.ok.key_expr)
                for reply in client.session.liveliness().get("@ros2_lv/**", timeout=60)
                if reply.ok is not None
            ]
            zid = service._publishing.zid
        again = play(router, bag, domain=0)
        more = subscriber.wait(40)[20:]
    assert again
    assert sorted(tokens) == [
        f"@ros2_lv/0/{zid}/0/0/NN/%/%/riot_play",
        f"@ros2_lv/0/{zid}/0/1/MP/%/%/riot_play/%chatter/{STRING_KEY}/::,10:,:,:,,",
    ]
    attachments = [parse_attachment(attachment or b"") for _, attachment in found]
    assert [each.sequence for each in attachments] == list(range(1, 21))
    assert {each.gid for each in attachments} == {gid_of(max(tokens, key=len))}
    times = [each.source_time for each in attachments]
    assert times == sorted(times)
    assert times[0] > BEGIN + 10**16  # it is of today
    assert {each.version for each in attachments} == {2}
    repeated = [parse_attachment(attachment or b"") for _, attachment in more]
    assert [payload for payload, _ in more] == [payload for payload, _ in found]
    assert [each.sequence for each in repeated] == list(range(1, 21))
    assert {each.gid for each in repeated}.isdisjoint({each.gid for each in attachments})


def test_what_was_recorded_from_the_bus_gets_new_attachments_too(router: str, tmp_path: Path) -> None:
    from riot_bus.vocabulary.message import Message
    from riot_bus_ros2.attachment import Attachment, build_attachment

    key = f"3/chatter/{STRING_KEY}"
    log = [
        Message(BEGIN + number * MS, key, b"\0\1\0\0\2\0\0\0x\0", attachment=build_attachment(old))
        for number, old in enumerate(Attachment(900 + number, 5, b"g" * 16, 1) for number in range(5))
    ]
    with Listener(router, key) as listener:
        assert play(router, write(tmp_path / "log.mcap", log))
        found = [parse_attachment(message.attachment or b"") for message in listener.wait(5)]
    assert [(each.sequence, each.version) for each in found] == [(number, 1) for number in range(1, 6)]
    assert b"g" * 16 not in {each.gid for each in found}


def test_late_advanced_subscribers_get_what_is_latched(router: str, tmp_path: Path) -> None:
    bag = strings(tmp_path / "bag.mcap", 5, LATCHED, name="/map")
    options = PlayOptions(logs=[bag], endpoint=router, domain=0, wait=0.0, rate=0.0, hold=True)
    with PlayService(options, warn=lambda line: None) as service:
        assert wait_until(lambda: service.status()["state"] == "ended", 60)
        with Advanced(router, f"0/map/{STRING_KEY}", latched=10) as late:
            assert [payload[8:17] for payload, _ in late.wait(2)] == [b"message 3", b"message 4"]
            sequences = [parse_attachment(attachment or b"").sequence for _, attachment in late.wait(2)]
            assert sequences == [4, 5]


def test_what_was_latched_before_the_beginning_is_told(router: str, tmp_path: Path) -> None:
    topics = {"/map": (LATCHED, STRING_HASH), "/odom": (VOLATILE, STRING_HASH)}
    log = [(BEGIN + number * MS, "/map" if number < 4 else "/odom", str(number)) for number in range(10)]
    bag = write_bag(tmp_path / "bag.mcap", topics, log)
    with Listener(router, "0/*/**") as listener:
        assert play(router, bag, domain=0, start_offset=0.0065)
        found = [(message.key.split("/")[1], message.payload[8:9]) for message in listener.wait(5)]
    assert found == [("map", b"2"), ("map", b"3"), ("odom", b"7"), ("odom", b"8"), ("odom", b"9")]


def test_another_domain_and_another_name(router: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = strings(tmp_path / "bag.mcap", 1, VOLATILE)
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    with Listener(router, "*/**") as listener:
        play(router, bag)
        play(router, bag, domain=7, remap=["/chatter:=/replay/chatter"])
        keys = [message.key for message in listener.wait(2)]
    assert keys == [f"42/chatter/{STRING_KEY}", f"7/replay/chatter/{STRING_KEY}"]


def test_a_live_node_is_named(router: str, tmp_path: Path) -> None:
    bag = strings(tmp_path / "bag.mcap", 1, VOLATILE)
    key = f"0/chatter/{STRING_KEY}"
    warnings: list[str] = []
    with ZenohProcess("client", router) as live, Listener(router, key):
        live.do("token", f"@ros2_lv/0/{live.zid}/0/1/MP/%/%robot/talker/%chatter/{STRING_KEY}/::,10:,:,:,,")
        play(router, bag, domain=0, warn=warnings.append)
    assert warnings == [
        "/robot/talker publishes /chatter already: subscribers get both; leave it out (--exclude /chatter) "
        "or rename it (--remap /chatter:=/replay/chatter)"
    ]


def test_the_clock_goes_before_the_messages(router: str, tmp_path: Path) -> None:
    topics = {"/chatter": (VOLATILE, STRING_HASH), "/clock": (VOLATILE, STRING_HASH)}
    log = [(BEGIN + number * 10 * MS, "/chatter", str(number)) for number in range(30)]
    bag = write_bag(tmp_path / "bag.mcap", topics, [*log, (BEGIN, "/clock", "the recorded one")])
    with Listener(router, "0/**") as listener:
        assert play(router, bag, domain=0, clock=100.0).published == 30
        found = listener.wait(60)
    clock, chatter = defaultdict(list), 0
    kind = load_adapters(["ros2"])[0].type_named("rosgraph_msgs/msg/Clock")
    assert kind is not None
    now = 0
    for message in found:
        if message.key.startswith("0/clock/"):
            told = int(str(kind.read(message.payload, "clock.sec"))) * SECOND
            told += int(str(kind.read(message.payload, "clock.nanosec")))
            assert told >= now
            now = told
            clock[message.key].append(told)
        else:
            due = log[chatter][0]
            assert due - 10 * MS <= now <= due
            chatter += 1
    assert chatter == 30
    assert len(clock) == 1
    assert len(next(iter(clock.values()))) >= 29


def test_topics_of_foreign_files_that_are_not_ros_become_keys(router: str, tmp_path: Path) -> None:
    from mcap.writer import Writer

    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("Pose", "jsonschema", b"{}")
        channel = writer.register_channel("/robot/pose", "json", schema)
        for number in range(3):
            writer.add_message(channel, BEGIN + number, json.dumps({"x": number}).encode(), BEGIN)
        writer.finish()  # type: ignore[no-untyped-call]
    with Listener(router, "**") as listener:
        assert play(router, path)
        found = [(message.key, json.loads(message.payload)["x"]) for message in listener.wait(3)]
    assert found == [("robot/pose", number) for number in range(3)]
