"""One segment of a bridge, on a bus that is a list."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from riot_bus_bridges.host.outer_port import put_one_by_one
from riot_bus_bridges.links.end import End
from riot_bus_bridges.mavlink.routing import Routes
from riot_bus_bridges.mavlink.sequences import OwnStreams
from riot_bus_bridges.mavlink.side import INSERTED, Side, is_mark, new_mark
from riot_bus_bridges.mavlink.url import parse_link
from riot_bus_mavlink.frame import ENCODING, Framer, StreamCounts, parse_frame
from riot_bus_mavlink.keys import KeyTemplate
from riot_bus_mavlink.signing import Signer
from tests.unit.riot_bus_bridges.mavlink.frames import COMMON, frame_of, unknown_frame
from tests.unit.riot_bus_mavlink.signed_frames import sign_frame

MARK = new_mark()
SIGNER = Signer(bytes(32))


class Outlet:
    def __init__(self, port: Port, key: str) -> None:
        self._port, self._key = port, key

    def put(self, payload: bytes, attachment: bytes) -> None:
        self._port.puts.append((self._key, payload, attachment))

    def matched(self) -> bool:
        return False

    def close(self) -> None:
        self._port.closed.append(self._key)


class Inlet:
    def close(self) -> None:
        pass


class Port:
    """A segment that keeps what is published."""

    endpoint = "here"

    def __init__(self) -> None:
        self.puts: list[tuple[str, bytes, bytes]] = []
        self.closed: list[str] = []
        self.expressions: list[str] = []

    def publisher(
        self, key: str, *, reliable: bool, changed: Callable[[], None] | None = None, encoding: str = ""
    ) -> Outlet:
        assert (reliable, encoding) == (True, ENCODING)
        return Outlet(self, key)

    def put_all(self, outlets: Sequence[Any], payloads: Sequence[bytes], attachment: bytes) -> int:
        return put_one_by_one(outlets, payloads, attachment)

    def subscribe(self, key: str, take: object) -> Inlet:
        self.expressions.append(key)
        return Inlet()

    collect = subscribe


class Bench:
    """A side with ends that keep what they get."""

    def __init__(self, *names: str, signer: Signer | None = None) -> None:
        self.port = Port()
        routes: Routes[End] = Routes(COMMON.targets)
        self.side = Side(
            self.port,
            routes,
            keys=KeyTemplate(),
            name_of=COMMON.name_of,
            mark=MARK,
            streams=OwnStreams(COMMON.crc_extra, signer),
            linked=routes.knows,
            signer=signer,
        )
        self.got: dict[str, list[bytes]] = {name: [] for name in names}
        self.ends = {name: self._end(name) for name in names}
        for end in self.ends.values():
            routes.add(end)
        self.side.open()

    def _end(self, name: str) -> End:
        def write(data: bytes) -> bool:
            self.got[name].append(data)
            return True

        return End(parse_link(f"/{name}=udpin:1"), "", Framer(COMMON.crc_extra), write)


def test_what_comes_over_a_link_goes_to_the_others_and_to_the_bus() -> None:
    bench = Bench("a", "b")
    frames = [frame_of(sequence=1), unknown_frame(sequence=3)]
    bench.side.receive_frames(bench.ends["a"], frames)
    assert bench.got == {"a": [], "b": [each.raw for each in frames]}
    assert bench.port.puts == [
        ("mavlink_raw/a/1/1/HEARTBEAT", frames[0].raw, MARK),
        ("mavlink_raw/a/1/1/UNKNOWN_15000000", frames[1].raw, MARK),
    ]
    assert bench.port.expressions == ["mavlink_raw/*/*/*/*"]
    assert bench.ends["a"].losses.counts()[1, 1].lost == 1
    assert bench.side.counts == {"to_bus": 2}
    bench.side.close()
    assert sorted(bench.port.closed) == sorted(key for key, _, _ in bench.port.puts)


def test_what_is_known_of_frames_changes_with_the_links() -> None:
    bench = Bench("a", "b")
    side, end = bench.side, bench.ends["a"]
    raws = [frame_of(sequence=sequence).raw for sequence in range(6)]
    known = end.framer.known
    assert known(raws, 0, side._flows(end)) == []
    side.receive(end, raws[:2])  # the first one makes the source known, the second one where such frames go
    assert len(known(raws, 2, side._flows(end))) == 4
    assert known([raws[4][:-1] + b"?"], 0, side._flows(end)) == []
    assert known([raws[4] + raws[5]], 0, side._flows(end)) == []
    end.framer.counts = StreamCounts(2, bytes=2 * len(raws[0]), frame_bytes=2 * len(raws[0]))
    side.receive(end, raws[2:4])
    late = bench.ends["c"] = bench._end("c")
    bench.got["c"] = []
    side.routes.add(late)
    assert known(raws, 4, side._flows(end)) == []
    side.receive(end, raws[4:])
    assert bench.got == {"a": [], "b": raws, "c": raws[4:]}
    assert [payload for _, payload, _ in bench.port.puts] == raws
    assert end.counts == {"in": 6}
    assert side.counts == {"to_bus": 6}
    assert (end.losses.counts()[1, 1].received, end.losses.counts()[1, 1].lost) == (6, 0)
    assert (end.framer.counts.frames, end.framer.counts.bytes) == (6, sum(map(len, raws)))


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 6), st.integers(1, 3), st.booleans()), max_size=40))
def test_it_makes_no_difference_what_is_known_or_comes_at_once(steps: list[tuple[int, int, int, bool]]) -> None:
    """Frames of some sources over some links, some for a target, some broken: as if each was the first of its kind."""
    one, other = Bench("a", "b", "c"), Bench("a", "b", "c")
    waiting: list[tuple[str, bytes]] = []
    for number, (link, kind, system, last) in enumerate(steps):
        target = (kind, 1) if 3 <= kind < 6 else None
        name = "COMMAND_LONG" if target else ("HEARTBEAT", "ATTITUDE", "SYSTEM_TIME")[kind % 3]
        raw = frame_of(name, source=(system, 1), target=target, sequence=number, version=1 if kind == 1 else 2).raw
        waiting.append(("abc"[link], raw[:-1] + b"?" if kind == 6 else raw))
        if not last and number + 1 < len(steps):
            continue
        for place, packets in _runs(waiting):
            one.side.receive(one.ends[place], packets)
        one.side.deliver([(packet, MARK) for _, packet in waiting])
        for place, packet in waiting:
            _forget(other)
            other.side.receive(other.ends[place], [packet])
        for _, packet in waiting:
            _forget(other)
            other.side.deliver([(packet, MARK)])
        waiting = []
    assert one.got == other.got
    assert one.port.puts == other.port.puts
    assert one.side.counts == other.side.counts
    for place in "abc":
        mine, its = one.ends[place], other.ends[place]
        assert (mine.counts, mine.losses.counts(), mine.framer.counts) == (
            its.counts,
            its.losses.counts(),
            its.framer.counts,
        )


def _forget(bench: Bench) -> None:
    bench.side._deliveries.clear()
    for end in bench.ends.values():
        end.flows.clear()


def _runs(packets: list[tuple[str, bytes]]) -> list[tuple[str, list[bytes]]]:
    """Return packets of one link in a row together."""
    return [(place, [raw for _, raw in run]) for place, run in itertools.groupby(packets, key=lambda each: each[0])]


def test_what_comes_from_the_bus_goes_where_it_is_wanted() -> None:
    bench = Bench("a", "b")
    bench.side.receive_frames(bench.ends["b"], [frame_of(source=(9, 9))])
    bench.got = {"a": [], "b": []}
    heartbeat = frame_of(source=(1, 1), sequence=5)
    bench.side.deliver([(heartbeat.raw, None)])
    command = frame_of("COMMAND_LONG", source=(1, 1), target=(9, 9))
    bench.side.deliver([(command.raw, b"something")])
    nobody = frame_of("COMMAND_LONG", source=(1, 1), target=(8, 8))
    bench.side.deliver([(nobody.raw, None)])
    assert bench.got == {"a": [heartbeat.raw], "b": [heartbeat.raw, command.raw]}
    assert bench.side.counts == {"to_bus": 1, "from_bus": 3, "unrouted": 1}


def test_inserted_frames_are_numbered_on_their_own_and_others_are_not() -> None:
    bench = Bench("a", "b")
    bench.side.receive_frames(bench.ends["a"], [frame_of(source=(1, 1), sequence=50)])
    bench.got = {"a": [], "b": []}
    frame = frame_of(source=(1, 1), sequence=51)
    for mark in (None, b"x", MARK, new_mark(), INSERTED):
        bench.side.deliver([(frame.raw, mark)])
    # Nobody else was seen as 2/2, so it is no insertion: numbers of sources are never changed.
    bench.side.deliver([(frame_of(source=(2, 2), sequence=7).raw, None)])
    assert [parse_frame(raw).sequence for raw in bench.got["b"]] == [0, 1, 51, 51, 51, 7]
    assert [parse_frame(raw).sequence for raw in bench.got["a"]] == [0, 1, 51, 51, 7]  # not what came from there
    assert bench.side.counts["inserted"] == 2


def test_what_was_broken_on_purpose_goes_on_as_it_is() -> None:
    bench = Bench("a", "b")
    raw = frame_of(source=(1, 1)).raw
    wrong_sum = raw[:-1] + bytes([raw[-1] ^ 255])
    for payload in (wrong_sum, raw[:-3], b"x" * 280, b"", b"x" * 281, b"x" * 100_000):
        bench.side.deliver([(payload, MARK)])
    assert bench.got["a"] == bench.got["b"] == [wrong_sum, raw[:-3], b"x" * 280]
    assert bench.side.counts == {"from_bus": 6, "unrouted": 0, "broken": 2, "refused": 3}


def test_frames_of_a_bridge_s_own_are_inserted_everywhere() -> None:
    bench = Bench("a")
    frame = frame_of(source=(255, 1), sequence=3)
    bench.side.insert(frame, "json")
    assert bench.got == {"a": [frame.raw]}
    assert bench.port.puts == [("mavlink_raw/json/255/1/HEARTBEAT", frame.raw, INSERTED)]
    assert is_mark(INSERTED)
    assert not is_mark(None)


def test_signed_frames_that_come_again_get_a_later_time_with_the_key() -> None:
    bench, keyless = Bench("a", signer=SIGNER), Bench("a")
    extra = COMMON.crc_extra(0)
    assert extra is not None
    signed = sign_frame(frame_of(source=(1, 1)).raw, SIGNER, extra, link=1, time=100)
    for each in (bench, keyless):
        for _ in range(3):
            each.side.deliver([(signed, MARK)])
    assert keyless.got["a"] == [signed] * 3
    frames = [parse_frame(raw) for raw in bench.got["a"]]
    assert frames[0].raw == signed
    assert all(map(SIGNER.made, bench.got["a"]))
    assert len({frame.raw[-13:-6] for frame in frames}) == 3


def test_outlets_are_bounded() -> None:
    bench = Bench("a")
    for system in range(1, 18):
        for component in range(256):
            bench.side.receive_frames(bench.ends["a"], [frame_of(source=(system, component))])
    assert len(bench.port.puts) == 17 * 256
    assert bench.port.closed == [key for key, _, _ in bench.port.puts[:256]]


@given(st.lists(st.tuples(st.binary(max_size=300), st.one_of(st.none(), st.binary(max_size=24), st.just(MARK)))))
def test_any_bytes_on_the_bus_are_counted(payloads: list[tuple[bytes, bytes | None]]) -> None:
    bench = Bench("a")
    for payload, attachment in payloads:
        bench.side.deliver([(payload, attachment)])
    counts = bench.side.counts
    assert counts["from_bus"] == len(payloads)
    assert len(bench.got["a"]) == len(payloads) - counts["refused"] - counts["unrouted"]
