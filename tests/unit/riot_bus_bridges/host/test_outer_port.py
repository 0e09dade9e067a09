from __future__ import annotations

from types import SimpleNamespace

from riot_bus_bridges.host.outer_port import Question, put_one_by_one


class Query:
    """A query that notes its answers; `gone` is one whose client has left."""

    payload = attachment = None

    def __init__(self, *, gone: bool = False) -> None:
        self.gone, self.answers = gone, []  # type: tuple[bool, list[Any]]

    def reply(self, key: str, payload: bytes, *, attachment: bytes | None) -> None:
        if self.gone:
            raise OSError
        self.answers.append((key, payload, attachment))

    def reply_err(self, reason: str) -> None:
        self.answers.append(reason)

    def drop(self) -> None:
        self.answers.append("end")


def test_a_question_without_payload_is_empty_and_ends_with_its_answer() -> None:
    query = Query()
    question = Question("service", query)  # type: ignore[arg-type]
    assert (question.payload, question.attachment) == (b"", None)
    question.answer(b"yes", b"1")
    assert query.answers == [("service", b"yes", b"1"), "end"]


def test_a_question_may_fail_and_its_client_may_be_gone() -> None:
    query, gone = Query(), Query(gone=True)
    Question("service", query).fail("busy")  # type: ignore[arg-type]
    Question("service", gone).answer(b"yes", None)  # type: ignore[arg-type]
    assert (query.answers, gone.answers) == (["busy", "end"], ["end"])


def test_messages_after_one_that_cannot_be_published_are_published() -> None:
    puts: list[tuple[bytes, bytes]] = []
    good, bad = SimpleNamespace(put=lambda *each: puts.append(each)), SimpleNamespace()
    assert put_one_by_one([good, bad, good], [b"1", b"2", b"3"], b"a") == 1
    assert puts == [(b"1", b"a"), (b"3", b"a")]
