from __future__ import annotations

import json

import pytest

from riot_bus.log import account as module
from riot_bus.log.account import Account, LossCounts, account_of

FULL = Account({"/a": 3}, {"disk": {"/a": 2}, "missed": {"/b": 1}}, {"paused": {"/c": 4}})


def test_it_comes_back_from_a_record() -> None:
    assert account_of(FULL.record()) == FULL
    assert account_of(Account().record()) == Account()
    assert (bool(FULL), bool(Account({"/a": 3})), FULL.total(), FULL.total("disk")) == (True, False, 3, 2)


def test_topics_without_number_do_not_fill_the_record(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_TOPICS", 2)
    found = account_of(Account({f"/{number}": number for number in range(5)}).record())
    assert found is not None
    assert found.recorded == {"/4": 4, "/3": 3, "(other topics)": 3}


@pytest.mark.parametrize(
    "record",
    [
        {},
        {"version": "2", "recorded": "{}", "lost": "{}", "left_out": "{}"},
        {"version": "1", "recorded": "x", "lost": "{}", "left_out": "{}"},
        {"version": "1", "recorded": "[]", "lost": "{}", "left_out": "{}"},
        {"version": "1", "recorded": "{}", "lost": '{"disk": 1}', "left_out": "{}"},
        {"version": "1", "recorded": '{"a": "b"}', "lost": "{}", "left_out": "{}"},
        {"version": "1", "recorded": "[" * 100_000, "lost": "{}", "left_out": "{}"},
        {"version": "1", "recorded": json.dumps({"a": 1}), "lost": "{}"},
    ],
)
def test_damage_is_no_account(record: dict[str, str]) -> None:
    assert account_of(record) is None


def test_several_accounts_are_added_and_their_topics_renamed():
    first = Account({"/a": 2, "/b": 1}, {"disk": {"/a": 1}}, {"paused": {"/b": 3}})
    second = Account({"/a": 5}, {"disk": {"/a": 2}, "missed": {"/b": 4}})
    total = Account.total_of([first, second])
    assert total == Account({"/a": 7, "/b": 1}, {"disk": {"/a": 3}, "missed": {"/b": 4}}, {"paused": {"/b": 3}})
    assert total.renamed({"/a": "/x", "/b": "/x"}).recorded == {"/x": 8}
    assert total.renamed({"/a": "/x"}).lost == {"disk": {"/x": 3}, "missed": {}}
    assert Account.total_of([]) == Account()


def test_what_was_written_and_lost_afterwards_is_not_recorded():
    counts = LossCounts()
    counts.recorded.add("a", 5)
    counts.lose("disk", "a", 2, written=True)
    counts.lose("missed", "a")
    counts.left_out["paused"].add("b")
    assert counts.account() == Account({"a": 3}, {"disk": {"a": 2}, "missed": {"a": 1}}, {"paused": {"b": 1}})
    counts.lose("disk", "a", 3, written=True)
    assert counts.account().recorded == {}
