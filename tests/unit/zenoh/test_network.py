from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from riot_bus.config.router_settings import SegmentSettings
from riot_bus.vocabulary.errors import ConfigError, EnvironmentFaultError
from riot_bus.zenoh import network as module
from riot_bus.zenoh.network import Network

PROTOCOLS = "transport/link/protocols"
steps: list[str] = []


class Segment:
    def __init__(self, name: str, listen: Any, **more: Any) -> None:
        if name == "broken":
            raise EnvironmentFaultError("in use")
        self.name, self.more = name, more
        self.session = f"session of {name}"
        steps.append(f"open {name}")

    def close(self) -> None:
        steps.append(f"close {self.name}")


class Junction:
    def __init__(self, segments: list[Segment], **more: Any) -> None:
        self.names, self.more, self.zid = [each.name for each in segments], more, ""
        steps.append("junction")

    def begin(self, cut: Any, services: Any) -> None:
        self.zid = "j"
        steps.append(f"join {' '.join(cut)}")

    def close(self) -> None:
        steps.append("close junction")


class Direct:
    def __init__(self, names: list[str], folder: Path, **more: Any) -> None:
        self.ids = set(names)

    def connect(self, name: str) -> list[str]:
        return [f"to/{name}"]

    def listen(self, name: str) -> list[str]:
        return [f"at/{name}"]

    def config(self, name: str) -> dict[str, Any]:
        return {"id": name}

    def complete(self, segments: Any) -> None:
        steps.append("linked")

    def sever(self, segments: Any) -> None:
        steps.append("sever")


@pytest.fixture(autouse=True)
def without_zenoh(monkeypatch: pytest.MonkeyPatch) -> None:
    steps.clear()
    for name, fake in {"Segment": Segment, "Junction": Junction, "DirectLinks": Direct}.items():
        monkeypatch.setattr(module, name, fake)


def test_it_opens_once_and_closes_in_reverse() -> None:
    network = Network({"a": (), "b": ()})
    with network:
        network.open()
        network.begin(["k"])
        assert dict[str, object](network.sessions) == {"a": "session of a", "b": "session of b"}
        assert network.linked() == {"a", "b", "j"}
        assert network.segments["a"].more["hidden"] == ["at/a"]  # type: ignore[attr-defined]
        assert network.segments["a"].more["config"] == {"id": "a"}  # type: ignore[attr-defined]
        steps.append("use")
    network.close()
    opened, closed = steps[: steps.index("use")], steps[steps.index("use") + 1 :]
    assert opened == ["open a", "open b", "linked", "junction", "join k"]
    assert closed == ["close junction", "sever", "close b", "sever", "close a"]


def test_one_segment_needs_no_junction() -> None:
    with Network({"a": ()}) as network:
        network.begin()
        assert (network.junction, network.direct, network.linked()) == (None, None, set())


def test_a_bus_has_a_segment() -> None:
    with pytest.raises(ConfigError, match="at least one segment"):
        Network({})


def test_if_one_cannot_open_the_others_are_closed() -> None:
    with pytest.raises(EnvironmentFaultError):
        Network({"a": (), "broken": ()}).open()
    assert steps == ["open a", "sever", "close a"]


def test_the_junction_connects_to_open_segments_and_waits_for_the_others() -> None:
    closed = SegmentSettings(config={"access_control/enabled": True})
    with Network({"a": (), "b": closed}) as network:
        a, b = (each.more for each in network.segments.values())  # type: ignore[attr-defined]
        assert len(a["doors"]) == len(b["inner"]) > 0
        assert (list(a["inner"]), list(b["doors"])) == ([], [])
        assert network.junction.more["inner"] == b["inner"]  # type: ignore[union-attr]
        assert network.direct is None  # what the user restricts is not linked behind their back


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["tcp"], ["tcp", "unixsock-stream"]),
        (["unixsock-stream", "tcp"], ["unixsock-stream", "tcp"]),
        ([], []),
    ],
)
def test_segments_with_few_protocols_can_still_be_linked(given: list[str], expected: list[str]) -> None:
    with Network({"a": ()}, config={PROTOCOLS: given}) as network:
        assert network.segments["a"].more["config"][PROTOCOLS] == expected  # type: ignore[attr-defined]


def test_settings_of_a_segment_win_over_those_of_all() -> None:
    shared = "transport/shared_memory/enabled"
    settings = {"a": SegmentSettings(config={shared: True}), "b": SegmentSettings()}
    with Network(settings, config={shared: False}) as network:
        found = [each.more["config"][shared] for each in network.segments.values()]  # type: ignore[attr-defined]
    assert found == [True, False]
