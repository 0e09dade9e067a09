"""`riot bridge ros2` as a command, and what a segment sees of a real ROS 2 domain behind it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from riot_bus.processes.ros_domains import free_domains
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import free_endpoint, release, wait_until
from riot_bus_ros2.attachment import Attachment, build_attachment, parse_attachment
from riot_bus_ros2.gid import gid_of
from tests.bags import STRING_HASH, STRING_KEY, text
from tests.integration.bridge_process import BridgeProcess
from tests.integration.rclpy_node import BEST_EFFORT, LATCHED, RELIABLE, RclpyNode
from tests.integration.router_process import riot
from tests.integration.zenoh_process import ZenohProcess
from tests.ros2_env import ros2_environment, ros2_interpreter

pytestmark = pytest.mark.integration

STRING, SWITCH = "std_msgs/msg/String", "std_srvs/srv/SetBool"
WAIT_S = 60.0


@pytest.fixture
def router() -> Iterator[str]:
    with ZenohProcess("router") as process:
        yield process.locators[0]


class Domain:
    """A domain of its own, with a bridge to a router."""

    def __init__(self, router: str, folder: Path, stack: contextlib.ExitStack) -> None:
        self.python = ros2_interpreter()
        (self.number,) = stack.enter_context(free_domains(1))
        self.environment = ros2_environment(self.number, folder)
        self.router, self._stack = router, stack

    def bridge(self, *options: str) -> BridgeProcess:
        return self._stack.enter_context(BridgeProcess(self.python, self.environment, self.router, *options))

    def node(self, name: str, namespace: str = "") -> RclpyNode:
        return self._stack.enter_context(RclpyNode(self.python, self.environment, name, namespace))


@pytest.fixture
def domain(router: str, tmp_path: Path) -> Iterator[Domain]:
    with contextlib.ExitStack() as stack:
        yield Domain(router, tmp_path, stack)


class Samples:
    """What arrives at an advanced subscriber, which is what rmw_zenoh subscribes with."""

    def __init__(self, endpoint: str, key: str, *, latched: int = 0) -> None:
        from zenoh import ext

        self.client = open_client(endpoint)
        self.found: list[tuple[bytes, Attachment]] = []
        self._bell = threading.Condition()
        self._subscriber: Any = ext.declare_advanced_subscriber(
            self.client.session,
            key,
            self._take,
            history=ext.HistoryConfig(detect_late_publishers=True, max_samples=latched) if latched else None,
            recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True) if latched else None,
        )

    def _take(self, sample: Any) -> None:
        with self._bell:
            self.found.append((sample.payload.to_bytes(), parse_attachment(sample.attachment.to_bytes())))
            self._bell.notify_all()

    def wait(self, last: bytes) -> list[tuple[bytes, Attachment]]:
        """Everything up to a payload with this in it."""
        with self._bell:
            self._bell.wait_for(lambda: bool(self.found) and last in self.found[-1][0], WAIT_S)
            return list(self.found)

    def tokens(self) -> set[str]:
        """Present tokens, without the bridge's session."""
        replies = self.client.session.liveliness().get("@ros2_lv/**", timeout=60)
        found = [str(reply.ok.key_expr).split("/") for reply in replies if reply.ok is not None]
        return {"/".join([*chunks[:2], *chunks[5:]]) for chunks in found}

    def gids(self, kind: str) -> set[bytes]:
        replies = self.client.session.liveliness().get("@ros2_lv/**", timeout=60)
        return {gid_of(str(r.ok.key_expr)) for r in replies if r.ok is not None and f"/{kind}/" in str(r.ok.key_expr)}

    def __enter__(self) -> Samples:
        return self

    def __exit__(self, *error: object) -> None:
        release(self._subscriber)
        self.client.close()


def test_options_that_are_wrong_are_named(tmp_path: Path) -> None:
    for arguments, code, part in (
        ([], 2, "--segment"),
        (["--segment=unit", "--endpoint=tcp/127.0.0.1:1"], 2, "--segment"),
        (["--segment=nowhere"], 2, "nowhere"),
        (["--endpoint=tcp/127.0.0.1:1", "--domain=500"], 2, "--domain"),
        (["--endpoint=tcp/127.0.0.1:1", "--topics=odom"], 2, "/odom"),
        ([f"--endpoint={free_endpoint()}"], 4, "nobody answers"),
    ):
        found, out, err = riot("bridge", "ros2", *arguments, cwd=tmp_path)
        assert (found, out) == (code, ""), err
        assert part in err


def test_a_segment_is_found_by_its_name_and_rclpy_is_missed(router: str, tmp_path: Path) -> None:
    (tmp_path / "riot.toml").write_text(f'[router.segments.unit]\nlisten = ["{router}"]\n')
    code, out, err = riot("bridge", "ros2", "--segment=unit", f"--python={sys.executable}", cwd=tmp_path)
    assert (code, out) == (2, "")
    assert "No module named 'rclpy'" in err
    assert "hint: source" in err


def test_the_segment_sees_nodes_of_rmw_zenoh(domain: Domain) -> None:
    bridge = domain.bridge("--format=json", "--zenoh-domain=5")
    assert json.loads(bridge.ready)["zenoh_domain"] == 5
    node = domain.node("robot", "/fleet")
    node.do("advertise", "/map", type=STRING, qos=LATCHED)
    node.do("advertise", "/scan", type=STRING, qos={**BEST_EFFORT, "deadline": 3 * 10**9 + 4})
    node.do("subscribe", "/goal", type=STRING, qos=RELIABLE)
    node.do("serve", "/switch")
    node.do("publish", "/map", payloads=[text(f"map {number}").hex() for number in range(7)])
    me = "%/%fleet/robot"
    chatter = STRING_KEY
    with Samples(domain.router, f"5/map/{STRING_KEY}", latched=100) as samples:
        found = samples.wait(b"map 6")
        # The node keeps five, and what it published after the bridge had come arrives as well.
        assert 5 <= len(found) <= 7
        assert [payload[8:13] for payload, _ in found] == [b"map %d" % number for number in range(7)][-len(found) :]
        numbers = [each.sequence for _, each in found]
        assert numbers == list(range(numbers[0], numbers[0] + len(found)))
        (gid,) = {each.gid for _, each in found}
        times = [each.source_time for _, each in found]
        assert times == sorted(times)
        wanted = {
            f"@ros2_lv/5/NN/{me}",
            f"@ros2_lv/5/MP/{me}/%map/{chatter}/:1:,100:,:,:,,",
            f"@ros2_lv/5/MP/{me}/%scan/{chatter}/2::,10:3,4:,:,,",
            f"@ros2_lv/5/MS/{me}/%goal/{chatter}/::,10:,:,:,,",
        }
        assert wait_until(lambda: wanted <= samples.tokens(), WAIT_S, interval=0.1), samples.tokens()
        assert wait_until(lambda: any("/SS/" in each for each in samples.tokens()), WAIT_S, interval=0.1)
        service = [each for each in samples.tokens() if "/SS/" in each]
        assert service[0].startswith(f"@ros2_lv/5/SS/{me}/%switch/std_srvs::srv::dds_::SetBool_/RIHS01_")
        assert len(samples.tokens()) == 5
        assert gid in samples.gids("MP")
        (type_and_hash,) = ["/".join(each.split("/")[-3:-1]) for each in service]
        asked = build_attachment(Attachment(41, 1, b"g" * 16))
        answers = samples.client.session.get(
            f"5/switch/{type_and_hash}", payload=b"\0\1\0\0\1", attachment=asked, timeout=30
        )
        (answer,) = [each.ok for each in answers if each.ok is not None]
        assert answer.payload.to_bytes()[4] == 0
        assert b"served by robot: True" in answer.payload.to_bytes()
        back = parse_attachment(answer.attachment.to_bytes())
        assert (back.sequence, back.gid) == (41, b"g" * 16)
        assert back.source_time > 10**18
        broken = list(samples.client.session.get(f"5/switch/{type_and_hash}", payload=b"\0\1", timeout=30))
        assert [each.ok for each in broken] == [None]
        # Nobody announces these messages, but somebody in the domain wants them.
        goal = Message(
            0, f"5/goal/{STRING_KEY}", text("there"), attachment=build_attachment(Attachment(1, 1, gid[::-1]))
        )
        samples.client.declare(goal.key, goal.qos)

        def crossed() -> bool:
            samples.client.put(goal)
            return bool(node.do("wait", "/goal", count=1, seconds=0.2))

        assert wait_until(crossed, WAIT_S)
        samples.client.put(Message(0, goal.key, b"\0", attachment=goal.attachment))
        assert bridge.process.stderr is not None
        warning = bridge.process.stderr.readline()
        assert warning == "warning: /goal: messages that are too short to be valid are left out\n"
        code, out, err = bridge.end()
        assert (code, err) == (0, "")
        ended = json.loads(out)
        assert ended["topics"]["/map"]["to_segment"] == len(found)
        assert ended["topics"]["/goal"]["to_domain"] >= 1
        assert ended["refused"] == {"/goal": 1}
        assert ended["services"] == {"/switch": 2}
        assert wait_until(lambda: samples.tokens() == set(), WAIT_S, interval=0.1)


def test_topics_may_be_chosen_and_types_may_be_unknown(domain: Domain) -> None:
    bridge = domain.bridge("--topics=/chosen/**", "--exclude=/chosen/not", "--services=/nothing")
    assert bridge.ready.startswith("ready: ")
    node = domain.node("node")
    node.do("serve", "/switch")
    for topic in ("/chosen/yes", "/chosen/not", "/other"):
        node.do("advertise", topic, type=STRING, qos=RELIABLE)
    thing, qos = "nowhere_msgs::msg::dds_::Thing_/TypeHashNotSupported", "::,10:,:,:,,"
    unknown = f"@ros2_lv/0/abc/0/1/MP/%/%/far/%chosen%far/{thing}/{qos}"
    newer = STRING_KEY.replace(STRING_HASH, "RIHS01_" + "0" * 64)
    other = f"@ros2_lv/0/abc/0/2/MP/%/%/far/%chosen%yes/{newer}/{qos}"
    with Samples(domain.router, "0/**") as samples:
        wanted = {"@ros2_lv/0/NN/%/%/node", f"@ros2_lv/0/MP/%/%/node/%chosen%yes/{STRING_KEY}/::,10:,:,:,,"}
        assert wait_until(lambda: samples.tokens() == wanted, WAIT_S, interval=0.1), samples.tokens()
        tokens = [samples.client.session.liveliness().declare_token(each) for each in (unknown, other)]
        assert bridge.process.stderr is not None
        lines = {bridge.process.stderr.readline() for _ in tokens}
        assert any("nowhere_msgs/msg/Thing is not installed" in line for line in lines), lines
        assert any("different versions of its type" in line for line in lines), lines
        release(*tokens)
    code, _, err = bridge.end()
    assert (code, err) == (0, "")


def test_nothing_outlives_a_bridge_and_no_bridge_its_node(domain: Domain) -> None:
    for kill in ("bridge", "node"):
        bridge = domain.bridge()
        assert bridge.ready.startswith("ready: ")
        (child,) = psutil.Process(bridge.process.pid).children()
        os.kill(bridge.process.pid if kill == "bridge" else child.pid, signal.SIGKILL)
        code, _, err = bridge.outcome()
        assert wait_until(lambda: not child.is_running(), WAIT_S)  # noqa: B023
        assert code == (-signal.SIGKILL if kill == "bridge" else 4)
        assert ("ROS node of the bridge has ended" in err) == (kill == "node")
