from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from riot_bus.interceptors.recorder import Recorder
from riot_bus.log.reader import read_log
from riot_bus.log.writer import LogWriter
from riot_bus.router.bus import Bus
from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.libraries import library_of
from riot_bus.zenoh.network import Network
from riot_bus.zenoh.session import release, wait_until
from riot_bus.zenoh.sockets import _ends, hang_up
from tests.integration.bus_puppet import Puppet

pytestmark = pytest.mark.integration

SEGMENTS = {"a": (), "b": (), "c": ()}


def linked(bus: Bus) -> set[tuple[str, str]]:
    """Return the pairs of segments whose routers have a link."""
    names = {bus.segment(name).zid: name for name in SEGMENTS}
    return {(name, names[peer]) for name in SEGMENTS for peer in bus.segment(name).peers() & names.keys()}


@contextmanager
def components(bus: Bus) -> Iterator[list[Puppet]]:
    """Yield a component in each segment, subscribed to everything."""
    with ExitStack() as stack:
        puppets = [stack.enter_context(Puppet(bus.endpoint(name))) for name in SEGMENTS]
        for name, puppet in zip(SEGMENTS, puppets, strict=True):
            puppet.do("subscribe", key="**")
            puppet.do("subscribe", key=f"@last/{name}")  # which `**` does not include
        everybody_knows(bus)
        yield puppets


def everybody_knows(bus: Bus) -> None:
    """Wait until each segment knows what the components of all others have subscribed to."""
    for name in SEGMENTS:
        others = [f"@last/{other}" for other in SEGMENTS if other != name]
        assert bus.wait_subscribed(name, others, timeout=60) == []


def linked_to(network: Network, zid: str) -> set[str]:
    """Return the segments that have a link to a router."""
    return {name for name, segment in network.segments.items() if zid in segment.peers()}


EVERY = {(one, other) for one in SEGMENTS for other in SEGMENTS if one != other}


@pytest.mark.parametrize("place", range(len(SEGMENTS)))
def test_segments_are_linked_until_something_else_is_cut(place: int) -> None:
    with Bus(SEGMENTS, intercept=["cut/**"]) as bus, components(bus) as sinks:
        source = sinks.pop(place)  # each end of a link guards what comes in
        before = len(os.listdir("/dev/fd"))
        assert bus.segment("a").endpoints == (bus.endpoint("a"),)  # the sockets of the links are no place for others
        assert linked(bus) == EVERY
        for number, cut in enumerate(("cut/**", "other/**", "cut/**")):
            bus.set_intercept([cut])
            assert linked(bus) == (EVERY if number == 0 else set())
            everybody_knows(bus)
            for key in ("free/x", "cut/x"):
                source.do("put_texts", key=key, payloads=[str(number)] * 2, congestion="BLOCK")
            for sink in sinks:
                seen = [(each["key"], bytes.fromhex(each["payload"])) for each in sink.do("wait", count=4 * number + 4)]
                expected = sorted([b"0", b"1", b"2"][: number + 1] * 2)
                for key in ("free/x", "cut/x"):
                    assert [text for where, text in seen if where == key] == expected
        assert bus.counts()["cut/x"].forwarded == 4
        assert not bus.losses
        assert len(os.listdir("/dev/fd")) <= before


def test_when_a_link_breaks_that_is_reported_and_the_junction_takes_over() -> None:
    with Bus(SEGMENTS) as bus:
        direct = bus._network.direct
        assert direct is not None
        sockets = [each.split("/", 1)[1] for name in SEGMENTS for each in direct.listen(name)]
        hang_up(set(sockets))
        assert wait_until(lambda: bool(bus.losses.links), 60)
        assert {link.reason for link in bus.losses.links} == {"inner"}
        assert wait_until(lambda: linked(bus) == set(), 60)
        with Puppet(bus.endpoint("a")) as source, Puppet(bus.endpoint("b")) as sink:
            sink.do("subscribe", key="x")
            assert bus.wait_subscribed("a", ["x"], timeout=60) == []
            source.do("put_texts", key="x", payloads=["after"], congestion="BLOCK")
            assert len(sink.do("wait", count=1)) == 1
        assert linked(bus) == set()


def test_what_passes_by_a_link_is_recorded_once(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with (
        LogWriter(path) as writer,
        closing(Recorder(writer)) as recorder,
        Bus(SEGMENTS, recorder=recorder, record=["**"]) as bus,
    ):
        assert linked(bus) == EVERY
        with components(bus) as puppets:
            for name, puppet in zip(SEGMENTS, puppets, strict=True):
                puppet.do("put_texts", key=f"from/{name}", payloads=["one", "two"], congestion="BLOCK")
            for puppet in puppets:
                puppet.do("wait", count=6)
            assert bus.drain(60)
    found = sorted((message.key, message.payload) for message in read_log(path))
    assert found == sorted((f"from/{name}", text) for name in SEGMENTS for text in (b"one", b"two"))


def test_a_user_who_decides_who_may_connect_has_no_links() -> None:
    with Bus({"a": (), "b": ()}, config={"access_control": {"enabled": False}}) as bus:
        assert bus.segment("a").zid not in bus.segment("b").peers()


def test_when_a_segment_cannot_be_opened_the_others_part_before_they_close(capfd: pytest.CaptureFixture[str]) -> None:
    """Zenoh 1.10.2 panics in a router that is closed while it takes in that another one has left."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        segments = {"a": (), "b": (), "c": (f"tcp/127.0.0.1:{taken.getsockname()[1]}",)}
        for _ in range(20):
            with pytest.raises(EnvironmentFaultError, match="is in use"):
                Network(segments).open()
    assert capfd.readouterr().err == ""


def test_a_junction_parts_from_its_segments_before_it_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Zenoh 1.10.2 can panic in a router that closes a link between routers which the other end closes, too."""
    neighbours = []

    def closing_one(session: Any) -> None:
        neighbours.append([str(each.zid) for each in session.info.transports()])
        release(session)

    monkeypatch.setattr("riot_bus.zenoh.junction.release", closing_one)
    for config in ({}, {"access_control": {"enabled": False}}):  # it connects to segments, or they do to it
        with Network({"a": (), "b": ()}, config=config) as network:
            assert network.junction is not None
            for number in range(5):
                network.junction.open([f"{number}/**"])
    assert len(neighbours) >= 10  # more, if the machine was slow
    assert not any(neighbours)


@pytest.mark.parametrize("config", [{}, {"access_control": {"enabled": False}}], ids=["doors", "inner"])
def test_a_junction_that_is_interrupted_or_cannot_be_replaced_leaves_nothing_open(
    config: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> Any:
        raise KeyboardInterrupt

    with Network({"a": (), "b": ()}, config=config) as network:
        junction = network.junction
        assert junction is not None
        junction.open(["1/**"])
        with monkeypatch.context() as broken:
            broken.setattr("riot_bus.zenoh.junction.open_session", fail)
            with pytest.raises(KeyboardInterrupt):
                junction.open(["2/**"])
        assert linked_to(network, junction.zid) == {"a", "b"}  # it goes on as before
        junction.open(["3/**"])
        last = junction.zid
        with monkeypatch.context() as broken:
            broken.setattr("riot_bus.zenoh.junction.wait_until", lambda *arguments: fail(wait_until(*arguments)))
            with pytest.raises(KeyboardInterrupt):
                junction.close()
        assert wait_until(lambda: linked_to(network, last) == set(), 60)


def test_a_junction_leaves_although_somebody_has_removed_the_sockets() -> None:
    with Network({"a": (), "b": ()}) as network:
        assert network.junction is not None
        network.junction.open(["1/**"])
        for door in network.segments["a"].doors:
            Path(door.partition("/")[2]).unlink()
        zid = network.junction.zid
        network.junction.close()
        assert linked_to(network, zid) == set()


def test_links_between_segments_hold_more_than_unix_sockets_do_at_first() -> None:
    def buffer(end: socket.socket) -> int:
        return end.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF)

    with socket.socket(socket.AF_UNIX) as plain, Bus(SEGMENTS, intercept=["cut/**"]) as bus:
        network = bus._network
        assert network.direct is not None
        direct = {each.partition("/")[2] for name in SEGMENTS for each in network.direct.listen(name)}
        doors = {each.partition("/")[2] for name in SEGMENTS for each in bus.segment(name).doors}
        for paths in (direct, doors):  # three links between three segments, and three to the junction
            assert [buffer(end) > buffer(plain) for end in _ends(paths)] == [True] * 6
        bus.set_intercept(["other/**"])
        assert list(_ends(direct)) == []
        assert [buffer(end) > buffer(plain) for end in _ends(doors)] == [True] * 6


def test_no_two_routers_share_a_library() -> None:
    with Network(SEGMENTS) as network:
        assert network.junction is not None
        first = network.junction.open(["cut/**"])
        routers = [first, *(each.session for each in network.segments.values())]
        assert len({id(library_of(each)) for each in routers}) == len(routers)
        assert library_of(network.junction.open(["other/**"])) is library_of(first)


def test_segments_that_speak_certain_protocols_only_are_joined() -> None:
    with Bus(SEGMENTS, config={"transport/link/protocols": ["tcp"]}) as bus, components(bus) as (source, *sinks):
        source.do("put_texts", key="free/x", payloads=["1"], congestion="BLOCK")
        for sink in sinks:
            assert bytes.fromhex(sink.do("wait", count=1)[0]["payload"]) == b"1"
