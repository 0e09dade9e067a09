"""What of a plain Zenoh system shows passively: on routers of riot and of others, and in recordings."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import pytest

from riot_bus.zenoh.session import free_endpoint, wait_until
from tests.integration.plain_system import plain_system
from tests.integration.router_process import RouterProcess, riot
from tests.integration.zenoh_process import ZenohProcess

pytestmark = [pytest.mark.integration, pytest.mark.timeout(300)]

SEGMENTS = dict.fromkeys(("world", "mind", "body"), "tcp/127.0.0.1:0")
USES = {
    "sim": ([], ["imu/raw", "robot/*/pose"]),
    "planner": (["robot/*/pose"], ["plan/cmd"]),
    "arm": (["imu/raw", "plan/cmd"], []),
}


def init(*words: Any, cwd: Path) -> dict[str, Any]:
    code, out, err = riot("init", "--force", "--format=json", *map(str, words), cwd=cwd)
    assert code == 0, err
    found: dict[str, Any] = json.loads(out)
    return found


def uses(found: dict[str, Any], *, by: str = "name") -> dict[str, tuple[list[str], list[str]]]:
    return {each[by]: (each["inputs"], each["outputs"]) for each in found["components"]}


def test_a_segment_for_each_component_tells_all_and_so_does_the_routers_log(tmp_path: Path) -> None:
    with RouterProcess("--intercept=**", "--record=router.mcap", endpoints=SEGMENTS, cwd=tmp_path) as router:
        world, mind, body = (router.endpoints[name] for name in SEGMENTS)
        words = {"sim": ["--connect", world], "planner": [], "arm": ["--connect", body]}
        with plain_system(tmp_path, {**words, "planner": ["--connect", mind]}):

            def told() -> bool:
                out = riot("graph", "-e", world, "--format=json")[1]
                return sum(each["role"] == "subscribes" for each in json.loads(out)["edges"]) == 4

            assert wait_until(told, 30)
            found = init("-e", mind, "--seconds=1", cwd=tmp_path)
        router.end(signal.SIGTERM)
    assert uses(found) == {f"node_{role}": each for role, each in USES.items()}
    assert {each["name"]: each["segment"] for each in found["components"]} == {
        "node_sim": "world", "node_planner": "mind", "node_arm": "body",
    }  # fmt: skip
    assert found["external"] == {"imu/raw": "from node_sim", "robot/*/pose": "from node_sim"}
    assert [each.partition(":")[0] for each in found["fill_in"]] == ["types"]
    assert found["topics"]["robot/*/pose"]["keys"] == ["robot/1/pose", "robot/2/pose"]

    logged = init("--log", "router.mcap", cwd=tmp_path)
    segments = dict(zip(USES, SEGMENTS, strict=True))
    assert uses(logged, by="segment") == {segments[role]: each for role, each in USES.items()}
    assert {tuple(each["command"]) for each in logged["components"]} == {("FILL_IN",)}
    assert 'nominal = "router.mcap"' in (tmp_path / "riot.toml").read_text()


@pytest.mark.parametrize("admin", [True, False])
def test_routers_of_others_tell_commands_and_keys_and_stamps_tell_who_publishes(tmp_path: Path, admin: bool) -> None:
    endpoint = free_endpoint()
    with ZenohProcess("router", listen__endpoints=[endpoint], adminspace__enabled=admin):
        words = {"sim": ["--connect", endpoint], "planner": []}
        with plain_system(tmp_path, words, {"PLAIN_CONNECT": endpoint, "PLAIN_STAMPS": "1"}):
            found = init("-e", endpoint, "--seconds=1", "--record=look.mcap", cwd=tmp_path)
    sim, planner = (next(each for each in found["components"] if each["name"] == f"node_{role}") for role in words)
    assert sim["command"] == ["{python}", "node.py", "sim", "--connect", "{endpoint}"]
    assert planner["command"] == ["{python}", "node.py", "planner"]
    assert planner["env"] == {"PLAIN_CONNECT": "{endpoint}", "PLAIN_STAMPS": "1"}
    if admin:
        assert (sim["outputs"], planner["outputs"]) == (["imu/raw", "robot/*/pose"], ["plan/cmd"])
        assert found["unknown_publisher"] == []
    else:  # sessions and processes cannot be brought together
        assert found["unknown_publisher"] == ["imu/raw", "plan/cmd", "robot/*/pose"]
    assert "components.node_planner: what it reads and writes" not in found["fill_in"] or not admin

    alone = init("--log", "look.mcap", cwd=tmp_path)
    assert [each["name"] for each in alone["components"]] == ["component"]
    assert alone["unknown_publisher"] == ["imu/raw", "plan/cmd", "robot/*/pose"]
    assert alone["topics"]["plan/cmd"]["type"] == "cbor"


def test_nobody_there(tmp_path: Path) -> None:
    with RouterProcess(endpoints={"system": "tcp/127.0.0.1:0"}) as router:
        for _ in range(2):  # the first attempt leaves nothing that a second one would be refused for
            options = ["-e", router.endpoints["system"], "--seconds=0.5", "--record", "nominal.mcap"]
            code, _, err = riot("init", *options, cwd=tmp_path)
            assert (code, "neither components nor messages were seen" in err) == (4, True), err
    assert not list(tmp_path.iterdir())
