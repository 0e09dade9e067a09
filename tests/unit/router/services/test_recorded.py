from __future__ import annotations

from riot_bus.router.services.recorded import RecordedService, calls_in
from riot_bus.types.serve import Request
from riot_bus.vocabulary.message import Message


def request(number: int, payload: bytes, parameters: str = "", key: str = "calc/add") -> Request:
    return Request(number, f"{key}/@request", payload, sequence=number, parameters=parameters)


def reply(number: int, payload: bytes, part: str = "@reply", key: str = "calc/add") -> Message:
    return Message(number + 100, f"{key}/{part}", payload, sequence=number)


LOG = [
    request(1, b"a"),
    Message(2, "calc/topic", b"a"),
    request(2, b"b"),
    reply(2, b"B"),
    reply(1, b"A1"),
    reply(1, b"A2"),
    request(3, b"a"),
    request(4, b"a", key="calc/sub"),
    reply(3, b"not so", "@error"),
    reply(9, b"of a call before the log"),
]


def payloads(service: RecordedService, *asked: bytes, parameters: str = "") -> list[list[bytes]]:
    return [[each.payload for each in service.replies(one, parameters)] for one in asked]


def test_calls_are_put_together_by_their_numbers() -> None:
    found = calls_in(LOG)
    assert list(found) == ["calc/add"]  # nobody has answered the other one
    told = [(call.request.payload, [each.payload for each in call.replies]) for call in found["calc/add"]]
    assert told == [(b"a", [b"A1", b"A2"]), (b"b", [b"B"]), (b"a", [b"not so"])]


def test_the_same_question_gets_its_answers_one_after_the_other() -> None:
    service = RecordedService(calls_in(LOG)["calc/add"])
    asked = payloads(service, b"a", b"b", b"a", b"b", b"a")
    assert asked == [[b"A1", b"A2"], [b"B"], [b"not so"], [b"B"], [b"not so"]]


def test_another_question_gets_the_answer_of_its_number() -> None:
    service = RecordedService(calls_in(LOG)["calc/add"])
    assert payloads(service, b"x", b"a", b"y", b"z", b"z") == [
        [b"A1", b"A2"],
        [b"A1", b"A2"],
        [b"B"],
        [b"not so"],
        [b"not so"],
    ]


def test_parameters_are_part_of_the_question() -> None:
    log = [request(1, b"", "x=1"), reply(1, b"one"), request(2, b"", "x=2"), reply(2, b"two")]
    service = RecordedService(calls_in(log)["calc/add"])
    assert payloads(service, b"", b"", parameters="x=2") == [[b"two"], [b"two"]]
    assert payloads(service, b"", parameters="x=1") == [[b"one"]]
