from __future__ import annotations

from riot_bus.control.reach import Contact, Sightings, judge
from riot_bus.graph.model import ConnectedComponent
from riot_bus.zenoh.scouting import Answer

OUT, OUT2 = ConnectedComponent("out", "a1", "peer", "one"), ConnectedComponent("out", "a2", "peer", "two")
IN, CLIENT = ConnectedComponent("in", "b1", "peer", "three"), ConnectedComponent("in", "b2", "client", "four")
ALL = [OUT, OUT2, IN, CLIENT]


def answer(zid: str, *locators: str) -> Answer:
    return Answer(zid, "peer", locators, "lo")


def test_links_within_a_segment_are_as_they_should_be() -> None:
    assert judge(Sightings(ALL, [Contact("a1", "a2", "x"), Contact("b1", "b2", "x")])) == []


def test_only_those_who_cross_are_named() -> None:
    (found,) = judge(Sightings(ALL, [Contact("a1", "a2", "x"), Contact("a2", "b1", "seen")]))
    assert (found.kind, found.components, found.evidence, found.active) == ("direct", (IN, OUT2), "seen", True)
    assert "connect/endpoints" in found.cure


def test_a_router_beside_the_bus_is_named_with_who_uses_it() -> None:
    router = ConnectedComponent("", "ff", "router", "zenohd")
    contacts = [Contact("a1", "ff", "x"), Contact("b1", "ff", "y")]
    (found,) = judge(Sightings(ALL, contacts, {"ff": router}))
    assert (found.kind, found.components, found.evidence) == ("router", (router, IN, OUT), "x; y")
    assert "zenohd" in found.cure
    assert judge(Sightings(ALL, contacts[:1], {"ff": router})) == []
    far = [Contact("a1", "e1", "x"), Contact("b1", "e3", "x"), Contact("e2", "e3", "x"), Contact("e1", "e2", "x")]
    assert {each.zid for each in judge(Sightings(ALL, far))[0].components} == {"a1", "b1", "e1", "e2", "e3"}


def test_one_session_in_two_segments() -> None:
    (peer,) = judge(Sightings([OUT, ConnectedComponent("in", "a1", "peer", "one")]))
    assert peer.kind == "two segments"
    assert "in and out" in peer.evidence
    (router,) = judge(Sightings([ConnectedComponent("out", "a1", "router"), ConnectedComponent("in", "a1", "router")]))
    assert router.kind == "router"
    assert "stop this router" in router.cure


def test_multicast_is_an_alarm_open_or_used() -> None:
    (used,) = judge(
        Sightings(ALL, [Contact("a1", "b1", "x")], {}, {"a1": answer("a1", "tcp/x:1"), "b1": answer("b1", "tcp/x:2")})
    )
    assert (used.kind, used.active) == ("multicast", True)
    assert "ZENOH_CONFIG_OVERRIDE" in used.cure
    answers = {"a1": answer("a1", "tcp/x:1"), "b2": answer("b2"), "zz": answer("zz", "tcp/y:1")}
    (open_,) = judge(Sightings(ALL, answers=answers))
    assert (open_.components, open_.active) == ((OUT,), False)
    assert "1 Zenoh sessions outside" in open_.evidence
    assert judge(Sightings(ALL, answers={"zz": answer("zz", "tcp/y:1")})) == []
