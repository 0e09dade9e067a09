"""A recorder as a client of a plain Zenoh router: everything is recorded, or counted as lost and said."""

from __future__ import annotations

import errno
import json
import shutil
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from riot_bus.control.remote import Remote
from riot_bus.graph.history import replay
from riot_bus.log.account import LOST, account_of
from riot_bus.log.engine.mcap_file import McapFile
from riot_bus.log.reader import LogReader, read_log
from riot_bus.record.options import CaptureOptions
from riot_bus.record.service import CaptureService
from riot_bus.vocabulary.errors import ConfigError
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.client import Client, open_client
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration

BLOCK = Qos(congestion="block")
STRING_KEY = "std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
CHATTER = f"0/chatter/{STRING_KEY}"


@pytest.fixture(scope="module")
def router() -> Iterator[str]:
    with ZenohProcess("router") as process:
        yield process.locators[0]


@contextmanager
def recording(
    endpoint: str, path: Path | None, *, warnings: list[str] | None = None, **more: Any
) -> Iterator[CaptureService]:
    options = CaptureOptions(endpoint=endpoint, output=path, **{"graph": False, "control": False, **more})
    said = [] if warnings is None else warnings
    with CaptureService(options, warn=said.append) as service:
        yield service
        service.stop()
        assert service.wait(30)
    if warnings is None:
        assert not said


@contextmanager
def client(endpoint: str) -> Iterator[Client]:
    with open_client(endpoint) as found:
        yield found


def text(value: str) -> bytes:
    """A std_msgs/msg/String."""
    data = value.encode() + b"\0"
    return b"\0\1\0\0" + len(data).to_bytes(4, "little") + data


def has(service: CaptureService, messages: int) -> bool:
    return wait_until(lambda: service.status()["messages"] >= messages, 60)


def numbers(path: Path, key: str) -> list[int]:
    return [int(each.payload) for each in read_log(path) if each.key == key]


def put(sender: Client, key: str, *values: int) -> None:
    for value in values:
        sender.put(Message(0, key, b"%d" % value, qos=BLOCK))


def account(path: Path) -> Any:
    with LogReader(path) as reader:
        return account_of(list(reader.notes(LOST))[-1])


def test_everything_of_a_message_is_recorded(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    sent = [
        Message(0, "all/a", b'{"x": 1}', encoding="application/json", qos=Qos(1, "block", True)),
        Message(0, "all/a", b"", qos=Qos(1, "block", True), encoding="application/json"),
        Message(0, "all/a", b"2", attachment=b"att", qos=BLOCK),
        Message(0, "all/b", b"\0" * 100_000, qos=BLOCK),
        Message(0, "all/a", b"", kind="delete", qos=BLOCK),
    ]
    with recording(router, path, keys=["all/**"], robot="rosie", seed=7, notes={"command": "x"}) as service:
        with client(router) as sender:
            for each in sent:
                sender.put(each)
            put(sender, "other", 1)
            assert has(service, 5)
        result = service.status()
    assert (result["messages"], result["lost"]) == (5, 0)
    with LogReader(path) as reader:
        found = list(reader.messages())
        metadata = reader.metadata
        assert not reader.loss
    assert [each.sequence for each in found] == [1, 2, 3, 4, 5]
    assert all(each.publish_time is not None for each in found[:4])  # the router stamps
    assert all(each.time >= each.publish_time - 10**9 for each in found if each.publish_time is not None)
    same = [each.with_(time=0, sequence=0, publish_time=None, segment="") for each in found]
    assert same == sent
    assert (metadata["robot"], metadata["seed"], metadata["command"]) == ("rosie", "7", "x")
    assert {"riot_bus", "zenoh", "host", "python", "options"} <= metadata.keys()
    assert dict(account(path).recorded) == {"all/a": 4, "all/b": 1}
    with path.open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == 5


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_flood_is_recorded_whole_and_in_order(router: str, tmp_path: Path, compression: str) -> None:
    path, count, key = tmp_path / "a.mcap", 20_000, f"flood/{compression}"
    with recording(router, path, keys=[key], compression=compression) as service, Puppet(router) as source:
        source.do("flood", key=key, count=count, padding=100)
        assert has(service, count)
    found = [int.from_bytes(each.payload[:8], "little") for each in read_log(path)]
    assert found == list(range(count))
    assert service.result()


def test_overlapping_expressions_record_each_message_once_and_exclusions_none(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    keys = ["over/*/x", "over/a/*", "over/a/x", "/over/ros"]
    options: dict[str, Any] = {"keys": keys, "exclude": ["over/a/no", "over/*/x/**"]}
    with recording(router, path, **options) as service, client(router) as sender:
        for key in ("over/a/x", "over/a/no", "over/b/x", "over/a/y"):
            put(sender, key, 1)
        put(sender, f"3/over/ros/{STRING_KEY}", 2)
        assert has(service, 2)
    assert sorted(each.key for each in read_log(path)) == [f"3/over/ros/{STRING_KEY}", "over/a/y"]


def test_pause_and_throttle_leave_out_what_is_counted(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    options: dict[str, Any] = {"keys": ["calm/**"], "throttle": ["calm/slow=0.01"], "paused": True}
    with recording(router, path, **options) as service, client(router) as sender:
        put(sender, "calm/a", 1)
        assert wait_until(lambda: service.status()["left_out"] == {"paused": 1}, 60)
        service.resume()
        put(sender, "calm/slow", *range(10))
        put(sender, "calm/a", 2)
        assert has(service, 2)
    assert [(each.key, each.payload) for each in read_log(path)] == [("calm/slow", b"0"), ("calm/a", b"2")]
    found = account(path)
    assert found.left_out == {"paused": {"calm/a": 1}, "throttled": {"calm/slow": 9}}
    assert not found
    assert service.result()


def test_splits_leave_each_message_in_one_file(router: str, tmp_path: Path) -> None:
    path, count = tmp_path / "a.mcap", 20_000
    options: dict[str, Any] = {"keys": ["split/**"], "split_bytes": 200_000, "compression": "none"}
    with recording(router, path, **options) as service, Puppet(router) as source:
        source.start("flood", key="split/x", count=count, padding=200)
        service.split()
        source.answer()
        assert has(service, count)
        assert wait_until(lambda: service.status()["bytes"] < 200_000, 60)  # so the recorder has split, too
        service.split("by-hand.mcap")
    files = [Path(each.path) for each in service.result().files]
    assert len(files) >= 3
    assert files[0] == path
    assert files[1].name == "a-2.mcap"
    assert "by-hand.mcap" in {each.name for each in files}
    rows = [[int.from_bytes(each.payload[:8], "little") for each in read_log(file)] for file in files]
    assert [number for row in rows for number in row] == list(range(count))
    assert [sum(each.account.recorded.values()) for each in service.result().files] == [len(row) for row in rows]
    for file, row in zip(files, rows, strict=True):
        assert sum(account(file).recorded.values()) == len(row)


def test_only_the_newest_files_are_kept(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recording(router, path, keys=["few/**"], split_seconds=3600, max_files=2) as service, client(router) as sender:
        for number in range(4):
            put(sender, "few/x", number)
            assert has(service, number + 1)
            service.split()
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a-4.mcap", "a-5.mcap"]
    assert numbers(tmp_path / "a-4.mcap", "few/x") == [3]


def test_a_ring_writes_the_last_seconds_on_command_and_when_a_message_is_so(router: str, tmp_path: Path) -> None:
    said: list[str] = []
    more: dict[str, Any] = {
        "keys": ["ring/**"],
        "ring_seconds": 60.0,
        "dump_on": ["ring/* where v > 10"],
        "types": ["ring/*=json"],
        "output": None,
        "folder": tmp_path,
        "warnings": said,
    }
    output = more.pop("output")
    with recording(router, output, **more) as service, client(router) as sender:
        with pytest.raises(ConfigError, match="nothing has been recorded"):
            service.dump()
        with pytest.raises(ConfigError, match="no file to be split"):
            service.split()
        for value in (1, 2):
            sender.put(Message(0, "ring/a", b'{"v": %d}' % value, qos=BLOCK, attachment=b"x"))
        assert has(service, 2)
        first = service.dump("first.mcap")
        for value in (11, 12, 3):
            sender.put(Message(0, "ring/a", b'{"v": %d}' % value, qos=BLOCK))
        assert wait_until(lambda: len(said) == 1, 60)
    second = Path(said[0].split("wrote ")[1])
    assert [each.payload for each in read_log(first)] == [b'{"v": 1}', b'{"v": 2}']
    assert [each.attachment for each in read_log(first)] == [b"x", b"x"]
    assert {b'{"v": 1}', b'{"v": 11}'} <= {each.payload for each in read_log(second)}
    with first.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert [channel.topic for _, channel, _ in reader.iter_messages()] == ["ring/a", "ring/a"]
    assert dict(account(first).recorded) == {"ring/a": 2}
    with LogReader(first) as log:
        assert log.metadata["seed"] == "0"
        assert not log.loss


def test_a_ring_forgets_what_is_old(router: str, tmp_path: Path) -> None:
    options: dict[str, Any] = {"keys": ["old/**"], "ring_seconds": 0.2, "folder": tmp_path}
    with recording(router, None, **options) as service, client(router) as sender:
        put(sender, "old/x", 0)
        assert has(service, 1)
        found, following = [0], iter(range(1, 10_000))

        def gone() -> bool:
            nonlocal found
            put(sender, "old/x", next(following))
            found = numbers(service.dump(), "old/x")
            return 0 not in found

        assert wait_until(gone, 60, interval=0.02)
    assert found == list(range(found[0], found[-1] + 1))


def test_gaps_in_the_numbers_of_publishers_are_counted(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"

    def attachment(number: int, gid: int) -> bytes:
        return struct.pack("<qqB16s", number, 10**18 + number, 16, bytes([gid]) * 16)

    with recording(router, path, keys=["/chatter"]) as service, client(router) as sender:
        for number, gid in ((5, 1), (6, 1), (10, 1), (1, 2), (2, 2), (8, 1)):
            sender.put(Message(0, CHATTER, text(str(number)), attachment=attachment(number, gid), qos=BLOCK))
        assert has(service, 6)
    assert service.result().account.lost == {"missed": {"/chatter": 2}}
    assert not service.result()
    assert account(path).lost == {"missed": {"/chatter": 2}}
    found = list(read_log(path))
    assert [each.sequence for each in found] == [5, 6, 10, 1, 2, 8]
    assert found[0].publish_time == 10**18 + 5


def test_a_full_disk_is_said_at_once_counted_and_survived(
    router: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, said = tmp_path / "a.mcap", list[str]()

    def full(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    options: dict[str, Any] = {"keys": ["full/**"], "chunk_seconds": 0.05, "warnings": said}
    with recording(router, path, **options) as service, client(router) as sender:
        put(sender, "full/x", 1)
        assert wait_until(lambda: numbers(path, "full/x") == [1], 60)
        with monkeypatch.context() as patch:
            patch.setattr(McapFile, "packed", full)
            put(sender, "full/x", 2, 3)
            assert wait_until(lambda: service.status()["lost"] == 2, 60)
            assert "No space left on device" in service.status()["problem"]
            assert [each for each in said if "ALARM" in each and "No space left" in each]
        put(sender, "full/x", 4)
        assert wait_until(lambda: service.status()["problem"] == "", 60)
        assert wait_until(lambda: any("again" in each for each in said), 60)
    assert numbers(path, "full/x") == [1, 4]
    assert service.result().account.lost == {"disk": {"full/x": 2}}
    assert dict(service.result().account.recorded) == {"full/x": 2}
    assert account(path).lost == {"disk": {"full/x": 2}}


def test_a_removed_file_is_said_counted_and_followed_by_another(router: str, tmp_path: Path) -> None:
    folder, said = tmp_path / "logs", list[str]()
    folder.mkdir()
    with recording(router, folder / "a.mcap", keys=["gone/**"], warnings=said) as service, client(router) as sender:
        put(sender, "gone/x", 1, 2)
        assert has(service, 2)
        shutil.rmtree(folder)
        assert wait_until(lambda: service.status()["lost"] == 2, 60)
        assert any("ALARM" in each and "the file was removed" in each for each in said)
        folder.mkdir()
        assert wait_until(lambda: service.status()["problem"] == "", 60)
        put(sender, "gone/x", 3)
        assert has(service, 1)
    assert numbers(folder / "a-2.mcap", "gone/x") == [3]
    assert service.result().account.lost == {"disk": {"gone/x": 2}}


def test_what_publishers_keep_for_late_joiners_is_recorded_once(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with Puppet(router) as source, client(router) as early:
        fence: list[Message] = []
        early.subscribe("fence", fence.append)
        source.do("publish_advanced", key="late/x", payloads=["1", "2", "3"], depth=2)

        def has_passed() -> bool:
            source.do("flood", key="fence", count=1, padding=1)
            return bool(fence)

        assert wait_until(has_passed, 60, interval=0.05)  # and so have the others: they shall not come while we listen
        with recording(router, path, keys=["late/**"]) as service:
            assert has(service, 2)
            source.do("publish_advanced", key="late/x", payloads=["4"], depth=2)
            assert has(service, 3)
    assert numbers(path, "late/x") == [2, 3, 4]


def test_the_graph_is_in_the_log_and_in_each_of_its_parts(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with recording(router, path, keys=["graph/**"], graph=True) as service, client(router) as sender:
        put(sender, "graph/x", 1)
        assert has(service, 1)
        for file in (path, tmp_path / "a-2.mcap"):

            def known(file: Path = file) -> bool:
                with LogReader(file) as reader:
                    graphs = [graph for _, graph in replay(reader.notes("riot_bus.graph"))]
                return any(topic.key == "graph/x" for graph in graphs for topic in graph.topics)

            if file != path:
                service.split()
            assert wait_until(known, 60, interval=0.05)


def test_a_running_recorder_is_controlled_from_afar(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    options: dict[str, Any] = {"keys": ["ctl/**"], "control": True, "name": "rec-a"}
    with (
        recording(router, path, **options) as service,
        Remote(router, kind="recorder") as remote,
        client(router) as sender,
    ):
        assert remote.find() == ["rec-a"]
        assert remote.ask("record/pause")["state"] == "paused"
        put(sender, "ctl/x", 1)
        assert wait_until(lambda: remote.ask("record/status")["left_out"] == {"paused": 1}, 60)
        assert remote.ask("record/start")["state"] == "recording"
        with pytest.raises(ConfigError, match="is recording already"):
            remote.ask("record/start")
        with pytest.raises(ConfigError, match="no ring"):
            remote.ask("record/dump")
        for bad in ("../x.mcap", "/etc/x.mcap", "a.txt", "no/a.mcap"):
            with pytest.raises(ConfigError):
                remote.ask("record/split", json.dumps({"path": bad}).encode())
        put(sender, "ctl/x", 2)
        assert has(service, 1)
        answer = remote.ask("record/split", b'{"path": "b.mcap"}')
        assert answer == {"former": str(path), "file": str(tmp_path / "b.mcap")}
        remote.ask("record/stop")
        assert service.wait(20)
    assert numbers(path, "ctl/x") == [2]


def test_a_peer_can_be_recorded_without_any_router(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with ZenohProcess("peer") as peer, recording(peer.locators[0], path, keys=["peer/**"]) as service:
        peer.do("put", "peer/x", "1")
        assert has(service, 1)
    assert numbers(path, "peer/x") == [1]


def test_a_link_that_breaks_is_said_and_is_no_clean_end(tmp_path: Path) -> None:
    said: list[str] = []
    process = ZenohProcess("router")
    with recording(process.locators[0], tmp_path / "a.mcap", keys=["x"], warnings=said) as service:
        process.close()
        assert wait_until(lambda: any("the link to" in each for each in said), 60)
        assert not service.status()["connected"]
    assert not service.result()


def test_existing_files_are_not_overwritten(router: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(ConfigError, match="exists already"), recording(router, path):
        pass
    assert path.read_bytes() == b"precious"
    with recording(router, path, overwrite=True):
        pass
    assert read_log(path) == ()


def test_many_sessions_publish_while_files_are_split(router: str, tmp_path: Path) -> None:
    count, senders = 1000, 4

    def send(number: int) -> None:
        with client(router) as sender:
            put(sender, f"many/{number}", *range(count))

    with recording(router, tmp_path / "a.mcap", keys=["many/*"]) as service:
        threads = [threading.Thread(target=send, args=(number,)) for number in range(senders)]
        for thread in threads:
            thread.start()
        for _ in range(3):
            service.split()
        for thread in threads:
            thread.join()
        assert has(service, count * senders)
    files = [Path(each.path) for each in service.result().files]
    for number in range(senders):
        assert [value for file in files for value in numbers(file, f"many/{number}")] == list(range(count))
