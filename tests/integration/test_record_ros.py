"""Nodes of a third-party ROS 2 client are recorded as a bag that ROS 2 tools read."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from riot_bus.log.reader import read_log
from riot_bus.zenoh.session import wait_until
from tests.integration.router_process import ENVIRONMENT, RIOT, RouterProcess
from tests.integration.third_party.sdk import RosNode
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration


def test_a_node_is_recorded_as_a_bag(python: Path, tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    with ZenohProcess("router") as router:
        endpoint = router.locators[0]
        override = {"ZENOH_CONFIG_OVERRIDE": f'mode="client";connect/endpoints=["{endpoint}"]'}
        with RosNode(python, endpoint, environment=override, folder=tmp_path, name="talker") as talker:
            talker.do("advertise", "/chatter")
            words = [*RIOT, "record", "/chatter", "-e", endpoint, "--bag", str(folder), "--format=json"]
            process = subprocess.Popen(
                words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT
            )
            try:
                assert process.stdout is not None
                assert json.loads(process.stdout.readline())["event"] == "started"
                talker.do("publish", "/chatter", messages=[{"data": f"message {number} ä"} for number in range(20)])
                assert wait_until(lambda: len(read_log(folder / "bag_0.mcap")) == 20, 60, interval=0.05)
                process.send_signal(signal.SIGINT)
                out, err = process.communicate(timeout=60)
            finally:
                process.kill()
                process.communicate()
    assert (process.returncode, err) == (0, "")
    assert json.loads(out)["recorded"] == {"/chatter": 20}
    expected = [f"message {number} ä" for number in range(20)]
    with AnyReader([folder]) as bag:
        assert [bag.deserialize(raw, each.msgtype).data for each, _, raw in bag.messages()] == expected
    with (folder / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        rows = [(message.sequence, decoded.data) for _, _, message, decoded in reader.iter_decoded_messages()]
        summary = reader.get_summary()
    assert [text for _, text in rows] == expected
    assert [number - rows[0][0] for number, _ in rows] == list(range(20))
    assert summary is not None
    (channel,) = summary.channels.values()
    assert channel.topic == "/chatter"
    assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
    assert channel.metadata["offered_qos_profiles"].startswith("- history: 1\n  depth: ")


def test_a_router_records_a_node_as_ros_tools_want_it(python: Path, tmp_path: Path) -> None:
    path = tmp_path / "router.mcap"
    with RouterProcess("--intercept=/chatter", f"--record={path}") as router:
        endpoint = router.endpoints["system"]
        override = {"ZENOH_CONFIG_OVERRIDE": f'mode="client";connect/endpoints=["{endpoint}"]'}
        with RosNode(python, endpoint, environment=override, folder=tmp_path, name="talker") as talker:
            talker.do("advertise", "/chatter")
            talker.do("publish", "/chatter", messages=[{"data": f"message {number}"} for number in range(20)])
            assert wait_until(lambda: len(read_log(path)) == 20, 60, interval=0.05)
        assert router.end(signal.SIGINT)[0] == 0
    with AnyReader([path]) as bag:
        texts = [bag.deserialize(raw, each.msgtype).data for each, _, raw in bag.messages()]
    assert texts == [f"message {number}" for number in range(20)]
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        records = {each.name: each.metadata for each in reader.iter_metadata()}
    assert summary is not None
    (channel,) = summary.channels.values()
    assert channel.metadata["topic_type_hash"].startswith("RIHS01_")
    assert channel.metadata["offered_qos_profiles"].startswith("- history: 1\n  depth: ")
    assert "message_count: 20" in records["rosbag2"]["serialized_metadata"]
