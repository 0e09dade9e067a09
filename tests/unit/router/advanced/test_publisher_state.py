from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from riot_bus.router.advanced.publisher_state import PublisherState
from riot_bus.router.advanced.source import UNNUMBERED, AdvancedSource
from tests.tiers import scaled


def state(entity: str = "7", *, depth: int | None = 0) -> PublisherState:
    made = PublisherState(AdvancedSource("system", "k", "abc", entity), again=False, token=True)
    made.depth = depth
    return made


class Outlet:
    """Where a state publishes: keeps what was stored, in its order, and what of it was heard."""

    def __init__(self) -> None:
        self.stored: list[Any] = []
        self.heard: list[int] = []
        self.beats: list[int] = []

    def publish(self, message: Any) -> None:
        self.stored.append(message)
        self.heard.append(len(self.stored) - 1)

    def skip(self, numbers: int) -> None:
        self.stored += [None] * numbers

    def beat(self) -> None:
        self.beats.append(len(self.stored) - 1)

    def resize(self, depth: int) -> None:
        self.stored.append(f"depth {depth}")

    def close(self) -> None:
        self.stored.append("closed")


def test_a_gap_is_told_once() -> None:
    it = state()
    verdicts = [it.arrived(number, 0.0) for number in (5, 6, 9, 9, 10, 8, 11)]
    assert [verdict.lost for verdict in verdicts] == [None, None, (7, 8), None, None, None, None]
    assert not any(verdict.check or verdict.late or verdict.stored for verdict in verdicts)


def test_times_have_no_gaps() -> None:
    it = state(UNNUMBERED)
    assert [it.arrived(number, 0.0).lost for number in (5, 600, 7000)] == [None] * 3


def test_what_comes_live_although_it_was_stored_is_recognised_once() -> None:
    it = state()
    stored = [it.claim(number) for number in (2, 3, 4)]
    assert it.arrived(3, 0.0).stored is stored[1]
    assert it.arrived(2, 0.0).stored is stored[0]
    assert it.arrived(2, 0.0).late  # once more: no longer recognised, so it cannot be numbered
    assert it.arrived(5, 0.0) == (None, False, None, False)
    assert it.arrived(4, 0.0) == (None, False, None, False)  # forgotten, once something later has come


def test_what_is_older_than_the_history_is_late_unless_it_waits_for_it() -> None:
    it = state(UNNUMBERED)
    it.claim(100)
    it.hold()
    assert not it.arrived(50, 0.0).late
    it.let_go()
    assert it.arrived(60, 0.0).late


def test_the_depth_is_asked_for_when_messages_come_until_it_is_known() -> None:
    it = state(depth=None)
    assert it.arrived(0, 0.0).check
    assert not it.arrived(1, 0.0).check  # it is being asked
    assert not it.overdue()
    it.checking = False
    assert it.overdue()  # because of number 1
    it.checking = False
    assert not it.overdue()
    it.check_from = 5.0
    assert not it.arrived(2, 4.0).check
    assert it.arrived(3, 5.0).check
    it.checking, it.depth = False, 3
    assert not it.arrived(4, 6.0).check
    assert not it.overdue()


def test_the_depth_is_not_asked_for_while_messages_wait_but_afterwards() -> None:
    it = state(depth=None)
    it.hold()
    assert not it.arrived(0, 0.0).check
    assert not it.overdue()
    it.let_go()
    assert it.overdue()


def test_messages_wait_for_the_tasks_before_them_and_for_no_others() -> None:
    it, done = state(), list[str]()

    def send(text: str) -> None:
        it.deliver("k", partial(done.append, text))

    send("0")
    it.hold()
    send("1")
    it.hold()
    send("2")
    send("3")
    assert (done, it.held()) == (["0"], {"k": 3})
    it.let_go()
    assert (done, it.held()) == (["0", "1"], {"k": 2})
    it.let_go()
    send("4")
    assert done == ["0", "1", "2", "3", "4"]
    assert not it.held()


def test_heartbeats_wait_until_the_numbers_are_given() -> None:
    it, outlet = state(), Outlet()
    it.outlets["unit"] = outlet  # type: ignore[assignment]
    it.publish("unit", "0")  # type: ignore[arg-type]
    it.beat()
    it.hold()
    it.beat()
    it.skip(2)
    it.let_go()
    it.beat()
    assert outlet.beats == [0, 2]
    assert not it.publish("third", "1")  # type: ignore[arg-type]


def test_closing_takes_everything_away() -> None:
    it, outlet = state(), Outlet()
    it.outlets["unit"] = outlet  # type: ignore[assignment]
    it.resize(3)
    it.claim(1)
    it.close()
    assert outlet.stored == ["depth 3", "closed"]
    assert (it.depth, it.outlets, it.early) == (3, {}, {})


@dataclass
class World:
    """A publisher, a link that loses, a lane and a keeper around a state; who takes the next step is up to Hypothesis.

    What the keeper does is written down here once more, in the few lines that matter.
    """

    state: PublisherState
    outlet: Outlet = field(default_factory=Outlet)
    sent: int = 0
    link: deque[int] = field(default_factory=deque)
    lost: set[int] = field(default_factory=set)
    tasks: deque[Callable[[], None]] = field(default_factory=deque)
    opened: bool = False

    def publish(self) -> None:
        self.link.append(self.sent)
        self.sent += 1

    def lose(self) -> None:
        self.lost.add(self.sent)
        self.sent += 1

    def receive(self) -> None:
        if not self.link:
            return
        number = self.link.popleft()
        verdict = self.state.arrived(number, 0.0)
        if verdict.stored is not None:
            stored = verdict.stored
            self.state.deliver("k", lambda: self.outlet.heard.extend(place[2] for place in stored.places))
            return
        assert not verdict.late
        if verdict.lost is not None:
            self.hold(partial(self.store, range(verdict.lost[0], verdict.lost[1] + 1)))
        self.state.deliver("k", partial(self.state.publish, "unit", number))  # type: ignore[arg-type]

    def open(self) -> None:
        if not self.opened:
            self.opened = True
            self.hold(self.adopt)

    def adopt(self) -> None:
        self.state.outlets["unit"] = self.outlet  # type: ignore[assignment]
        self.store(range(self.sent if self.state.first is None else min(self.sent, self.state.first)))

    def store(self, numbers: range) -> None:
        for number in numbers:
            stored = self.state.claim(number)
            self.outlet.stored.append(number)
            stored.places.append((self.outlet, number, len(self.outlet.stored) - 1, None))  # type: ignore[arg-type]

    def hold(self, task: Callable[[], None]) -> None:
        self.state.hold()
        self.tasks.append(task)

    def work(self) -> None:
        if self.tasks:
            self.tasks.popleft()()
            self.state.let_go()


@settings(deadline=None, max_examples=scaled(300))
@given(
    before=st.integers(1, 5),
    steps=st.lists(st.sampled_from(["publish", "publish", "lose", "receive", "receive", "work"]), max_size=60),
)
def test_whatever_comes_when_numbers_are_in_order_and_nothing_is_there_twice(before: int, steps: list[str]) -> None:
    world = World(state(), sent=before)
    world.open()
    for step in steps:
        getattr(world, step)()
    world.publish()
    while world.link or world.tasks:
        world.receive()
        world.work()
    assert world.outlet.stored == list(range(world.sent))
    assert sorted(set(world.outlet.heard)) == sorted(world.outlet.heard)
    live = {number for number in range(before, world.sent) if number not in world.lost}
    assert live <= set(world.outlet.heard)
    assert not world.state.held()
    assert world.state.holds == 0
