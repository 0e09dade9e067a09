"""What is kept of a trial's outputs, to see whether injections changed them."""

from __future__ import annotations

from riot_bus.trial.unit_trial import _shown
from riot_bus.vocabulary.message import Message


def test_outputs_are_counted_and_their_order_does_not_matter() -> None:
    one, other = Message(1, "state", b"a"), Message(2, "state", b"b")
    assert _shown([one, other]) == _shown([other.with_(time=7), one])
    assert _shown([one, one]) != _shown([one, other])
    assert {key: count for key, (count, _) in (_shown([one, other, Message(3, "log", b"")]) or {}).items()} == {
        "state": 2,
        "log": 1,
    }


def test_of_too_many_keys_nothing_is_kept() -> None:
    assert _shown([Message(1, f"key{number}", b"") for number in range(65)]) is None
