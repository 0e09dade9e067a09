from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.router.advanced.publisher_state import PublisherState, Relayed, relayed
from riot_bus.router.advanced.source import UNNUMBERED, AdvancedSource, announced, source_of
from riot_bus.vocabulary.message import Message, Qos


@pytest.mark.parametrize(
    ("token", "expected"),
    [
        ("a/b/@adv/pub/3f2a/7/_", AdvancedSource("s", "a/b", "3f2a", "7")),
        ("a/b/@adv/pub/3f2a/uhlc/_", AdvancedSource("s", "a/b", "3f2a", UNNUMBERED)),
        ("a/@adv/pub/3f2a/7/meta/more", AdvancedSource("s", "a", "3f2a", "7")),
        ("a/@adv/pub/x/@adv/pub/3f2a/7/_", AdvancedSource("s", "a/@adv/pub/x", "3f2a", "7")),
        ("a/@adv/pub/3f2a/**", AdvancedSource("s", "a", "3f2a", "**")),
        ("a/@adv/pub/3f2a", None),
        ("a/@adv/pub/**", None),
        ("a/@adv/sub/3f2a/7/_", None),
        ("a/*/@adv/pub/3f2a/7/_", None),
        ("a/b", None),
    ],
)
def test_tokens_tell_the_publisher(token: str, expected: AdvancedSource | None) -> None:
    assert announced("s", token) == expected


def test_only_numbered_publishers_are_numbered() -> None:
    assert AdvancedSource("s", "a", "3f2a", "7").numbered
    assert not AdvancedSource("s", "a", "3f2a", UNNUMBERED).numbered


def sample(**more: Any) -> Any:
    return SimpleNamespace(**{"source_info": None, "timestamp": None, "key_expr": "a/b", **more})


def test_a_sample_tells_its_publisher_by_number_else_by_time() -> None:
    stamp = SimpleNamespace(
        get_id=lambda: "3f2a", get_time_as_ntp64=lambda: SimpleNamespace(as_nanos=lambda: 1_000_000_007)
    )
    info = SimpleNamespace(source_id=SimpleNamespace(zid="77", eid=4), source_sn=12)
    assert source_of("s", sample(source_info=info, timestamp=stamp)) == (AdvancedSource("s", "a/b", "77", "4"), 12)
    assert source_of("s", sample(timestamp=stamp)) == (AdvancedSource("s", "a/b", "3f2a", UNNUMBERED), 1_000_000_007)
    assert source_of("s", sample()) is None


def test_what_interceptors_make_of_a_message_belongs_to_its_publisher() -> None:
    state = PublisherState(AdvancedSource("s", "a", "3f2a", "7"), again=False, token=True)
    message = Message(1, "a", b"x", "put", "text/plain", b"y", Qos(2), "s", 5, 6)
    found = relayed(message, state)
    changed = found.with_payload(b"z").with_(key="b")
    assert isinstance(changed, Relayed)
    assert changed.state is found.state is state
    assert (changed.key, changed.payload) == ("b", b"z")
    for name in ("time", "kind", "encoding", "attachment", "qos", "segment", "sequence", "publish_time"):
        assert getattr(changed, name) == getattr(found, name) == getattr(message, name)
