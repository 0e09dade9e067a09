"""The asking end of control; the session is a fake that answers as a test says."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.control import remote
from riot_bus.control.commands import VERSION, refusal
from riot_bus.control.remote import ForgedAnswerError, Remote, ask, document_of, error_from, find_routers, plan_payload
from riot_bus.vocabulary.errors import ConfigError, DataLossError, EnvironmentFaultError, InconclusiveError


class Session:
    """Answers questions with lists of replies, one list a time; the last one again and again."""

    def __init__(self) -> None:
        self.routers = ["base"]
        self.rounds: list[list[Any]] = [[]]
        self.asked: list[tuple[str, bytes | None]] = []
        self.closed = 0

    def get(self, selector: str, handler: Any = None, *, payload: bytes | None = None, **_: Any) -> list[Any]:
        if handler is None:
            assert selector.split("/")[1] == "*"
            keys = [f"{selector.split('/')[0]}/{name}/status" for name in self.routers]
            return [SimpleNamespace(ok=SimpleNamespace(key_expr=key)) for key in keys]
        self.asked.append((selector.partition("/")[2], payload))
        replies = self.rounds.pop(0) if len(self.rounds) > 1 else self.rounds[0]
        for each in replies:
            handler.callback(each)
        handler.drop()
        return []

    def close(self) -> None:
        self.closed += 1


def good(**result: Any) -> Any:
    data = json.dumps({"version": VERSION, "result": result}).encode()
    return SimpleNamespace(ok=SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: data)), err=None)


def bad(data: bytes) -> Any:
    return SimpleNamespace(ok=None, err=SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: data)))


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Session:
    found = Session()
    client = SimpleNamespace(session=found, close=found.close)
    monkeypatch.setattr(remote, "open_client", lambda *_, **__: client)
    return found


def test_the_only_router_is_asked_and_the_connection_closed(session: Session) -> None:
    session.rounds = [[good(state="fine")]]
    assert ask("tcp/a:1", None, "plan/load", b"text", parameters="name=p") == {"state": "fine"}
    assert session.asked == [("base/plan/load?name=p", b"text")]
    assert session.closed == 1


def test_a_question_that_is_lost_is_asked_again(session: Session) -> None:
    timeout = bad(b"Timeout")  # Zenoh's own
    session.rounds = [[], [timeout], [], [good(n=1)]]
    assert ask("tcp/a:1", "base", "counts") == {"n": 1}
    assert len(session.asked) == 4


def test_a_router_that_is_there_but_never_answers(session: Session) -> None:
    with pytest.raises(EnvironmentFaultError, match="router 'base' did not answer\n") as caught:
        ask("tcp/a:1", "base", "counts")
    assert "asked too often" in str(caught.value.hint)
    assert len(session.asked) == 8
    with Remote("tcp/a:1", "base") as asking, pytest.raises(EnvironmentFaultError, match="in 0 s"):
        asking.ask("counts", timeout=0)


def test_who_is_not_there_is_told_with_who_is(session: Session) -> None:
    session.routers = ["b", "a", "b"]
    assert find_routers("tcp/a:1") == ["a", "b"]
    with pytest.raises(EnvironmentFaultError, match="no router 'base' answers") as caught:
        ask("tcp/a:1", "base", "counts")
    assert (caught.value.where, caught.value.hint) == ("tcp/a:1", "there are a, b")
    with pytest.raises(ConfigError, match="several players answer: a, b") as several:
        ask("tcp/a:1", None, "play/status", kind="player")
    assert several.value.hint == "choose one: --player NAME"
    session.routers = []
    with pytest.raises(EnvironmentFaultError, match="no riot recorder answers") as caught:
        ask("tcp/a:1", None, "record/status", kind="recorder")
    assert "riot record running" in str(caught.value.hint)


def test_a_refusal_is_raised_as_the_error_that_it_was(session: Session) -> None:
    no = bad(refusal("base", DataLossError("gone", where="a.mcap")))
    session.rounds = [[no, no]]  # two segments of one router
    with pytest.raises(DataLossError, match="gone") as caught:
        ask("tcp/a:1", "base", "record/stop")
    assert caught.value.where == "a.mcap"


@pytest.mark.parametrize("second", [good(n=2), bad(refusal("base", ConfigError("no")))])
def test_two_answers_are_one_too_many(session: Session, second: Any) -> None:
    session.rounds = [[good(n=1), second]]
    with pytest.raises(ForgedAnswerError, match="2 answers to one 'status'"):
        ask("tcp/a:1", "base", "status")


def test_another_version_cannot_be_read(session: Session) -> None:
    data = json.dumps({"version": 99, "result": {}}).encode()
    session.rounds = [[SimpleNamespace(ok=SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: data)), err=None)]]
    with pytest.raises(EnvironmentFaultError, match=f"version 99 of the format, not {VERSION}"):
        ask("tcp/a:1", "base", "status")


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        (2, ConfigError),
        (3, DataLossError),
        (4, EnvironmentFaultError),
        (InconclusiveError.exit_code, InconclusiveError),
        (1, EnvironmentFaultError),
        ("x", ConfigError),
        ([], ConfigError),
    ],
)
def test_exit_codes_become_errors(code: Any, kind: type[Exception]) -> None:
    found = error_from({"exit_code": code, "message": "a\x1b[2J\nb", "where": ["odd"]})
    assert type(found) is kind
    assert (found.message, found.where, found.hint) == ("a\\x1b[2J\nb", "['odd']", None)


def test_data_that_is_no_object_is_quoted() -> None:
    assert document_of(b'{"a": 1}') == {"a": 1}
    assert document_of(b"[1]") == {"message": "[1]"}
    assert document_of(b"\xff" * 999) == {"message": "\ufffd" * 200}
    assert error_from(document_of(b"")).message == "it does not say why"


def test_a_plan_is_sent_under_a_name_without_odd_characters(tmp_path: Path) -> None:
    file = tmp_path / "my plan;v=1.toml"
    with pytest.raises(ConfigError, match="cannot read the injection plan"):
        plan_payload(file)
    file.write_bytes(b"text")
    assert plan_payload(file) == (b"text", "name=my_plan_v_1.toml")
