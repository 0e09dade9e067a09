"""Who gets a frame, against the rules in plain words."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from riot_bus_bridges.mavlink.routing import Duplicates, Peer, Routes, addressed
from riot_bus_bridges.mavlink.url import Filter
from tests.unit.riot_bus_bridges.mavlink.frames import COMMON, frame_of, unknown_frame

STEPS = st.lists(st.tuples(st.integers(0, 12), st.sampled_from([b"a", b"b", b"c"])), max_size=40)
AUTOPILOT, CAMERA, GROUND = (1, 1), (1, 100), (255, 190)


def table(*peers: Peer, **options: int) -> Routes[Peer]:
    routes: Routes[Peer] = Routes(COMMON.targets, **options)  # type: ignore[arg-type]
    for peer in peers:
        routes.add(peer)
    return routes


@pytest.mark.parametrize("version", [1, 2])
def test_whom_a_frame_is_for(version: int) -> None:
    for target in ((0, 0), (7, 0), (7, 9), (0, 9)):
        frame = frame_of("COMMAND_LONG", target=target, version=version)
        assert addressed(frame, COMMON.targets(frame.message_id)) == (target if target[0] else (0, 0))
    mode = frame_of("SET_MODE", target=(7, 0), version=version)
    assert addressed(mode, COMMON.targets(mode.message_id)) == (7, 0)
    assert addressed(frame_of("HEARTBEAT"), (None, None)) == (0, 0)


def test_what_users_expect() -> None:
    vehicle, ground, other = Peer("vehicle"), Peer("ground"), Peer("other")
    routes = table(vehicle, ground, other)
    assert routes.receive(frame_of(source=AUTOPILOT), vehicle, 0) == [ground, other]
    assert routes.receive(frame_of(source=GROUND), ground, 0) == [vehicle, other]
    command = frame_of("COMMAND_LONG", source=GROUND, target=AUTOPILOT)
    assert routes.receive(command, ground, 0) == [vehicle]
    assert routes.receive(frame_of("COMMAND_LONG", source=GROUND, target=(42, 1)), ground, 0) == []
    assert routes.receive(frame_of("COMMAND_LONG", source=GROUND, target=(1, 100)), ground, 0) == []
    assert routes.receive(frame_of("COMMAND_LONG", source=GROUND, target=(1, 0)), ground, 0) == [vehicle]
    assert routes.receive(frame_of("COMMAND_LONG", source=GROUND, target=(0, 0)), ground, 0) == [vehicle, other]
    assert routes.receive(unknown_frame(source=GROUND), ground, 0) == [vehicle, other]
    assert routes.knows(*GROUND)
    assert not routes.knows(42, 1)
    assert vehicle.sources == {AUTOPILOT}
    assert ground.counts == {"in": 7}


def test_no_frame_goes_where_its_source_is() -> None:
    one, two, ground = Peer("one"), Peer("two"), Peer("ground")
    routes = table(one, two, ground)
    routes.receive(frame_of(source=AUTOPILOT), one, 0)
    routes.receive(frame_of(source=AUTOPILOT), two, 0)
    assert routes.receive(frame_of(source=AUTOPILOT), one, 0) == [ground]
    assert routes.deliver(frame_of(source=AUTOPILOT), looped=True) == [ground]
    assert routes.deliver(frame_of(source=AUTOPILOT), looped=False) == [one, two, ground]


def test_groups_share_what_they_know_and_do_not_hear_each_other() -> None:
    lte, radio, ground = Peer("lte", group="air"), Peer("radio", group="air"), Peer("ground")
    routes = table(lte, radio, ground)
    assert routes.receive(frame_of(source=AUTOPILOT), lte, 0) == [ground]
    command = frame_of("COMMAND_LONG", source=GROUND, target=AUTOPILOT)
    assert routes.receive(command, ground, 0) == [lte, radio]
    assert radio.sources == {AUTOPILOT}
    late = Peer("late", group="air")
    routes.add(late)
    assert late.sources == {AUTOPILOT}
    routes.remove(lte)
    assert routes.receive(command, ground, 0) == [radio, late]


def test_duplicates_over_links_are_dropped_on_request() -> None:
    one, two, ground = Peer("one", group="air"), Peer("two", group="air"), Peer("ground")
    routes: Routes[Peer] = Routes(COMMON.targets, duplicates=Duplicates(0.5))
    for peer in (one, two, ground):
        routes.add(peer)
    assert routes.receive(frame_of(sequence=1), one, 0.0) == [ground]
    assert routes.receive(frame_of(sequence=1), two, 0.1) is None
    assert routes.receive(frame_of(sequence=2), two, 0.2) == [ground]
    assert routes.receive(frame_of(sequence=1), two, 0.7) == [ground]
    assert two.counts == {"in": 2, "duplicate": 1}


def test_filters_directions_and_sniffers() -> None:
    vehicle = Peer("vehicle", accepts=Filter(block_msg_id=frozenset({0})))
    ground = Peer("ground", emits=Filter(allow_src_sys=frozenset({1})))
    deaf, mute = Peer("deaf", sends=False), Peer("mute", receives=False)
    log, sniffer = Peer("log", hears_all=True), Peer("sniffer")
    routes = table(vehicle, ground, deaf, mute, log, sniffer, sniffer=254)
    assert routes.receive(frame_of(), vehicle, 0) is None
    assert routes.receive(frame_of(), mute, 0) is None
    assert not routes.knows(1, 1)
    assert routes.receive(frame_of("ATTITUDE", source=AUTOPILOT), vehicle, 0) == [ground, mute, log, sniffer]
    assert routes.receive(frame_of("ATTITUDE", source=(2, 1)), vehicle, 0) == [mute, log, sniffer]
    routes.receive(frame_of(source=(254, 1)), sniffer, 0)
    command = frame_of("COMMAND_LONG", source=AUTOPILOT, target=(9, 9))
    assert routes.receive(command, vehicle, 0) == [log, sniffer]
    assert ground.counts["filtered_out"] == 2  # the second one is the sniffer's own heartbeat
    assert vehicle.counts["filtered_in"] == 1
    assert mute.counts["filtered_in"] == 1


SOURCES = st.tuples(st.integers(1, 3), st.integers(1, 2))
EVENTS = st.lists(
    st.tuples(
        st.integers(0, 3),
        SOURCES,
        st.one_of(st.none(), st.tuples(st.integers(0, 3), st.integers(0, 2))),
        st.booleans(),
    ),
    max_size=30,
)


@given(EVENTS, st.lists(st.sampled_from(["", "", "a", "b"]), min_size=4, max_size=4))
def test_against_the_rules_in_plain_words(
    events: list[tuple[int, tuple[int, int], tuple[int, int] | None, bool]], groups: list[str]
) -> None:
    peers = [Peer(str(number), group=group) for number, group in enumerate(groups)]
    routes = table(*peers)
    seen: list[set[tuple[int, int]]] = [set() for _ in peers]

    def known(number: int) -> set[tuple[int, int]]:
        mates = [each for each in range(4) if each == number or (groups[number] and groups[each] == groups[number])]
        return set().union(*(seen[each] for each in mates))

    for origin, source, target, on_bus in events:
        frame = frame_of(source=source) if target is None else frame_of("COMMAND_LONG", source=source, target=target)
        if on_bus:
            found = routes.deliver(frame, looped=False)
        else:
            taken = routes.receive(frame, peers[origin], 0.0)
            assert taken is not None
            found = taken
            seen[origin].add(source)
        wanted = []
        for number, peer in enumerate(peers):
            if not on_bus:
                if number == origin or (groups[number] and groups[number] == groups[origin]):
                    continue
                if source in known(number):
                    continue
            system, component = target or (0, 0)
            if system and not any(
                each == (system, component) or (not component and each[0] == system) for each in known(number)
            ):
                continue
            wanted.append(peer)
        assert found == wanted
    for number, peer in enumerate(peers):
        assert peer.sources == known(number)


@given(STEPS)
def test_seen_within_the_period(steps: list[tuple[int, bytes]]) -> None:
    duplicates = Duplicates(1.0)
    now = 0.0
    last: dict[bytes, float] = {}
    for tenths, raw in steps:
        now += tenths / 8
        assert duplicates.seen(raw, now) == (raw in last and now - last[raw] < 1.0)
        last[raw] = now


def test_what_is_remembered_is_bounded() -> None:
    duplicates = Duplicates(1e9, most=10)
    for number in range(1000):
        assert not duplicates.seen(b"%d" % number, number / 1000)
    assert duplicates.seen(b"999", 1)
    assert not duplicates.seen(b"1", 1)
    assert len(duplicates._last) <= 11
