"""Decides from what was seen whether components of different segments reach each other around the router; pure."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from riot_bus.graph.model import ConnectedComponent

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from riot_bus.zenoh.scouting import Answer

_MULTICAST = (
    "set scouting/multicast/enabled to false in its Zenoh configuration "
    "(ROS 2: ZENOH_CONFIG_OVERRIDE='scouting/multicast/enabled=false')"
)
_ENDPOINTS = "leave only its own segment's endpoint in connect/endpoints of each"


@dataclass(frozen=True, slots=True)
class Bypass:
    """A way around the router.

    Attributes:
        kind: "multicast": sessions find each other by multicast scouting, or could at any moment; "direct": a direct
            link; "router": a router between segments; "two segments": one session that is connected to two segments.
        components: Sessions that are involved, a foreign router included; sorted.
        active: Whether it was seen in use; False if it is merely open.
    """

    kind: Literal["multicast", "direct", "router", "two segments"]
    components: tuple[ConnectedComponent, ...]
    evidence: str
    cure: str
    active: bool = True


@dataclass(frozen=True, slots=True, order=True)
class Contact:
    """Two sessions that are linked without one of our routers between them, and how we know."""

    one: str
    other: str
    how: str


@dataclass(frozen=True, slots=True)
class Sightings:
    """What was seen.

    Attributes:
        components: All sessions of all segments, ours left out; a session in two segments is there twice.
        contacts: Links between sessions, none of them ours.
        others: Sessions that are connected to no segment, by id.
        answers: Answers to multicast scouting, by session id.
    """

    components: Sequence[ConnectedComponent] = ()
    contacts: Sequence[Contact] = ()
    others: Mapping[str, ConnectedComponent] = field(default_factory=dict)
    answers: Mapping[str, Answer] = field(default_factory=dict)


def judge(seen: Sightings) -> list[Bypass]:
    """Return all ways around the router, sorted by kind."""
    segments: defaultdict[str, set[str]] = defaultdict(set)
    known: defaultdict[str, list[ConnectedComponent]] = defaultdict(list)
    for component in seen.components:
        segments[component.zid].add(component.segment)
        known[component.zid].append(component)
    found = [_two_segments(known[zid]) for zid, names in segments.items() if len(names) > 1]
    # Links within a segment are as they should be: its peers talk to each other directly.
    contacts = [
        each for each in seen.contacts if each.one not in segments or segments[each.one] != segments.get(each.other)
    ]
    groups = _connected(contacts)
    reached = set()
    for group in groups:
        if len(set().union(*(segments.get(zid, set()) for zid in group))) > 1:
            reached.update(group)
            members = [one for zid in sorted(group) for one in known.get(zid) or [_other(zid, seen)]]
            how = "; ".join(sorted({each.how for each in contacts if each.one in group}))
            found.append(_linked(members, how, seen.answers))
    open_to_all = [zid for zid in known.keys() & seen.answers.keys() if seen.answers[zid].locators]
    found += _multicast([one for zid in open_to_all if zid not in reached for one in known[zid]], seen)
    return sorted(found, key=lambda each: (each.kind, [(one.segment, one.zid) for one in each.components]))


def _other(zid: str, seen: Sightings) -> ConnectedComponent:
    return seen.others.get(zid, ConnectedComponent("", zid))


def _connected(contacts: Iterable[Contact]) -> list[set[str]]:
    groups: list[set[str]] = []
    for each in contacts:
        joined = {each.one, each.other}
        apart = []
        for group in groups:
            if group & joined:
                joined |= group
            else:
                apart.append(group)
        groups = [*apart, joined]
    return groups


def _sorted(components: Iterable[ConnectedComponent]) -> tuple[ConnectedComponent, ...]:
    return tuple(sorted(components, key=lambda each: (each.segment, each.zid)))


def _two_segments(same: list[ConnectedComponent]) -> Bypass:
    names = " and ".join(sorted(each.segment for each in same))
    router = any(each.mode == "router" for each in same)
    what = "router" if router else same[0].mode or "session"
    return Bypass(
        kind="router" if router else "two segments",
        components=_sorted(same),
        evidence=f"the {what} {same[0].label} ({same[0].zid}) is connected to the segments {names}",
        cure=f"leave one segment's endpoint in connect/endpoints of {same[0].label}"
        + (", or stop this router: its components connect to their segments themselves" if router else ""),
    )


def _linked(members: list[ConnectedComponent], how: str, answers: Mapping[str, Answer]) -> Bypass:
    routers = [each for each in members if each.mode == "router"]
    if routers:
        names = ", ".join(sorted({f"{each.label} ({each.zid})" for each in routers}))
        cure = f"stop the router {names}, and connect its components to their segments; else {_ENDPOINTS}"
        return Bypass("router", _sorted(members), how, cure)
    if all(each.zid in answers for each in members):
        return Bypass("multicast", _sorted(members), f"{how}; all of them answer multicast scouting", _MULTICAST)
    cure = f"{_ENDPOINTS}; disable scouting/multicast/enabled, and scouting/gossip/multihop if it is on"
    return Bypass("direct", _sorted(members), how, cure)


def _multicast(members: list[ConnectedComponent], seen: Sightings) -> list[Bypass]:
    if not members:
        return []
    ours = {each.zid for each in seen.components}
    others = sum(1 for zid, answer in seen.answers.items() if zid not in ours and answer.locators)
    names = ", ".join(sorted({f"{each.label} at {seen.answers[each.zid].locators[0]}" for each in members}))
    evidence = f"answers multicast scouting: {names}"
    if others:
        evidence += f"; so do {others} Zenoh sessions outside of this bus"
    return [Bypass("multicast", _sorted(members), evidence, _MULTICAST, active=False)]
