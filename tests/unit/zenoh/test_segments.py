from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from riot_bus.vocabulary.errors import EnvironmentFaultError
from riot_bus.zenoh import segments as module
from riot_bus.zenoh.segments import EPHEMERAL, Segment, is_open_to_all


class Session:
    """A session that listens where it is told to."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self.settings = settings
        self.closed = 0
        self.asked: list[str] = []
        others = [SimpleNamespace(zid=zid) for zid in ("b", "c", "b")]
        self.info = SimpleNamespace(zid=lambda: "a", transports=lambda: others)

    def get(self, selector: str, *, timeout: float) -> list[Any]:
        self.asked.append(selector)
        return []

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def borrowed(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Copies of the library that are in use."""
    copies: list[object] = []

    def borrow() -> object:
        copies.append(object())
        return copies[-1]

    monkeypatch.setattr(module, "borrow", borrow)
    monkeypatch.setattr(module, "give_back", copies.remove)
    monkeypatch.setattr(module, "open_session", lambda settings, *, purpose, library: Session(settings))
    monkeypatch.setattr(module, "listening", lambda session: session.settings["listen/endpoints"])
    return copies


def test_components_see_only_their_own_endpoints(borrowed: list[object]) -> None:
    segment = Segment("unit", ["tcp/x:1"], doors=["unixsock-stream/door"], hidden=["unixsock-stream/hidden"])
    assert segment.endpoints == ("tcp/x:1",)
    assert segment.doors == ("unixsock-stream/door",)
    settings: Any = segment.session.settings  # type: ignore[attr-defined]
    assert settings["listen/endpoints"] == ["tcp/x:1", "unixsock-stream/door", "unixsock-stream/hidden"]
    assert Segment("unit").endpoints == (EPHEMERAL,)


def test_only_links_of_this_process_are_tried_again_soon_and_the_user_has_the_last_word(borrowed: list[object]) -> None:
    def settings(**more: Any) -> Any:
        return Segment("unit", **more).session.settings  # type: ignore[attr-defined]

    assert "connect/retry" not in settings(connect=["tcp/x:1"])
    inner = settings(connect=["tcp/x:1"], inner=["unixsock-stream/in"])
    assert inner["connect/endpoints"] == ["tcp/x:1", "unixsock-stream/in"]
    assert inner["connect/retry"]["period_max_ms"] < 100
    assert settings(inner=["unixsock-stream/in"], config={"connect/retry": 7})["connect/retry"] == 7


def test_each_neighbour_is_waited_for(borrowed: list[object]) -> None:
    segment = Segment("unit")
    assert segment.peers() == {"b", "c"}
    segment.flush(["b", "c"])
    assert segment.session.asked == ["@/b/router", "@/c/router"]  # type: ignore[attr-defined]


def test_the_library_is_given_back_once(borrowed: list[object]) -> None:
    segment = Segment("unit")
    assert len(borrowed) == 1
    segment.close()
    segment.close()
    assert borrowed == []


def test_the_library_is_given_back_if_the_segment_cannot_open(
    borrowed: list[object], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise EnvironmentFaultError("in use")

    monkeypatch.setattr(module, "open_session", refuse)
    with pytest.raises(EnvironmentFaultError):
        Segment("unit")
    assert borrowed == []


@pytest.mark.parametrize(
    ("listen", "config", "expected"),
    [
        ([], {}, True),
        (["tcp/127.0.0.1:1"], {}, True),
        (["tcp/127.0.0.1:1", "tls/x:2"], {}, True),
        (["tls/x:2", "tcp/127.0.0.1:1"], {}, False),
        (["ws/x:2"], {}, False),
        (["tcp/127.0.0.1:1"], {"transport/auth/usrpwd/user": "a"}, False),
        (["tcp/127.0.0.1:1"], {"access_control/enabled": True}, False),
        (["tcp/127.0.0.1:1"], {"transport/shared_memory/enabled": True}, True),
    ],
)
def test_who_may_connect(listen: list[str], config: dict[str, Any], *, expected: bool) -> None:
    assert is_open_to_all(listen, config) is expected
