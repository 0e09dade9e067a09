from __future__ import annotations

from pathlib import Path

import pytest

from riot_bus.zenoh.direct_links import DirectLinks, are_possible
from riot_bus.zenoh.session_config import access_control


def test_each_link_has_a_listener_a_caller_and_a_guard_at_each_end(tmp_path: Path) -> None:
    links = DirectLinks(["a", "b", "c"], tmp_path, cut=["x/**"], services=["s"])
    heard = {name: links.listen(name) for name in "abc"}
    assert [len(each) for each in heard.values()] == [1, 1, 0]
    called = {name: [each.split("#")[0] for each in links.connect(name)] for name in "abc"}
    assert called == {"a": [], "b": heard["a"], "c": heard["a"] + heard["b"]}
    configs = {name: links.config(name) for name in "abc"}
    ids = {name: config.pop("id") for name, config in configs.items()}
    assert links.ids == set(ids.values())
    assert all(len(each) == 32 and each[0] != "0" for each in links.ids)
    assert configs == {
        name: access_control(["x/**"], services=["s"], peers=[ids[other] for other in others])
        for name, others in {"a": "bc", "b": "ac", "c": "ab"}.items()
    }
    assert links.cuts(["x/**"], ["s"])
    assert not links.cuts(["x/**"], [])


@pytest.mark.parametrize(
    ("key", "possible"),
    [
        ("transport/link/tls/enable_mtls", True),
        ("identity", True),
        ("transport/auth/usrpwd/user", False),
        ("transport", False),
        ("access_control", False),
        ("access_control/enabled", False),
        ("connect/endpoints", False),
        ("connect", False),
        ("id", False),
    ],
)
def test_what_the_user_has_decided_is_left_alone(key: str, *, possible: bool) -> None:
    assert are_possible({"a": {}, "b": {key: True}}) == possible
