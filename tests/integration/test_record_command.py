"""`riot record` and `riot ctl record`, as people use them."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import pty
import random
import resource
import select
import signal
import struct
import subprocess
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from riot_bus.log.reader import LogReader, read_log
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.client import Client, open_client
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.router_process import ENVIRONMENT, RIOT, RouterProcess, riot
from tests.integration.zenoh_process import ZenohProcess
from tests.tiers import scaled

pytestmark = pytest.mark.integration

BLOCK = Qos(congestion="block")
TYPE_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
STRING_KEY = f"std_msgs::msg::dds_::String_/{TYPE_HASH}"
TOKEN = f"@ros2_lv/0/aa/0/1/MP/%/%/talker/%chatter/{STRING_KEY}/2:1:,7:,:,:,,"


@pytest.fixture(scope="module")
def router() -> Iterator[str]:
    with ZenohProcess("router") as process:
        yield process.locators[0]


@contextlib.contextmanager
def recorder(*arguments: str, cwd: Path | None = None) -> Iterator[subprocess.Popen[str]]:
    """A recorder that has begun."""
    process = subprocess.Popen(
        [*RIOT, "record", "--format=json", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=ENVIRONMENT,
        cwd=cwd,
    )
    assert process.stdout is not None
    try:
        line = process.stdout.readline()
        assert line, process.communicate(timeout=60)
        assert json.loads(line)["event"] == "started"
        yield process
    finally:
        process.kill()
        process.communicate(timeout=60)


def ended(process: subprocess.Popen[str]) -> tuple[int, dict[str, Any], str]:
    out, err = process.communicate(timeout=60)
    return process.returncode, json.loads(out), err


def put(client: Client, key: str, *payloads: bytes, attachment: bytes | None = None) -> None:
    for payload in payloads:
        client.put(Message(0, key, payload, attachment=attachment, qos=BLOCK))


def recorded(path: Path) -> list[bytes]:
    """What is in a file; nothing in one that was created just now."""
    return [each.payload for each in read_log(path)] if path.stat().st_size else []


def ctl(router: str, *arguments: str) -> dict[str, Any]:
    code, out, err = riot("ctl", "record", *arguments, "-e", router, "--format=json")
    assert code == 0, err
    found: dict[str, Any] = json.loads(out)
    return found


def test_until_interrupted(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder("int/**", "-e", router, "-o", str(path), "--no-graph") as process, open_client(router) as client:
        put(client, "int/x", b"1", b"2")
        assert wait_until(lambda: len(recorded(path)) == 2, 60, interval=0.02)
        put(client, "int/x", b"3")
        ready = [status for status in [ctl(router, "status", "--recorder=recorder")] if status["messages"] == 3]
        assert ready or wait_until(lambda: ctl(router, "status", "--recorder=recorder")["messages"] == 3, 60)
        process.send_signal(signal.SIGINT)
        code, result, err = ended(process)
    assert (code, err) == (0, "")
    assert recorded(path) == [b"1", b"2", b"3"]
    assert result["recorded"] == {"int/x": 3}
    assert result["files"][0]["messages"] == 3
    code, out, err = riot("info", str(path))
    assert (code, err) == (0, "")
    assert "int/x" in out


def test_a_loss_is_exit_code_3_and_said_by_topic(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder("/chatter", "-e", router, "-o", str(path)) as process, open_client(router) as client:
        for number in (1, 2, 7):
            attachment = struct.pack("<qqB16s", number, 1, 16, bytes(16))
            put(client, f"0/chatter/{STRING_KEY}", b"\0\1\0\0\2\0\0\0a\0", attachment=attachment)
        assert wait_until(lambda: len(recorded(path)) == 3, 60, interval=0.02)
        process.send_signal(signal.SIGTERM)
        code, result, err = ended(process)
    assert (code, result["lost"]) == (3, {"missed": {"/chatter": 4}})
    assert "4 messages are lost (missed: 4)" in err
    assert riot("info", str(path))[0] == 3


def test_files_that_may_not_be_larger_are_followed_by_others(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    options = ["--compression=none", "--chunk-size=10kB", "--chunk-duration=50ms", "--no-graph"]
    with recorder("big/**", "-e", router, "-o", str(path), *options) as process, Puppet(router) as source:
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (200_000, 200_000))
        source.do("flood", key="big/x", count=1000, padding=1000)
        assert wait_until(lambda: len(list(tmp_path.iterdir())) > 1, 60)
        with open_client(router) as client:

            def is_written_again() -> bool:
                put(client, "big/end", b"end")  # the first ones may come while the disk still refuses
                return any(b"end" in recorded(file) for file in sorted(tmp_path.iterdir()))

            assert wait_until(is_written_again, 60, interval=0.05)
        process.send_signal(signal.SIGINT)
        code, result, err = ended(process)
    assert code == 3
    assert err.count("ALARM: the log cannot be written: File too large") == 1
    assert "Traceback" not in err
    files = [Path(each["path"]) for each in result["files"]]
    inside = sum(len(recorded(file)) for file in files)
    flood = sum(payload != b"end" for file in files for payload in recorded(file))
    assert flood + result["lost"]["disk"]["big/x"] == 1000
    assert inside == sum(result["recorded"].values())
    assert len(files) > 1


def test_killed_at_any_moment_the_file_holds_all_but_the_last_chunk(router: str, tmp_path: Path) -> None:
    draw = random.Random(4)
    for number in range(scaled(4, gate=2)):
        path, key = tmp_path / f"{number}.mcap", f"kill/{number}"
        options = ["-o", str(path), "--chunk-duration=100ms", "--no-control", "--no-graph"]
        with recorder(key, "-e", router, *options) as process, Puppet(router) as source, Puppet(router) as sink:
            sink.do("subscribe_numbers", key=key)
            source.start("flood", key=key, count=40_000)
            assert wait_until(lambda file=path: len(recorded(file)) > 0, 60, interval=0.02)  # type: ignore[misc]
            time.sleep(draw.uniform(0.0, 0.3))
            process.kill()
            process.wait(60)
            source.answer()
            assert sink.do("wait_numbers", count=40_000)["ordered"]
        with LogReader(path) as reader:
            found = [int.from_bytes(each.payload[:8], "little") for each in reader.messages()]
            assert reader.loss.chunks == reader.loss.messages == reader.loss.details == 0
        assert found == list(range(len(found)))
        code, out, _ = riot("info", str(path), "--format=json")
        assert json.loads(out)["count"] == len(found)
        assert code == (3 if json.loads(out)["loss"]["unfinished"] else 0)


def test_a_second_interrupt_ends_at_once(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recorder("two/**", "-e", router, "-o", str(path), "--no-graph") as process, open_client(router) as client:
        put(client, "two/x", b"1")
        assert wait_until(lambda: len(recorded(path)) == 1, 60, interval=0.02)
        process.send_signal(signal.SIGSTOP)
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGTERM)
        process.send_signal(signal.SIGCONT)
        assert process.wait(60) in (0, 130)
    assert recorded(path) == [b"1"]


def test_a_ring_is_written_on_sigusr1_and_on_command(router: str, tmp_path: Path) -> None:
    options = ["--ring=30s", "--name=ring", "--no-graph", "--start-paused"]
    with recorder("usr/**", "-e", router, *options, cwd=tmp_path) as process, open_client(router) as client:
        assert ctl(router, "resume", "--recorder=ring")["state"] == "recording"
        put(client, "usr/x", b"1")
        assert wait_until(lambda: ctl(router, "status", "--recorder=ring")["messages"] == 1, 60)
        process.send_signal(signal.SIGUSR1)
        assert wait_until(lambda: len(list(tmp_path.glob("*.mcap"))) == 1, 60)
        assert ctl(router, "dump", "by-name.mcap", "--recorder=ring") == {"dumped": str(tmp_path / "by-name.mcap")}
        code, out, err = riot("ctl", "record", "status", "-e", router)
        assert code == 0, err
        assert "ring: 1 message," in out
        ctl(router, "stop", "--recorder=ring")
        code, result, err = ended(process)
    assert code == 0, err
    assert len(result["files"]) == 2
    assert all(recorded(Path(tmp_path, each["path"])) == [b"1"] for each in result["files"])


MONITORED = """
[system]
name = "one"

[components.x]
command = ["true"]
outputs = ["mon/x"]

[[monitors]]
kind = "finite"
field = "mon/x:v"

[[monitors]]
kind = "rate"
topic = "mon/x"
gap = 0.5
"""


def test_a_ring_is_written_when_a_monitor_of_riot_toml_is_violated(router: str, tmp_path: Path) -> None:
    (tmp_path / "riot.toml").write_text(MONITORED)
    options = ["--ring=30s", "--name=mon", "--no-graph", "--monitors=riot.toml"]
    with recorder("mon/**", "-e", router, *options, cwd=tmp_path) as process, open_client(router) as client:

        def files(number: int) -> bool:
            # several at once: one that comes late, as on a busy machine, only goes on with the violation of `gap`
            put(client, "mon/x", *[b'{"v": 1}'] * 5)
            return len(list(tmp_path.glob("*.mcap"))) >= number

        put(client, "mon/x", b'{"v": NaN}')
        assert wait_until(lambda: files(1), 60)
        # now nothing comes any more
        assert wait_until(lambda: len(list(tmp_path.glob("*.mcap"))) >= 2, 60)
        ctl(router, "stop", "--recorder=mon")
        code, result, err = ended(process)
    assert code == 0, err
    assert len(result["files"]) == 2
    assert "mon/x:v = nan" in err
    assert "no mon/x for " in err


def test_the_words_of_a_router_are_those_of_a_recorder_where_no_router_answers(router: str, tmp_path: Path) -> None:
    with recorder("words/**", "-e", router, "-o", str(tmp_path / "a.mcap"), "--no-graph", "--name=words") as process:
        found = ctl(router, "split", "b.mcap")
        assert found == {"former": str(tmp_path / "a.mcap"), "file": str(tmp_path / "b.mcap")}
        ctl(router, "stop")
        assert ended(process)[0] == 0
    with RouterProcess(cwd=tmp_path) as process_router:
        endpoint = process_router.endpoints["unit"]
        assert ctl(endpoint, "start", "c.mcap") == {"file": str(tmp_path / "c.mcap")}
        assert ctl(endpoint, "stop")["file"] == str(tmp_path / "c.mcap")


def test_a_bag_is_what_ros_2_tools_read(router: str, tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader

    folder = tmp_path / "bag"
    options = ["--bag", str(folder), "--split-duration=1h", "--name=bag"]
    with ZenohProcess("client", router) as talker, open_client(router) as client:
        talker.do("token", TOKEN)
        with recorder("-e", router, *options) as process:
            for number in range(4):
                attachment = struct.pack("<qqB16s", number + 1, 10**18 + number, 16, bytes(16))
                put(client, f"0/chatter/{STRING_KEY}", b"\0\1\0\0\2\0\0\0%d\0" % number, attachment=attachment)
                put(client, "no/ros", b"1")
                if number == 1:
                    files = sorted(folder.glob("*.mcap"))
                    assert wait_until(lambda file=files[0]: len(recorded(file)) == 2, 60, interval=0.02)  # type: ignore[misc]
                    ctl(router, "split", "--recorder=bag")
            assert wait_until(lambda: len(recorded(folder / "bag_1.mcap")) == 2, 60, interval=0.02)
            process.send_signal(signal.SIGINT)
            code, _, err = ended(process)
    assert (code, err) == (0, "no/ros is not a topic of ROS 2 and is not recorded, since a bag cannot hold it\n")
    assert sorted(each.name for each in folder.iterdir()) == ["bag_0.mcap", "bag_1.mcap", "metadata.yaml"]
    with AnyReader([folder]) as bag:
        assert [each.topic for each in bag.connections] == ["/chatter"] * len(bag.connections)
        read = [bag.deserialize(raw, each.msgtype).data for each, _, raw in bag.messages()]
        assert bag.message_count == 4
        assert bag.topics["/chatter"].msgtype == "std_msgs/msg/String"
    assert read == ["0", "1", "2", "3"]
    text = (folder / "metadata.yaml").read_text()
    for part in ("version: 8", "message_count: 4", "depth: 7", TYPE_HASH, '- "bag_0.mcap"', '- "bag_1.mcap"'):
        assert part in text
    with (folder / "bag_0.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        found = [
            (message.publish_time, message.sequence, decoded.data)
            for _, _, message, decoded in reader.iter_decoded_messages()
        ]
        metadata = {each.name: each.metadata for each in reader.iter_metadata()}
        summary = reader.get_summary()
    assert found == [(10**18, 1, "0"), (10**18 + 1, 2, "1")]
    assert "message_count: 2" in metadata["rosbag2"]["serialized_metadata"]
    assert summary is not None
    (channel,) = summary.channels.values()
    assert channel.metadata["topic_type_hash"] == TYPE_HASH
    for part in ("depth: 7", "reliability: 2", "durability: 1"):
        assert part in channel.metadata["offered_qos_profiles"]


@pytest.mark.parametrize(("options", "profile"), [((), "ros2"), (("--profile=none",), "")])
def test_the_profile_is_that_of_the_network_if_none_is_given(
    router: str, tmp_path: Path, options: tuple[str, ...], profile: str
) -> None:
    path = tmp_path / "a.mcap"
    with ZenohProcess("client", router) as talker:
        talker.do("token", TOKEN)
        with recorder("-e", router, f"-o{path}", *options) as process:
            process.send_signal(signal.SIGINT)
            assert ended(process)[0] == 0
    with path.open("rb") as file:
        assert make_reader(file).get_header().profile == profile


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["-o", "a.txt"], "not a name of a log"),
        (["-o", "no/a.mcap"], "cannot write the log"),
        (["--split-size=big"], "not a size"),
        (["--ring=soon"], "not a time"),
        (["--dump-on=/x where a > 1"], "need a ring"),
        (["--ring=3", "--monitors=none.toml"], "none.toml"),
        (["--ring=3", "--dump-on=/x"], "not a condition"),
        (["--ring=3", "--dump-on=/x where a >"], "predicate"),
        (["--throttle=/x"], "how often"),
        (["--max-files=2"], "more than one file"),
        (["--compression=zip"], "unknown compression"),
        (["a/**", "--all"], "both say"),
        (["a//b"], "not a key expression"),
        (["--type=x"], "not a topic and its type"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_written(
    router: str, tmp_path: Path, arguments: list[str], text: str
) -> None:
    code, out, err = riot("record", "-e", router, *arguments, cwd=tmp_path)
    assert (code, out) == (2, ""), err
    assert text in err
    assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_no_router_is_exit_code_4(tmp_path: Path) -> None:
    code, _, err = riot("record", "-e", "tcp/127.0.0.1:1", cwd=tmp_path)
    assert code == 4, err
    assert not list(tmp_path.iterdir())


def test_keys_on_a_terminal(router: str, tmp_path: Path) -> None:
    master, slave = pty.openpty()
    shown = ""
    words = [*RIOT, "record", "tty/**", "-e", router, "-o", str(tmp_path / "a.mcap"), "--no-graph", "--no-control"]
    process = subprocess.Popen(
        words, stdin=slave, stdout=slave, stderr=slave, env={**ENVIRONMENT, "TERM": "xterm"}, preexec_fn=_lead
    )

    def shows(text: str) -> bool:
        nonlocal shown
        deadline = time.monotonic() + 30
        while text not in shown and time.monotonic() < deadline:
            if select.select([master], [], [], 0.1)[0]:
                shown += os.read(master, 4096).decode()
        found, _, shown = text in shown, *shown.partition(text)[1:]
        return found

    try:
        assert shows("space: pause")
        assert shows("● recording")
        os.write(master, b" ")
        assert shows("⏸ paused")
        os.write(master, b" ")
        assert shows("● recording")
        os.write(master, b"s")
        assert shows("went on in")
        os.write(master, b"q")
        assert shows("recorded 0 messages")
        assert process.wait(60) == 0
    finally:
        process.kill()
        process.wait(60)
        os.close(master)
        os.close(slave)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a-2.mcap", "a.mcap"]


def _lead() -> None:
    """Make the terminal on stdin this process's own."""
    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
