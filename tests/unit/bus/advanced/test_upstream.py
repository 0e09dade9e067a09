from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from riot_bus.bus.advanced.source import Source
from riot_bus.bus.advanced.upstream import Found, Upstream

SOURCE = Source("system", "k", "abc", "7")


class Session:
    """Notes the question; the test answers."""

    def __init__(self, *, nobody: bool = False) -> None:
        self.selector = ""
        self.nobody = nobody

    def get(self, selector: str, callback: Any, **options: Any) -> None:
        self.selector, self.callback = selector, callback
        if self.nobody:
            callback.drop()


def answer(number: int | None, *, zid: str = "abc", error: bool = False) -> Any:
    info = None if number is None else SimpleNamespace(source_id=SimpleNamespace(zid=zid, eid=7), source_sn=number)
    sample = SimpleNamespace(source_info=info, timestamp=None, key_expr="k")
    return SimpleNamespace(ok=None, err="timeout") if error else SimpleNamespace(ok=sample, err=None)


def ask(*answers: Any, nobody: bool = False, parameters: str = "") -> tuple[Found, str]:
    session, jobs = Session(nobody=nobody), list[Callable[[], None]]()
    worker = SimpleNamespace(do=jobs.append)
    found: list[Found] = []
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
    assert [number for number, _ in found.numbers] == [1, 2, 3]
    assert [source for source, _, _ in found.samples] == [SOURCE] * 3
    assert (found.complete, found.asked) == (True, True)
    assert selector == "k/@adv/pub/abc/7/**"


def test_what_does_not_tell_its_publisher_is_left_out() -> None:
    found, selector = ask(answer(None), answer(5), parameters="?_sn=5..6")
    assert [number for number, _ in found.numbers] == [5]
    assert selector == "k/@adv/pub/abc/7/**?_sn=5..6"


def test_a_question_that_was_not_answered_in_time_is_not_complete() -> None:
    found, _ = ask(answer(1), answer(None, error=True))
    assert len(found.samples) == 1
    assert (found.complete, found.asked) == (False, True)


def test_it_tells_when_there_is_nobody_to_ask() -> None:
    assert ask(nobody=True)[0] == Found([], complete=True, asked=False)
