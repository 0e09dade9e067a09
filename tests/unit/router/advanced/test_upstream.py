from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from riot_bus.router.advanced.source import AdvancedSource
from riot_bus.router.advanced.upstream import CacheAnswer, Upstream

SOURCE = AdvancedSource("system", "k", "abc", "7")


class Session:
    """Notes the question; the test answers."""

    def __init__(self, *, nobody: bool = False) -> None:
        self.selector = ""
        self.nobody = nobody

    def get(self, selector: str, callback: Any, **options: Any) -> None:
        self.selector, self.callback = selector, callback
        if self.nobody:
            callback.drop()


def answer(number: int | None, *, zid: str = "abc", error: bool = False, size: int = 0) -> Any:
    info = None if number is None else SimpleNamespace(source_id=SimpleNamespace(zid=zid, eid=7), source_sn=number)
    sample = SimpleNamespace(source_info=info, timestamp=None, key_expr="k", payload=zenoh.ZBytes(b"x" * size))
    return SimpleNamespace(ok=None, err="timeout") if error else SimpleNamespace(ok=sample, err=None)


def ask(*answers: Any, nobody: bool = False, parameters: str = "") -> tuple[CacheAnswer, str]:
    session, jobs = Session(nobody=nobody), list[Callable[[], None]]()
    worker = SimpleNamespace(do=jobs.append)
    found: list[CacheAnswer] = []
    Upstream({"system": session}, worker).ask(SOURCE, parameters, found.append)  # type: ignore[dict-item,arg-type]
    for each in answers:
        session.callback(each)
    if not nobody:
        elsewhere = threading.Thread(target=session.callback.drop)
        elsewhere.start()
        elsewhere.join()
    assert not found  # not on a thread of Zenoh's
    (job,) = jobs
    job()
    return found[0], session.selector


def test_samples_are_found_in_order() -> None:
    found, selector = ask(answer(3), answer(1), answer(2))
    assert [number for number, _ in found.samples] == [1, 2, 3]
    assert (found.complete, found.asked) == (True, True)
    assert selector == "k/@adv/pub/abc/7/**"


def test_what_does_not_tell_its_publisher_is_left_out() -> None:
    found, selector = ask(answer(None), answer(5), parameters="?_sn=5..6")
    assert [number for number, _ in found.samples] == [5]
    assert selector == "k/@adv/pub/abc/7/**?_sn=5..6"


def test_a_question_that_was_not_answered_in_time_is_not_complete() -> None:
    found, _ = ask(answer(1), answer(None, error=True))
    assert len(found.samples) == 1
    assert (found.complete, found.asked) == (False, True)


@pytest.mark.parametrize("size", [0, 5000])
def test_answers_for_which_there_is_no_room_are_left_out_and_told(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("riot_bus.router.advanced.upstream._MOST_BYTES", 100_000)
    found, _ = ask(*(answer(number, size=size) for number in range(200)))
    assert len(found.samples) == (100_000 // (size + 1024))
    assert (found.complete, found.asked) == (False, True)


def test_it_tells_when_there_is_nobody_to_ask() -> None:
    assert ask(nobody=True)[0] == CacheAnswer([], complete=True, asked=False)


class Channel:
    """What has been answered so far; None stands for nothing yet."""

    def __init__(self, *answers: Any) -> None:
        self.answers = list(answers)

    def try_recv(self) -> Any:
        if not self.answers:
            raise zenoh.ZError("closed")
        return self.answers.pop(0)


def test_a_search_tells_of_publishers_as_they_answer() -> None:
    yet = None
    channel = Channel(yet, answer(4), yet, yet, answer(None, error=True), answer(None), answer(1, zid="def"), yet)
    session = SimpleNamespace(get=lambda selector, handler, **options: channel)
    jobs, pauses, found = list[Callable[[], None]](), list[float](), list[AdvancedSource]()

    def later(seconds: float, job: Callable[[], None], *, background: bool) -> None:
        assert background
        pauses.append(seconds)
        jobs.append(job)

    worker = SimpleNamespace(do=jobs.append, later=later)
    Upstream({"system": session}, worker).search("system", "**", found.append)  # type: ignore[dict-item,arg-type]
    told = []
    while jobs:
        jobs.pop()()
        told.append([source.zid for source in found])
    assert told == [[], ["abc"], ["abc"], ["abc", "def"], ["abc", "def"]]
    assert pauses == [0.001, 0.002, 0.004, 0.008]
