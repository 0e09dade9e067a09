from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.pipeline.runner import Emission, Result
from riot_bus.router.advanced import history_mirror as module
from riot_bus.router.advanced.history_mirror import HistoryMirror
from riot_bus.router.advanced.publisher_state import PublisherState
from riot_bus.router.advanced.source import UNNUMBERED, AdvancedSource
from riot_bus.router.advanced.upstream import CacheAnswer
from riot_bus.vocabulary.message import Message


class Hand:
    """A worker whose jobs are done when the test says so."""

    def __init__(self) -> None:
        self.jobs: deque[Callable[[], None]] = deque()
        self.timed: list[tuple[float, Callable[[], None]]] = []

    def do(self, job: Callable[[], None]) -> None:
        self.jobs.append(job)

    def later(self, seconds: float, job: Callable[[], None], *, background: bool = False) -> None:
        self.timed.append((seconds, job))

    def run(self) -> None:
        while self.jobs:
            self.jobs.popleft()()

    def wait(self) -> None:
        """Let time pass until all that was put off is due."""
        self.run()
        timed, self.timed = self.timed, []
        for _, job in timed:
            self.do(job)
        self.run()


class Cache:
    """A publisher's cache: answers when the test says so."""

    def __init__(self, worker: Hand) -> None:
        self._worker = worker
        self.asked: list[str] = []
        self._then: deque[Callable[[CacheAnswer], None]] = deque()

    def ask(self, source: AdvancedSource, parameters: str, then: Callable[[CacheAnswer], None]) -> None:
        self.asked.append(parameters)
        self._then.append(then)

    def answer(self, *numbers: int, complete: bool = True, asked: bool = True) -> None:
        self._worker.run()
        then = self._then.popleft()
        found = [(number, SimpleNamespace(number=number, timestamp=None)) for number in numbers]
        then(CacheAnswer(found, complete, asked))
        self._worker.run()


class Here:
    """A stand-in: keeps what is done with it."""

    made: list[Here] = []  # noqa: RUF012 - emptied before each test

    def __init__(self, outlets: Any, session: Any, key: str, depth: int | None) -> None:
        self.depth = depth
        self.rows: list[Any] = []
        self.made.append(self)

    def store(self, message: Message, stamp: Any) -> int:
        self.rows.append(message.payload.decode())
        return len(self.rows) - 1

    def publish(self, message: Message) -> None:
        self.rows.append(f"{message.payload.decode()}!")

    def skip(self, numbers: int) -> None:
        self.rows += ["-"] * numbers

    def announce(self, number: int, *, again: bool) -> None:
        self.rows.append("token again" if again else "token")

    def beat(self) -> None:
        self.rows.append("beat")

    def resize(self, depth: int) -> None:
        self.depth = depth

    def close(self) -> None:
        self.rows.append("closed")


class Scene:
    """A mirror with one state, and everything around it that the test moves."""

    def __init__(self, *, entity: str = "7", again: bool = False, depth: int | None = None) -> None:
        self.depth = depth
        """How many samples the publisher is known to keep, so that it is not asked."""
        self.worker = Hand()
        self.cache = Cache(self.worker)
        self.refused: set[int] = set()
        self.taken = True
        """Whether forwarders have taken all that came in."""
        self.mirror = HistoryMirror(
            SimpleNamespace(  # type: ignore[arg-type]
                access=SimpleNamespace(
                    sessions={"system": None, "unit": None},
                    outlets={"unit": None},
                    converters={"system": self.convert},
                ),
                replay=self.replay,
                targets_of=lambda emission: ("unit",),
            ),
            worker=self.worker,  # type: ignore[arg-type]
            upstream=self.cache,  # type: ignore[arg-type]
            fence=lambda segment: lambda: self.taken,
        )
        self.state = PublisherState(AdvancedSource("system", "k", "abc", entity), again=again, token=True)

    @staticmethod
    def convert(sample: Any) -> Message:
        return Message(0, "k", str(sample.number).encode())

    def replay(self, message: Message, worker: Any) -> Result:
        if int(message.payload) in self.refused:
            raise ValueError("on purpose")
        return Result(message, (Emission(0, message, message, ()),), ())

    def open(self, *numbers: int, **answer: Any) -> None:
        self.mirror.open(self.state)
        self.cache.answer(*numbers, **answer)
        self.worker.wait()  # for something live
        self.worker.wait()  # for forwarders
        self.worker.wait()  # for those who ask because of the token

    def live(self, number: int) -> None:
        """Do as `PublisherProxies` does."""
        self.state.depth = self.depth or self.state.depth
        verdict = self.state.arrived(number, 0.0)
        if self.state.on_first is not None:
            self.state.on_first()
        if verdict.lost is not None:
            self.mirror.recover(self.state, *verdict.lost)
        if verdict.check:
            self.mirror.check(self.state)
        message = Message(0, "k", str(number).encode())
        if verdict.stored is None:
            self.state.deliver("k", partial(self.publish, message))

    def publish(self, message: Message) -> None:
        assert self.state.publish("unit", message)

    @property
    def rows(self) -> list[Any]:
        return Here.made[-1].rows


@pytest.fixture(autouse=True)
def _stand_ins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ProxyPublisher", Here)
    Here.made.clear()


def test_history_goes_before_what_comes_meanwhile_and_the_token_before_both_are_heard() -> None:
    scene = Scene()
    scene.mirror.open(scene.state)
    scene.worker.run()
    scene.live(2)
    scene.live(3)
    scene.cache.answer(0, 1, 2)  # 2 comes live, so it is no history
    assert scene.rows == ["0", "1", "token"]  # those who ask for it now would refuse it after something live
    scene.live(4)
    scene.worker.wait()
    assert scene.rows == ["0", "1", "token", "2!", "3!", "4!"]
    assert scene.cache.asked[0] == ""


def test_a_history_without_anything_live_is_taken_after_a_while() -> None:
    scene = Scene(again=True)
    scene.mirror.open(scene.state)
    scene.cache.answer(0, 1)
    assert Here.made == []
    scene.worker.wait()
    assert Here.made == []  # a lane may have one message in its hand
    scene.worker.wait()
    assert scene.rows == ["0", "1", "token again"]
    scene.live(1)  # it comes all the same
    assert scene.rows == ["0", "1", "token again"]
    scene.live(2)
    assert scene.rows[3:] == ["2!"]


def test_a_history_waits_for_lanes_and_not_for_ever() -> None:
    scene = Scene(again=True)
    scene.taken = False
    scene.mirror.open(scene.state)
    scene.cache.answer(0, 1)
    for _ in range(module._MOST_LOOKS):
        scene.worker.wait()
    assert Here.made == []
    scene.worker.wait()
    assert scene.rows == ["0", "1", "token again"]
    assert scene.worker.timed == []


def test_of_a_history_nothing_is_taken_that_lanes_bring_themselves() -> None:
    scene = Scene(again=True)
    scene.taken = False
    scene.mirror.open(scene.state)
    scene.cache.answer(2)
    scene.worker.wait()
    scene.live(0)
    scene.live(1)
    scene.live(2)
    scene.worker.run()
    assert scene.rows == ["token again", "0!", "1!", "2!"]
    scene.worker.wait()
    assert scene.worker.timed == []


@pytest.mark.parametrize(
    ("entity", "live", "found", "depth"),
    [
        ("7", [], [], None),  # nothing published
        ("7", [], [0, 1], None),  # nothing gone yet
        ("7", [], [3, 4], 2),
        ("7", [5], [3, 4, 5], 3),
        (UNNUMBERED, [], [300, 400], None),  # who knows what was before
        (UNNUMBERED, [300], [300, 400], None),
        (UNNUMBERED, [200], [300, 400], 2),
        (UNNUMBERED, [200], [], None),  # it was asked before that was published
    ],
)
def test_the_depth_is_known_when_something_is_gone(
    entity: str, live: list[int], found: list[int], depth: int | None
) -> None:
    scene = Scene(entity=entity)
    scene.mirror.open(scene.state)
    scene.worker.run()
    for number in live:
        scene.live(number)
    scene.cache.answer(*found)
    scene.worker.wait()
    scene.worker.wait()
    assert Here.made[-1].depth == depth
    assert bool(scene.cache.asked[1:]) == bool(live and depth is None)


def test_who_has_no_cache_gets_none() -> None:
    scene = Scene()
    scene.open(asked=False)
    for number in (0, 3):
        scene.live(number)
    assert scene.rows == ["token", "0!"]  # 3 waits until what is missing is left out
    scene.worker.wait()
    assert scene.rows == ["token", "0!", "-", "-", "3!"]
    assert scene.cache.asked == [""]
    assert Here.made[-1].depth == 0


def test_gaps_are_filled_each_in_its_place() -> None:
    scene = Scene(depth=9)
    scene.open(0)
    for number in (1, 4, 5, 7, 8):
        scene.live(number)
    scene.cache.answer(2, 3)
    assert scene.rows[1:] == ["token", "1!", "2", "3", "4!", "5!"]
    scene.cache.answer()  # nobody has 6 any more
    assert scene.rows[1:] == ["token", "1!", "2", "3", "4!", "5!", "7!", "8!"]
    assert scene.cache.asked == ["", "?_sn=2..3", "?_sn=6..6"]


def test_gaps_are_filled_in_their_place_although_the_history_is_not_there_yet() -> None:
    scene = Scene(depth=9)
    scene.mirror.open(scene.state)
    scene.worker.run()
    for number in (1, 3):
        scene.live(number)
    scene.cache.answer(0, 1, 2, 3)
    scene.worker.wait()
    scene.cache.answer(2)
    assert scene.rows == ["0", "token", "1!", "2", "3!"]


def test_a_heartbeat_that_is_ahead_lets_us_look_for_the_rest() -> None:
    scene = Scene(depth=9)
    scene.open(0)
    scene.live(1)
    scene.mirror.beat(scene.state, 1)
    assert scene.rows == ["0", "token", "1!", "beat"]
    scene.mirror.beat(scene.state, 3)
    assert scene.cache.asked == [""]
    scene.live(2)  # it had only overtaken this
    scene.worker.wait()
    assert scene.cache.asked == [""]
    scene.mirror.beat(scene.state, 4)
    scene.worker.wait()
    assert scene.cache.asked[1:] == ["?_sn=3..4"]
    scene.cache.answer(3, 4)
    assert scene.rows[-4:] == ["2!", "3", "4", "beat"]
    scene.live(5)
    assert scene.rows[-1] == "5!"
    assert scene.cache.asked[2:] == []


def test_a_heartbeat_does_not_overtake_a_message_that_interceptors_still_have() -> None:
    scene = Scene(depth=9)
    scene.open(0)
    scene.state.arrived(1, 0.0)
    scene.state.busy = True
    scene.mirror.beat(scene.state, 3)
    scene.worker.wait()
    assert scene.cache.asked == [""]
    scene.state.busy = False
    scene.worker.wait()
    assert scene.cache.asked[1:] == ["?_sn=2..3"]


def test_the_depth_is_measured_once_the_first_message_is_gone() -> None:
    scene = Scene()
    scene.open()
    scene.live(0)
    scene.cache.answer(0)  # still there
    scene.live(1)
    scene.live(2)  # while it is asked
    scene.cache.answer()
    scene.cache.answer(1, 2)
    assert scene.cache.asked[1:] == ["?_sn=0..0", "?_sn=0..0", ""]
    assert Here.made[-1].depth == 2


def test_it_is_asked_again_for_what_has_come_while_it_was_asked() -> None:
    scene = Scene()
    scene.open()
    scene.live(0)
    scene.live(1)
    scene.cache.answer(0)
    scene.cache.answer(0)
    assert scene.cache.asked[1:] == ["?_sn=0..0"] * 2
    assert scene.state.depth is None


def test_a_cache_that_never_answers_is_none() -> None:
    scene = Scene(entity=UNNUMBERED)
    scene.open()
    for number in range(3):
        scene.live(number)
        scene.cache.answer(complete=False)
    assert Here.made[-1].depth == 0
    scene.live(4)
    scene.worker.run()
    assert len(scene.cache.asked) == 4


def test_a_task_that_fails_is_told_and_holds_nobody_up(caplog: pytest.LogCaptureFixture) -> None:
    scene = Scene(depth=9)
    scene.open(0)
    scene.refused.add(2)
    for number in (1, 4):
        scene.live(number)
    scene.cache.answer(2, 3)
    assert scene.rows[-2:] == ["1!", "4!"]
    assert "on purpose" in caplog.text
    scene.live(5)
    assert scene.rows[-1] == "5!"


def test_the_end_comes_after_what_was_to_be_done() -> None:
    scene = Scene(depth=9)
    scene.open(0)
    ended: list[bool] = []
    for number in (1, 3):
        scene.live(number)
    scene.mirror.end(scene.state, lambda: ended.append(True))
    scene.worker.wait()
    assert not ended
    scene.cache.answer(2)
    assert scene.rows[-4:] == ["1!", "2", "3!", "closed"]
    assert ended == [True]
