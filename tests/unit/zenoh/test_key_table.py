from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from riot_bus.zenoh.key_table import KeyTable, KnownKey


def sample(sender: str | None = None) -> Any:
    stamp = None if sender is None else SimpleNamespace(get_id=lambda: sender)
    return SimpleNamespace(priority=5, congestion_control=0, express=False, encoding="text", timestamp=stamp)


def table(most: int = 10, forgotten: list[str] | None = None) -> KeyTable[KnownKey]:
    told = [] if forgotten is None else forgotten
    return KeyTable(
        lambda key, found: None if key == "other" else KnownKey(key, found),
        most=most,
        forget=lambda: told.append("forgotten"),
    )


def test_a_key_is_known_by_the_settings_of_its_first_sample() -> None:
    keys: Any = table()
    known = keys.learn("a", sample())
    assert keys.known == {"a": known}
    assert (known.key, known.priority, known.congestion, known.express, known.encoding) == ("a", 5, 0, False, "text")
    assert keys.learn("other", sample()) is None
    assert keys.known["other"] is None


def test_too_many_keys_are_forgotten_all_at_once() -> None:
    forgotten: list[str] = []
    keys: Any = table(2, forgotten)
    for key in ("a", "b", "c"):
        keys.learn(key, sample())
    assert list(keys.known) == ["c"]
    assert forgotten == ["forgotten"]


def test_what_is_forgotten_while_it_is_learned_does_not_come_back() -> None:
    keys: Any = None

    def learn(key: str, found: Any) -> KnownKey:
        keys.forget()
        return KnownKey(key, found)

    keys = KeyTable(learn, most=10)
    assert keys.learn("a", sample()).key == "a"
    assert keys.known == {}


def test_senders_are_kept_within_bounds() -> None:
    keys = table(2)
    for number in range(100):
        keys.note_sender("a", sample(f"{number:x}"))
    keys.note_sender("b", sample("1"))
    keys.note_sender("c", sample("1"))
    keys.note_sender("a", sample(None))
    keys.forget()
    assert {key: len(zids) for key, zids in keys.senders().items()} == {"a": 64, "b": 1}
