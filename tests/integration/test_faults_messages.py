"""What messages can do to the router: payloads that do not decode, hostile keys, and far too many keys."""

from __future__ import annotations

import gc
import json
import signal
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from riot_bus.control.heap import trim_heap
from riot_bus.control.remote import Remote
from riot_bus.control.status import count_rows, loss_rows
from riot_bus.inject.interceptor import Injector
from riot_bus.pipeline.runner import MOST_TOPICS, OTHER_TOPICS
from riot_bus.router.bus import Bus
from riot_bus.types.registry import TypeRegistry, load_adapters
from riot_bus.vocabulary.errors import RiotError
from riot_bus.vocabulary.injection import Injection
from riot_bus.zenoh.session import wait_until
from tests.integration.bus_puppet import Puppet
from tests.integration.fault_tools import (
    MIB,
    SEGMENTS,
    assert_balanced,
    assert_rows_balance,
    crosses,
    pipeline,
    rss,
    subscribed,
)
from tests.integration.router_process import RouterProcess, riot

pytestmark = pytest.mark.integration

CDR = b"\x00\x01\x00\x00"


def scan(angle: float, *ranges: float) -> bytes:
    """A sensor_msgs/msg/LaserScan; what is beyond its `frame_id` cannot be found without decoding that."""
    return CDR + struct.pack(f"<iII4x7fI{len(ranges)}fI", 0, 0, 1, angle, *[0.0] * 6, len(ranges), *ranges, 0)


MALFORMED = {
    "nothing": b"",
    "one byte": b"\x00",
    "noise": bytes(range(255, 55, -1)),
    "text": "é\u2028\U0001f916".encode(),
    "json, cut off": b'{"v": 1, "x": [1, 2',
    "json, no comma": b'{"v": 1 "x": 2}',
    "json, deep": b'{"v":' + b"[" * 50_000 + b"]" * 50_000 + b"}",
    "json, deep objects": b'{"v":' * 20_000 + b"1" + b"}" * 20_000,
    "json, other kinds": b'{"v": {"v": []}, "ranges": {}, "data": null}',
    "json, a long number": b'{"w": ' + b"9" * 20_000 + b"}",
    "utf-16": "{".encode("utf-16"),
    "msgpack, many entries": b"\x81\xa1v\xdd\xff\xff\xff\xff",
    "msgpack, large map": b"\xdf\xff\xff\xff\xff",
    "msgpack, long bytes": b"\xc6\xff\xff\xff\xff",
    "msgpack, long text": b"\x81\xa1v\xdb\xff\xff\xff\xff",
    "msgpack, long extension": b"\x81\xa1v\xc9\xff\xff\xff\xff\x01",
    "msgpack, deep": b"\x91" * 20_000 + b"\x00",
    "msgpack, deep maps": b"\x81\xa1v" * 500 + b"\xc0",
    "msgpack, reserved": b"\xc1",
    "cbor, many elements": b"\xa1\x61v\x9b" + b"\xff" * 8,
    "cbor, long text": b"\xa1\x61v\x7b" + b"\xff" * 8,
    "cbor, no break": b"\x9f" * 20_000,
    "cbor, tags": b"\xc1" * 20_000,
    "cdr, cut off": CDR,
    "cdr, long array": CDR + b"\xff" * 8,
    "cdr, negative lengths": CDR + b"\xff" * 400,
    "cdr, unknown header": b"\x77\x77\x00\x00" + bytes(100),
}
TYPES = {  # key: declared type, encoding, field, a sound payload and what the injection makes of it
    "j": ("json", "", "v", b'{"v": 1}', b'{"v": 99}'),
    "je": (None, "application/json", "v", b'{"v": 1}', b'{"v": 99}'),
    "ja": ("json", "", "v[*]", b'{"v": [1, 2]}', b'{"v": [99, 99]}'),
    "m": ("msgpack", "", "v", b"\x81\xa1v\x01", b"\x81\xa1v\x63"),
    "me": (None, "application/msgpack", "v", b"\x81\xa1v\x01", b"\x81\xa1v\x63"),
    "ma": ("msgpack", "", "v[*]", b"\x81\xa1v\x92\x01\x02", b"\x81\xa1v\x92\x63\x63"),
    "b": ("cbor", "", "v", b"\xa1\x61v\x01", b"\xa1\x61v\x18\x63"),
    "be": (None, "application/cbor", "v", b"\xa1\x61v\x01", b"\xa1\x61v\x18\x63"),
    "ba": ("cbor", "", "v[*]", b"\xa1\x61v\x82\x01\x02", b"\xa1\x61v\x82\x18\x63\x18\x63"),
    "raw": (None, "", "v", b'{"v": 1}', b'{"v": 99}'),  # inferred
    "c": ("sensor_msgs/msg/LaserScan", "", "angle_min", scan(1, 2, 3), scan(99, 2, 3)),
    "ce": ("sensor_msgs/msg/LaserScan", "", "ranges[1]", scan(1, 2, 3), scan(1, 2, 99)),
    "ca": ("sensor_msgs/msg/LaserScan", "", "ranges[*]", scan(1, 2, 3), scan(1, 99, 99)),
}


@pytest.mark.parametrize("provenance", [True, False], ids=["noted", "quick"])
def test_payloads_that_do_not_decode_pass_as_they_are_and_sound_ones_are_still_changed(provenance: bool) -> None:
    declared = {f"cut/{name}": each[0] for name, each in TYPES.items() if each[0] is not None}
    registry = TypeRegistry(load_adapters(), declared=declared)
    injectors = {name: Injector([Injection(f"cut/{name}", each[2], 99)]) for name, each in TYPES.items()}
    interceptors = pipeline(*injectors.values(), registry=registry)
    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=interceptors, registry=registry) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        interceptors.provenance = provenance
        sink.do("subscribe", key="cut/**")
        subscribed(bus, "unit", "cut/x")
        expected: list[tuple[str, bytes]] = []
        for name, (_, encoding, _, sound, changed) in TYPES.items():
            for sent, arrives in [(sound, changed), *((each, each) for each in MALFORMED.values()), (sound, changed)]:
                more = {"encoding": encoding} if encoding else {}
                source.do("put", key=f"cut/{name}", payload=sent.hex(), congestion="BLOCK", **more)
                expected.append((f"cut/{name}", arrives))
        samples = sink.do("wait", count=len(expected), timeout=60)
        assert [(each["key"], bytes.fromhex(each["payload"])) for each in samples] == expected
        assert bus.drain(60)
        for name, injector in injectors.items():
            hits, skipped = injector.hits.total(), injector.skipped[f"cut/{name}"]
            assert hits + skipped == len(MALFORMED) + 2, name
            if "[*]" not in TYPES[name][2]:  # none of no elements is lacking
                assert hits == 2, name
            assert list(injector.problems) == [f"cut/{name}"]
        assert not interceptors.errors
        assert not bus.losses
        assert_balanced(bus)


KEYS = {  # key: whether cut/** includes it; a chunk that begins with @ is included by no wildcard
    "cut": True,
    "cut/" + "x" * 30_000: True,
    "cut/" + "/".join("abcdefgh" * 200): True,
    "cut/ä/ü/日本語/\U0001f916": True,
    "cut/e\u0301": True,  # two spellings of one letter stay two keys
    "cut/\u00e9": True,
    "cut/\u202egnp.exe": True,
    "cut/\x1b[2J\x07\r\n": True,
    "cut/a b\tc": True,
    "cut/..%2f../{}'\"\\;`": True,
    "cut/(other topics)": True,
    "(other topics)": False,
    "cut/riot": True,
    "cut/@riot/status": False,
    "@cut/x": False,
    "cut/@/x": False,
    "cut/@adv/pub/1/2/_": False,
    "cut/x/@adv/sub/1/2/_": False,
    "free/@ros2_lv/0/x": False,
    "cutx": False,
    "@riot/lab/nonsense": False,
}
NEVER = {"@riot/lab/nonsense", "cut/@adv/pub/1/2/_", "cut/x/@adv/sub/1/2/_"}  # caches end at the cut
WILD = ["cut/*", "cut/**", "**", "*/x", "c$*t/x"]


def test_hostile_keys_pass_or_are_intercepted_as_their_expressions_say(tmp_path: Path) -> None:
    log = tmp_path / "a.mcap"
    with RouterProcess("--intercept=cut/**", "--name=lab", f"--record={log}") as router:
        with Puppet(router.endpoints["system"]) as source, Puppet(router.endpoints["unit"]) as sink:
            wanted = [key for key in KEYS if key not in NEVER]
            for key in ["**", *(key for key in wanted if "@" in key)]:
                sink.do("subscribe", key=key)
            for key in ("cut/route", "free/route"):
                assert crosses(source, sink, key, "there")
            for key in wanted:
                if "@" in key:
                    assert crosses(source, sink, key, "there"), key
            for key in KEYS:
                source.do("put_texts", key=key, payloads=["once"], congestion="BLOCK")
            for key in WILD:  # a publication to many keys at once; whatever becomes of it, it must not kill a lane
                source.do("put_texts", key=key, payloads=["wild"], congestion="BLOCK")
            assert crosses(source, sink, "cut/route", "still there")

            def arrived() -> list[str]:
                samples = sink.do("wait", count=0)
                return [each["key"] for each in samples if bytes.fromhex(each["payload"]) == b"once"]

            assert wait_until(lambda: set(arrived()) >= set(wanted), 60), set(wanted) - set(arrived())
            assert sorted(arrived()) == sorted(wanted)  # once each
            with Remote(router.endpoints["unit"]) as remote:
                status = remote.ask("status")
                counts = status["counts"]
                assert_rows_balance({topic: {**row, "balanced": 0} for topic, row in counts.items()})
                for key, included in KEYS.items():
                    assert (counts.get(key, {}).get("received", 0) > 0) == included, key
                assert (status["losses"]["messages"], status["losses"]["recordings"]) == (0, 0)
                for command in ("", "\x00", "nonsense", "@", "x" * 2000, "a//b"):
                    with pytest.raises(RiotError):
                        remote.ask(command, timeout=5)
                assert remote.ask("status")["intercepted"] == ["cut/**"]
            code, text, _ = riot("ctl", "status", f"--endpoint={router.endpoints['unit']}")
            assert (code, "\x1b" in text, "\x07" in text, "\u202e" in text) == (0, False, False, False)
        code, out, err = router.end(signal.SIGTERM)
    assert (code, "Traceback" in err, "panicked" in err) == (0, False, False), err
    assert ("\x1b" in out, "\x07" in out, "\u202e" in out) == (False, False, False)


@pytest.fixture
def no_collector() -> Iterator[None]:
    gc.disable()
    yield
    gc.enable()


@pytest.mark.load
@pytest.mark.usefixtures("no_collector")
def test_a_hundred_thousand_keys_take_bounded_memory_and_are_all_counted() -> None:
    """All that is kept by key is full after the first part; the second must not take more."""
    first, count = 70_000, 100_000
    assert first > MOST_TOPICS
    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Looks())) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        sink.do("subscribe_numbers", key="cut/**")
        subscribed(bus, "unit", "cut/x")
        sizes, garbage = [], []
        for begin, end in ((0, first), (first, count)):
            gc.collect()
            source.do("flood_keys", key="cut", first=begin, count=end - begin, congestion="BLOCK")
            assert sink.do("wait_numbers", count=end, timeout=240)["count"] == end
            assert bus.drain(60)
            garbage.append(gc.collect())
            trim_heap()
            sizes.append(rss())
        counts = bus.counts()
        assert len(counts) == MOST_TOPICS + 1
        assert counts[OTHER_TOPICS].received == count - MOST_TOPICS
        assert sum(each.forwarded for each in counts.values()) == count
        assert_balanced(bus)
        rows = count_rows(counts)
        assert sum(row["received"] for row in rows.values()) == count
        assert len(json.dumps({"counts": rows, "losses": loss_rows(bus.losses)})) < MIB
        assert sizes[1] - sizes[0] < 40 * MIB, [size // MIB for size in sizes]
        assert max(garbage) < 1000, "what is kept by key is freed only when the collector comes"
        assert not bus.losses


class Looks:
    def message(self, event: object) -> None:
        """Look, so that the pipeline has a route for each key."""


@pytest.mark.load
@pytest.mark.parametrize("looks", [False, True])
def test_a_flood_of_large_messages_takes_bounded_memory_and_all_arrive_in_order(tmp_path: Path, looks: bool) -> None:
    """Back-pressure begins at 32 MiB; 300 messages of 1 MiB took 300 to 500 MiB as long as 256 could wait."""
    (tmp_path / "look.py").write_text("class Look:\n    def message(self, event):\n        event.payload\n")
    more = ["--interceptor", f"{tmp_path}/look.py:Look"] if looks else []
    with (
        RouterProcess("--intercept", "cut/**", *more) as router,
        Puppet(router.endpoints["system"]) as source,
        Puppet(router.endpoints["unit"]) as sink,
    ):
        sink.do("subscribe_by_key", key="cut/x")
        sink.do("subscribe", key="cut/probe")
        assert wait_until(lambda: crossed_once(source, sink), 60, interval=0.02)
        process = psutil.Process(router.process.pid)
        before, sizes, count = process.memory_info().rss, [0], 300
        source.start("flood", key="cut/x", count=count, padding=MIB)

        def arrived() -> bool:
            sizes.append(process.memory_info().rss)
            return int(sink.do("by_key").get("cut/x", {}).get("count", 0)) == count

        assert wait_until(arrived, 120, interval=0.02)
        found = sink.do("by_key")["cut/x"]
        assert (found["different"], found["ordered"]) == (count, True)
        assert max(sizes) - before < 128 * MIB, [size // MIB for size in (before, max(sizes))]


def crossed_once(source: Puppet, sink: Puppet) -> bool:
    source.do("put_texts", key="cut/probe", payloads=["probe"], congestion="BLOCK")
    return bool(sink.do("wait", count=1, timeout=0.02))


@pytest.mark.load
def test_large_droppable_messages_in_front_of_an_interceptor_that_blocks_are_counted_when_they_are_dropped() -> None:
    go_on = threading.Event()

    class Blocks:
        def message(self, event: object) -> None:
            assert go_on.wait(120)

    with (
        Bus(SEGMENTS, intercept=["cut/**"], pipeline=pipeline(Blocks()), budget_s=120) as bus,
        Puppet(bus.endpoint("system")) as source,
        Puppet(bus.endpoint("unit")) as sink,
    ):
        sink.do("subscribe_by_key", key="cut/x")
        subscribed(bus, "unit", "cut/x")

        def dropped() -> bool:
            source.do("flood", key="cut/x", count=20, padding=MIB, congestion="DROP")
            return bus.losses.messages.get("cut/x", 0) > 20

        assert wait_until(dropped, 120)
        go_on.set()
        assert bus.drain(60)
        assert_balanced(bus)
        counts = bus.counts()["cut/x"]
        assert counts.received == counts.forwarded + counts.lost
