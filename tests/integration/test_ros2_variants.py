"""Keys and attachments of all distributions are intercepted under one name, and those of zenoh-bridge-ros2dds too."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
from pathlib import Path

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from riot_bus.log.reader import read_log
from riot_bus.zenoh.session import wait_until
from riot_bus_ros2.attachment import Attachment, build_attachment
from riot_bus_ros2.keys import DataKey, build_data_key
from riot_bus_ros2.qos import RosQos
from riot_bus_ros2.ros2dds import BridgeQos, BridgeToken, build_bridge_token
from tests.bags import STRING_HASH, text
from tests.integration.bus_puppet import Puppet
from tests.integration.router_process import ENVIRONMENT, RIOT, RouterProcess, riot

pytestmark = pytest.mark.integration

STRING = "std_msgs/msg/String"
PLAN = "[[inject]]\ntopic = '/chatter'\nfield = 'data'\nvalue = 'other'\nwhere = \"data == 'value'\"\n"
BRIDGE = {"RIOT_ADAPTERS": "ros2dds"}
VARIANTS = {
    "jazzy": DataKey(0, "/chatter", STRING, STRING_HASH),
    "another domain": DataKey(42, "/chatter", STRING, STRING_HASH),
    "humble": DataKey(0, "/chatter", STRING),
    "buffers": DataKey(0, "/chatter", STRING, STRING_HASH, "_buf_cpu"),
    "buffers of one": DataKey(0, "/chatter", STRING, STRING_HASH, "_buf/0011aabb"),
}
OTHERS = (
    DataKey(0, "/chatter/filtered", STRING, STRING_HASH),
    DataKey(0, "/robot/chatter", STRING, STRING_HASH),
    DataKey(0, "/chatter_2", STRING, STRING_HASH),
)


@pytest.mark.parametrize("version", [1, 2])
def test_all_variants_of_a_topic_are_injected_and_no_other(tmp_path: Path, version: int) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    keys = [build_data_key(key) for key in (*VARIANTS.values(), *OTHERS)]
    with (
        RouterProcess(f"--inject={plan}") as router,
        Puppet(router.endpoints["system"]) as talker,
        Puppet(router.endpoints["unit"]) as listener,
    ):
        for key in keys:
            listener.do("subscribe", key=key)
            talker.do("declare", key=key)
        for number, key in enumerate(keys):

            def greeted(key: str = key) -> bool:
                talker.do("put", key=key, payload=text("hello").hex(), congestion="BLOCK")
                return any(each["key"] == key for each in listener.do("wait", count=1, timeout=0.02))

            assert wait_until(greeted, 60)
            attachment = build_attachment(Attachment(number, 10**18, bytes(range(16)), 1 if version == 1 else 2))
            payload = text("value").hex()
            talker.do("put", key=key, payload=payload, attachment=attachment.hex(), congestion="BLOCK")
        found: dict[str, tuple[str, str]] = {}

        def complete() -> bool:
            for each in listener.do("wait", count=1):
                if each["attachment"] is not None:
                    found[each["key"]] = (each["payload"], each["attachment"])
            return len(found) == len(keys)

        assert wait_until(complete, 60)
        for number, key in enumerate(keys):
            expected = text("other" if number < len(VARIANTS) else "value")
            attachment = build_attachment(Attachment(number, 10**18, bytes(range(16)), 1 if version == 1 else 2))
            assert found[key] == (expected.hex(), attachment.hex()), key
        code, out, _ = router.end(signal.SIGTERM)
    assert code == 0
    assert [line.split()[0] for line in out.splitlines()[1:] if line.startswith("/")] == ["/chatter"]


def token(puppet: Puppet, kind: str, qos: RosQos) -> str:
    said = BridgeQos.of(qos, type_hash=STRING_HASH)
    return build_bridge_token(BridgeToken(puppet.zid, kind, "chatter", STRING, said))  # type: ignore[arg-type]


def test_bridges_of_dds_systems_are_injected_shown_recorded_and_played_by_name(tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    folder = tmp_path / "bag"
    with (
        RouterProcess(f"--inject={plan}", environment=BRIDGE) as router,
        Puppet(router.endpoints["system"]) as one,
        Puppet(router.endpoints["unit"]) as other,
        contextlib.ExitStack() as stack,
    ):
        one.do("token", key=token(one, "MP", RosQos(depth=7)))
        other.do("token", key=token(other, "MS", RosQos(depth=1)))
        announced = stack.enter_context(Puppet(router.endpoints["unit"]))
        announced.do("tokens", key="@/*/@ros2_lv/**")
        assert {each["key"] for each in announced.do("wait", count=2, timeout=60)} == {
            token(one, "MP", RosQos(depth=7)),
            token(other, "MS", RosQos(depth=1)),
        }
        other.do("subscribe", key="chatter")
        one.do("declare", key="chatter")

        def changed() -> bool:
            one.do("put", key="chatter", payload=text("value").hex(), congestion="BLOCK")
            return any(each["payload"] == text("other").hex() for each in other.do("wait", count=1, timeout=0.02))

        assert wait_until(changed, 60, interval=0.02)
        expected = {
            ("system", "publishes", "/chatter", STRING),
            ("unit", "subscribes", "/chatter", STRING),
        }
        shown = ""

        def named() -> bool:
            nonlocal shown
            code, shown, err = riot("graph", "-e", router.endpoints["system"], environment=BRIDGE)
            assert code == 0, err
            rows = [line.split() for line in shown.splitlines()]
            return expected <= {(row[0], *row[2:5]) for row in rows if len(row) > 4}

        assert wait_until(named, 120, interval=0.1), shown
        words = [*RIOT, "record", "/chatter", "-e", router.endpoints["unit"], "--bag", str(folder), "--format=json"]
        variables = {**ENVIRONMENT, **BRIDGE}
        process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=variables)
        try:
            assert process.stdout is not None
            assert json.loads(process.stdout.readline())["event"] == "started"
            for number in range(20):
                one.do("put", key="chatter", payload=text(f"{number}").hex(), congestion="BLOCK")
            assert wait_until(lambda: len(read_log(folder / "bag_0.mcap")) == 20, 60, interval=0.05)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=60)
        finally:
            process.kill()
            process.communicate()
        assert (process.returncode, err) == (0, "")
        assert json.loads(out)["recorded"] == {"/chatter": 20}
        with AnyReader([folder]) as bag:
            assert {(each.topic, each.msgtype) for each in bag.connections} == {("/chatter", STRING)}
            found = [bag.deserialize(raw, each.msgtype).data for each, _, raw in bag.messages()]  # type: ignore[attr-defined]
        assert found == [str(number) for number in range(20)]
        with (folder / "bag_0.mcap").open("rb") as file:
            summary = make_reader(file).get_summary()
        assert summary is not None
        (channel,) = summary.channels.values()
        assert channel.metadata["topic_type_hash"] == STRING_HASH
        assert "depth: 7\n" in channel.metadata["offered_qos_profiles"]
        code, out, err = riot("info", str(folder / "bag_0.mcap"), "--format=json", environment=BRIDGE)
        assert code == 0, err
        assert "/chatter" in out
        table = tmp_path / "table.csv"
        words = ["export", str(folder / "bag_0.mcap"), "--field=/chatter:data", "-o", str(table)]
        code, out, err = riot(*words, environment=BRIDGE)
        assert code == 0, err
        assert [line.rpartition(",")[2] for line in table.read_text().splitlines()[1:]] == found
        with Puppet(router.endpoints["system"]) as third:
            third.do("subscribe", key="chatter")
            arguments = ["play", str(folder), "-e", router.endpoints["unit"], "-r", "0", "--no-control"]
            code, out, err = riot(*arguments, environment=BRIDGE)
            assert code == 0, err
            played = third.do("wait", count=20)
            assert [each["payload"] for each in played] == [text(str(number)).hex() for number in range(20)]
            assert {each["attachment"] for each in played} == {None}
