"""What a hostile peer at the fleet's router can do to a robot: nothing that its role does not need."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from riot_bus.control.remote import ForgedAnswerError, Remote
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import wait_until
from riot_bus_fleet.agent.names import ALL_AGENTS
from riot_bus_fleet.agent.proof import is_proved, new_secret, prove
from riot_bus_fleet.agent.remote_operation import RemoteOperation, ask_robot
from tests.integration.access_tools import login, new_rules, options_of, secured
from tests.integration.agent_tools import agent, fleet
from tests.integration.play_tools import MS, numbered, write
from tests.integration.zenoh_process import ZenohProcess
from tests.tiers import chosen, scaled

pytestmark = pytest.mark.integration


@pytest.fixture
def bus() -> Iterator[str]:
    with ZenohProcess("router") as process:
        yield process.locators[0]


@pytest.fixture
def hub() -> Iterator[str]:
    with ZenohProcess("router") as process:
        yield process.locators[0]


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    folder = tmp_path / "logs"
    folder.mkdir()
    write(folder / "log.mcap", numbered(1200, "a/x", period=50 * MS))
    return folder


def start(hub: str, **options: Any) -> RemoteOperation:
    """Let the robot play its log of a minute, and wait until it does."""
    operation = RemoteOperation(hub, "r7", **options)
    operation.begin("play", {"logs": ["log.mcap"], "wait": 0.0, "grace": 2.0})
    operation.follow(lambda *_: None, give_up=30, until=lambda status: status["state"] == "playing")
    return operation


FLOOD = """
import sys, time, zenoh
endpoint, key, seconds, rate = sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4])
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", f'["{endpoint}"]')
session = zenoh.open(config)
print("ready", flush=True)
began, sent = time.monotonic(), 0
while (now := time.monotonic()) - began < seconds:
    while sent < (now - began) * rate:
        session.get(key, lambda reply: None, payload=b'{}', timeout=1.0, target=zenoh.QueryTarget.ALL)
        sent += 1
    time.sleep(0.001)
print(sent / seconds, flush=True)
"""


@pytest.mark.parametrize("command", chosen(["logs", "status", "stop", "seek"], gate=["status", "stop"]))
def test_a_flood_of_questions_does_not_hold_up_a_stop(bus: str, hub: str, logs: Path, command: str) -> None:
    for number in range(scaled(3000, gate=50)):
        write(logs / f"more-{number}.mcap", numbered(1, "a/x", period=MS))
    seconds = scaled(60, gate=3)
    flood = [sys.executable, "-c", FLOOD, hub, f"@riot/r7/agent/{command}", str(seconds), "5000"]
    with agent(logs, bus, hub), subprocess.Popen(flood, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        took = []
        while process.poll() is None:
            began = time.monotonic()
            assert ask_robot(hub, "r7", "stop", who="test")["robot"] == "r7"
            took.append(time.monotonic() - began)
        print(f"stop beside {process.stdout.read().strip()} {command}/s: {max(took):.3f} s at most of {len(took)}")
        assert len(took) >= seconds / 2, took  # each of them was answered


@pytest.mark.load
def test_slow_questions_do_not_hold_up_urgent_ones(bus: str, hub: str, logs: Path) -> None:
    plan = '[[inject]]\ntopic = "a/x"\nfield = "v"\nvalue = 1\n' * 10_000  # is read, then refused as too many
    request = json.dumps({"operation": "0" * 8, "logs": ["log.mcap"], "inject": plan, "on_lost_controller": "continue"})
    took: dict[str, list[float]] = {}
    done, flooded = threading.Event(), []
    with agent(logs, bus, hub), start(hub), Remote(hub, "r7", kind="agent") as remote, open_client(hub) as flooder:

        def ask(command: str, kind: str) -> None:
            began = time.monotonic()
            assert remote.ask(f"agent/{command}", json.dumps({"who": "test"}).encode())["robot"] == "r7"
            took.setdefault(kind, []).append(time.monotonic() - began)

        def flood() -> None:
            while not done.is_set():
                key, every = "@riot/r7/agent/play", zenoh.QueryTarget.ALL
                flooded.extend(flooder.session.get(key, payload=request, timeout=30, target=every))

        urgent = ("pause", "resume", "status")
        for command in urgent * 5:
            ask(command, "alone")
        thread = threading.Thread(target=flood)
        thread.start()
        assert wait_until(lambda: bool(flooded), 60)
        for command in urgent * scaled(100, gate=20):
            ask(command, command)
        ask("stop", "stop")
        done.set()
        thread.join()
    assert all(reply.err and b"are too many" in reply.err.payload.to_bytes() for reply in flooded)
    slowest = {kind: max(times) for kind, times in took.items()}
    print(f"slowest answers beside {len(flooded)} plans of {len(plan)} bytes: {slowest}")
    assert max(slowest.values()) <= 0.5 + slowest["alone"], slowest


def test_an_impostor_is_noticed_even_without_rules(bus: str, hub: str, logs: Path) -> None:
    with agent(logs, bus, hub), open_client(hub) as impostor, start(hub) as operation:
        status = ask_robot(hub, "r7", "status")
        status["operation"]["state"] = "stopped"
        forged = json.dumps({"version": 1, "router": "r7", "command": "x", "result": status}).encode()
        queryable: Any = impostor.session.declare_queryable(
            "@riot/r7/agent/stop", lambda query: query.reply("@riot/r7/agent/stop", forged)
        )
        with pytest.raises(ForgedAnswerError, match="2 answers to one 'agent/stop'"):
            ask_robot(hub, "r7", "stop")
        queryable.undeclare()
        told: list[str] = []
        impostor.session.put("@riot/r7/agent/progress", json.dumps(status))
        operation.follow(
            lambda status, _: told.append(status["state"] if status else "-"),
            give_up=30,
            until=lambda status: status["state"] == "stopped",
        )
        assert set(told) <= {"stopping", "stopped", "playing"}
        assert fleet(hub, "status", "r7")["operation"]["state"] == "stopped", (
            "by the first stop, not by what was forged"
        )


def test_a_forged_answer_without_the_agent_is_not_believed(bus: str, hub: str, logs: Path) -> None:
    with open_client(hub) as impostor:
        with agent(logs, bus, hub), start(hub) as operation:
            status = ask_robot(hub, "r7", "status")
        forged = json.dumps({"version": 1, "router": "r7", "command": "x", "result": status}).encode()
        queryable: Any = impostor.session.declare_queryable(
            "@riot/r7/agent/**", lambda query: query.reply(query.key_expr, forged)
        )
        with RemoteOperation(hub, "r7") as other:
            status["operation"]["id"] = other.operation
            forged = json.dumps({"version": 1, "router": "r7", "command": "x", "result": status}).encode()
            with pytest.raises(ForgedAnswerError, match="does not prove to come from r7"):
                other.begin("play", {"logs": ["log.mcap"]})
        queryable.undeclare()
    assert operation.operation != other.operation


def test_nobody_can_be_present_in_place_of_the_controller(bus: str, hub: str, logs: Path) -> None:
    with agent(logs, bus, hub) as robot, open_client(hub) as impostor:
        with start(hub) as operation:
            key = f"@riot/r7/agent/controller/{operation.operation}"
        nonces: list[bytes] = []

        def lie(query: zenoh.Query) -> None:
            with query:
                nonces.append(query.payload.to_bytes() if query.payload else b"")
                query.reply(query.key_expr, prove(new_secret(), "controller", nonces[-1].decode()))

        queryable: Any = impostor.session.declare_queryable(key, lie)
        token: Any = impostor.session.liveliness().declare_token(key)
        robot.expect("play stopped: the controller was lost for 2 s")
        assert len(nonces) == len(set(nonces)) > 0
        queryable.undeclare()
        token.undeclare()


def test_secrets_are_in_nothing_that_others_read(bus: str, hub: str, logs: Path) -> None:
    with agent(logs, bus, hub) as robot, open_client(hub) as listener:
        seen: list[bytes] = []
        listener.session.declare_subscriber("@riot/**", lambda sample: seen.append(sample.payload.to_bytes()))
        with start(hub) as operation:
            assert wait_until(lambda: len(seen) > 2, 60)
            secret = operation._secret
            texts = [json.dumps(ask_robot(hub, "r7", name)) for name in ("status", "logs")]
        robot.expect("play stopped")
    assert operation.operation in texts[0]
    assert secret not in "".join([*texts, *robot.out, *robot.err, *(each.decode() for each in seen)])


def test_the_rules_let_each_role_do_what_it_needs(bus: str, logs: Path, tmp_path: Path) -> None:
    with secured(tmp_path, new_rules()) as router:
        hub = router.locators[0]
        options = options_of("agent", tmp_path)
        with agent(logs, bus, hub, *options) as robot:
            assert ask_robot(hub, "r7", "status", config=login("viewer"))["busy"] is False
            assert ask_robot(hub, "r7", "logs", config=login("viewer"))["count"] >= 0
            with start(hub, config=login("controller")) as operation:
                ask_robot(hub, "r7", "pause", config=login("controller"), who="alice")
                end = operation.follow(lambda *_: None, give_up=30, until=lambda status: status["state"] == "paused")
                assert end["state"] == "paused"
            robot.expect("play stopped: the controller was lost")


def test_the_rules_keep_a_viewer_from_playing_the_robot(bus: str, logs: Path, tmp_path: Path) -> None:
    with secured(tmp_path, new_rules()) as router:
        hub = router.locators[0]
        options = options_of("agent", tmp_path)
        with agent(logs, bus, hub, *options), open_client(hub, config=login("viewer")) as viewer:
            asked: list[str] = []
            things: list[Any] = [
                viewer.session.declare_queryable("@riot/r7/agent/**", lambda query: asked.append(str(query.key_expr))),
                viewer.session.liveliness().declare_token(ALL_AGENTS.replace("*", "r7", 1).replace("*", "0" * 32)),
            ]
            with start(hub, config=login("controller")) as operation:
                viewer.session.put("@riot/r7/agent/progress", b"{}")
                things.append(
                    viewer.session.declare_queryable(
                        f"@riot/r7/agent/controller/{operation.operation}", lambda query: asked.append("presence")
                    )
                )
                for _ in range(5):
                    ask_robot(hub, "r7", "status", config=login("controller"))
                assert ask_robot(hub, "r7", "stop", config=login("controller"))["robot"] == "r7"
            assert asked == []
            for each in things:
                each.undeclare()


def test_a_question_that_nobody_ends_holds_nobody_up(bus: str, hub: str, logs: Path) -> None:
    kept: list[zenoh.Query] = []
    with agent(logs, bus, hub), open_client(hub) as other:
        queryable: Any = other.session.declare_queryable("@riot/r7/agent/status", kept.append)
        done = threading.Event()

        def ask() -> None:
            ask_robot(hub, "r7", "status")
            done.set()

        threading.Thread(target=ask, daemon=True).start()
        assert done.wait(15), "it would have waited for the whole 20 s"
        kept.clear()
        queryable.undeclare()


def test_proofs_are_for_one_text_one_role_and_one_question() -> None:
    secret = new_secret()
    assert prove(secret, "agent", "a") != prove(secret, "controller", "a")
    assert prove(secret, "agent", "a") != prove(new_secret(), "agent", "a")
    assert not is_proved({"proof": 3}, secret, "1")
    assert not is_proved({}, secret, "1")
