"""A segment as bridges see it, with real sessions."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh.segment_port import open_port
from riot_bus.zenoh.session import free_endpoint, wait_until
from riot_bus_bridges.host.outer_port import OuterPort, Question
from tests.integration.zenoh_process import ZenohProcess

pytestmark = pytest.mark.integration

WAIT_S = 60.0
KEY = "0/add/T/H"


class Answers:
    """Collects what a question leads to."""

    def __init__(self) -> None:
        self.found: list[bytes | None] = []
        self._bell = threading.Condition()

    def take(self, answer: bytes | None) -> None:
        with self._bell:
            self.found.append(answer)
            self._bell.notify_all()

    def wait(self, count: int = 1, timeout: float = WAIT_S) -> list[bytes | None]:
        with self._bell:
            self._bell.wait_for(lambda: len(self.found) >= count, timeout)
            return list(self.found)


@pytest.fixture
def ports() -> Iterator[tuple[OuterPort, OuterPort, OuterPort]]:
    with (
        ZenohProcess("router") as router,
        open_port(OuterPort, router.locators) as one,
        open_port(OuterPort, [free_endpoint(), *router.locators]) as other,
        open_port(OuterPort, router.locators) as third,
    ):
        yield one, other, third


def asked(port: OuterPort, payload: bytes = b"?") -> Answers:
    answers = Answers()
    port.ask(KEY, payload, b"attached", answers.take)
    return answers


def test_the_first_answer_counts_though_another_server_is_slow(
    ports: tuple[OuterPort, OuterPort, OuterPort],
) -> None:
    one, other, third = ports
    waiting: list[Question] = []
    one.serve(KEY, waiting.append)
    other.serve(KEY, lambda question: question.answer(question.payload + (question.attachment or b""), None))

    def both() -> bool:
        found = asked(third).wait(timeout=1.0)
        assert found in ([b"?attached"], [None], [])  # nothing as long as only the slow one is known
        return found == [b"?attached"] and bool(waiting)

    assert wait_until(both, WAIT_S)
    answers = asked(third)
    assert answers.wait() == [b"?attached"]
    assert wait_until(lambda: len(waiting) >= 2, WAIT_S)
    for question in waiting:
        question.answer(b"late", None)
    assert answers.wait(2, 0.5) == [b"?attached"]


def test_nobody_and_errors_are_no_answer(ports: tuple[OuterPort, OuterPort, OuterPort]) -> None:
    one, other, _ = ports
    assert asked(one).wait() == [None]
    served_by = other.serve(KEY, lambda question: question.fail("broken"))
    assert asked(one).wait() == [None]
    served_by.close()


def test_what_is_given_up_ends_nowhere(ports: tuple[OuterPort, OuterPort, OuterPort]) -> None:
    one, other, _ = ports
    waiting: list[Question] = []
    one.serve(KEY, waiting.append)
    answers = Answers()

    def arrived() -> bool:
        answers.found.clear()
        question = other.ask(KEY, b"?", b"", answers.take)
        if not wait_until(lambda: bool(waiting), 1.0):
            return False
        question.close()
        question.close()
        return True

    assert wait_until(arrived, WAIT_S)
    for question in waiting:
        question.answer(b"late", None)
    assert answers.wait(1, 0.5) == []
    again = asked(other)
    assert wait_until(lambda: len(waiting) >= 2, WAIT_S)
    waiting[-1].answer(b"now", None)
    assert again.wait() == [b"now"]


def test_tokens_that_are_there_are_told_before_watch_returns(
    ports: tuple[OuterPort, OuterPort, OuterPort],
) -> None:
    one, other, _ = ports
    tokens = {f"@x/{number}" for number in range(50)}
    declared = [one.announce(each) for each in sorted(tokens)]
    seen: set[str] = set()
    lock = threading.Lock()

    def take(token: str, present: bool) -> None:
        with lock:
            (seen.add if present else seen.discard)(token)

    first = other.watch("@x/*", take)
    assert wait_until(lambda: seen == tokens, WAIT_S)
    first.close()
    seen.clear()
    watching = other.watch("@x/*", take)
    assert seen == tokens
    for each in declared:
        each.close()
    assert wait_until(lambda: not seen, WAIT_S)
    watching.close()


def test_who_stops_watching_tokens_is_told_no_more_and_others_are(
    ports: tuple[OuterPort, OuterPort, OuterPort],
) -> None:
    one, other, _ = ports
    former: list[tuple[str, bool]] = []
    latter: list[tuple[str, bool]] = []
    first = other.watch("@x/*", lambda *change: former.append(change))
    second = other.watch("@x/*", lambda *change: latter.append(change))
    token = one.announce("@x/a")
    assert wait_until(lambda: len(latter) == 1, WAIT_S)
    first.close()
    first.close()
    token.close()
    assert wait_until(lambda: len(latter) == 2, WAIT_S)
    second.close()
    assert former == [("@x/a", True)]
    assert latter == [("@x/a", True), ("@x/a", False)]


def test_nobody_there_is_an_error() -> None:
    with pytest.raises(EnvironmentFaultError):
        open_port(OuterPort, [free_endpoint()])


def test_what_is_collected_comes_in_its_order_and_none_is_left_behind(
    ports: tuple[OuterPort, OuterPort, OuterPort],
) -> None:
    one, other, _ = ports
    turns: list[list[tuple[bytes, bytes | None]]] = []
    began, go_on = threading.Event(), threading.Event()

    def take(messages: list[tuple[bytes, bytes | None]]) -> None:
        turns.append(messages)
        began.set()
        assert go_on.wait(WAIT_S)
        if len(turns) == 2:
            raise ValueError("a failure of who takes them")

    heard = threading.Event()
    collected = other.collect(KEY, take)
    other.subscribe(KEY, lambda payload, attachment: heard.set() if payload == b"last" else None)
    outlet = one.publisher(KEY, reliable=True)
    assert wait_until(outlet.matched, WAIT_S)
    outlet.put(b"first", b"@")
    assert began.wait(WAIT_S)
    payloads = [b"%d" % number for number in range(200)]
    assert one.put_all([outlet] * 201, [*payloads, b"last"], b"@") == 0
    assert heard.wait(WAIT_S)  # so those before it are in the channel
    closing = threading.Thread(target=collected.close)
    closing.start()
    go_on.set()
    closing.join()
    sent = [b"first", *payloads, b"last"]
    got = [message for turn in turns for message in turn]
    assert got in ([(each, b"@") for each in sent], [(each, b"@") for each in sent[:-1]])
    assert max(map(len, turns)) == 64
