"""`riot agent` on one side, `riot fleet play` on the other, and the link between them."""

from __future__ import annotations

import json
import shlex
import signal
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from riot_bus.log.reader import read_log
from riot_bus.vocabulary.message import Message
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import free_endpoint, wait_until
from riot_bus_conformance.security import make_certificates
from tests.integration.access_tools import write_private
from tests.integration.agent_tools import Cable, Process, agent, fleet
from tests.integration.play_tools import BEGIN, MS, Listener, numbered, write
from tests.integration.router_process import riot
from tests.integration.zenoh_process import ZenohProcess
from tests.tiers import chosen

pytestmark = pytest.mark.integration

COUNT = 120
SET = '[[inject]]\ntopic = "a/x"\nfield = "v"\nvalue = -1\nfirst = 2\nlast = 3\n'


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
    """A log of six seconds, and a short one."""
    folder = tmp_path / "logs"
    folder.mkdir()
    write(folder / "log.mcap", numbered(COUNT, "a/x", period=50 * MS))
    write(folder / "short.mcap", numbered(10, "a/x", period=MS))
    return folder


def expected(count: int = COUNT) -> list[bytes]:
    return [b'{"v": %d}' % number for number in range(count)]


def playing(endpoint: str, *arguments: str) -> Process:
    return Process("fleet", "play", "r7", *arguments, f"--endpoint={endpoint}", "--format=json", "--wait=20")


def test_a_log_is_replayed_while_the_link_to_the_controller_is_cut_and_restored(bus: str, hub: str, logs: Path) -> None:
    with (
        Cable(hub) as cable,
        Listener(bus, "a/*") as listener,
        agent(logs, bus, cable.endpoint) as robot,
        playing(hub, "log.mcap", "--grace=60") as controller,
    ):
        listener.wait(20)
        cable.cut()
        robot.expect("broke")
        before = len(listener.messages)
        assert len(listener.wait(before + 20)) >= before + 20
        cable.restore()
        robot.expect("is back")
        assert controller.end() == 0, controller.err
        (line,) = controller.out
        assert listener.payloads(COUNT) == expected()
    status = json.loads(line)
    assert (status["state"], status["result"]["published"], status["lost"]) == ("ended", COUNT, 0)


@pytest.mark.parametrize("side", chosen(["robot", "controller"], gate=["controller"]))
def test_a_controller_that_is_away_for_long_makes_the_robot_pause_and_then_go_on(
    bus: str, hub: str, logs: Path, side: str
) -> None:
    with Cable(hub) as cable, Listener(bus, "a/*") as listener:
        ends = {"robot": hub, "controller": hub, side: cable.endpoint}
        with (
            agent(logs, bus, ends["robot"]) as robot,
            playing(ends["controller"], "log.mcap", "--grace=1", "--on-lost-controller=pause") as controller,
        ):
            listener.wait(10)
            cable.cut()
            robot.expect("paused: the controller was lost for 1 s")
            assert wait_until(lambda: local(bus)["state"] == "paused", 60, interval=0.1)
            held = len(listener.messages)
            assert held < COUNT
            cable.restore()
            robot.expect("resumed: the controller is back")
            assert controller.end() == 0, controller.err
            assert listener.payloads(COUNT) == expected()


def local(bus: str) -> dict[str, Any]:
    """What somebody at the robot sees."""
    code, out, err = riot("ctl", "play", "status", f"--endpoint={bus}", "--format=json")
    assert code == 0, err
    found: dict[str, Any] = json.loads(out)
    return found


def test_a_lost_controller_stops_the_robot_and_frees_it(bus: str, hub: str, logs: Path) -> None:
    with Listener(bus, "a/*") as listener, agent(logs, bus, hub) as robot:
        with playing(hub, "log.mcap", "--grace=1", "--rate=0.5") as controller:
            listener.wait(5)
            controller.process.kill()
            robot.expect("play stopped: the controller was lost for 1 s")
        status = fleet(hub, "status", "r7")
        assert not status["busy"]
        assert (status["operation"]["state"], status["operation"]["published"] < COUNT) == ("stopped", True)
        listener.clear()
        with playing(hub, "short.mcap") as controller:
            assert controller.end() == 0, controller.err
        assert listener.payloads(10) == expected(10)


def test_a_robot_may_go_on_without_a_controller(bus: str, hub: str, logs: Path) -> None:
    with Listener(bus, "a/*") as listener, agent(logs, bus, hub) as robot:
        with playing(hub, "log.mcap", "--grace=0", "--on-lost-controller=continue") as controller:
            listener.wait(5)
            controller.process.kill()
        robot.expect("play ended")
        assert listener.payloads(COUNT) == expected()
        listener.clear()
        with playing(hub, "short.mcap", "--detach") as controller:
            assert controller.end() == 0, controller.err
        assert listener.payloads(10) == expected(10)
        err = fleet(hub, "play", "r7", "short.mcap", "--detach", "--on-lost-controller=stop", code=2)
        assert "exclude each other" in err


def test_a_controller_gives_up_within_a_bound_and_says_so(bus: str, hub: str, logs: Path) -> None:
    with (
        Cable(hub) as cable,
        Listener(bus, "a/*") as listener,
        agent(logs, bus, hub) as robot,
        playing(cable.endpoint, "log.mcap", "--grace=1", "--give-up=3", "--rate=0.2") as controller,
    ):
        listener.wait(3)
        cable.cut()
        robot.expect("play stopped: the controller was lost")
        assert controller.end() == 4
        assert "r7 was not heard for 3 s" in "".join(controller.err)


@pytest.mark.parametrize("side", chosen(["robot", "controller"], gate=["robot"]))
def test_a_link_that_hangs_is_noticed_and_hangs_nobody(bus: str, hub: str, logs: Path, side: str) -> None:
    with Cable(hub) as cable, Listener(bus, "a/*") as listener:
        ends = {"robot": hub, "controller": hub, side: cable.endpoint}
        with (
            agent(logs, bus, ends["robot"]) as robot,
            playing(ends["controller"], "log.mcap", "--grace=2", "--give-up=4", "--rate=0.1") as controller,
        ):
            listener.wait(3)
            cable.freeze()
            robot.expect("play stopped: the controller was lost for 2 s")
            assert controller.end() == 4
            assert "r7 was not heard for " in "".join(controller.err)
            cable.cut()
            cable.restore()
            listener.clear()
            assert wait_until(lambda: riot("fleet", "status", "r7", f"--endpoint={hub}")[0] == 0, 60)
            with playing(hub, "short.mcap") as again:
                assert again.end() == 0, again.err
            assert listener.payloads(10) == expected(10)


def test_an_interrupted_controller_stops_the_robot(bus: str, hub: str, logs: Path) -> None:
    with Listener(bus, "a/*") as listener, agent(logs, bus, hub):
        with playing(hub, "log.mcap", "--rate=0.2") as controller:
            listener.wait(3)
            controller.process.send_signal(signal.SIGINT)
            assert controller.end() == 130, controller.err
            assert json.loads(controller.out[0])["state"] == "stopped"
        assert not fleet(hub, "status", "r7")["busy"]


def test_an_interrupted_controller_without_a_link_leaves_within_a_bound(bus: str, hub: str, logs: Path) -> None:
    with (
        Cable(hub) as cable,
        Listener(bus, "a/*") as listener,
        agent(logs, bus, hub) as robot,
        playing(cable.endpoint, "log.mcap", "--grace=2", "--rate=0.2") as controller,
    ):
        listener.wait(3)
        cable.cut()
        controller.process.send_signal(signal.SIGINT)
        assert controller.end() == 4
        assert "was not heard" in "".join(controller.err)
        robot.expect("play stopped: the controller was lost")


def test_a_robot_is_steered_and_does_one_thing_at_a_time(bus: str, hub: str, logs: Path) -> None:
    with Listener(bus, "a/*") as listener, agent(logs, bus, hub), playing(hub, "log.mcap", "-p") as controller:
        assert wait_until(lambda: (fleet(hub, "status", "r7")["operation"] or {}).get("state") == "paused", 60)
        (robot,) = fleet(hub, "robots")["robots"]
        assert (robot["name"], robot["agents"], robot["status"]["busy"]) == ("r7", 1, True)
        err = fleet(hub, "play", "r7", "short.mcap", code=4)
        assert "r7 is busy: play of log.mcap for " in err
        assert "paused" in err
        assert fleet(hub, "seek", "r7", "5.9")["operation"]["position"] == 5.9
        assert fleet(hub, "rate", "r7", "2")["operation"]["rate"] == 2.0
        assert "is not a number" in fleet(hub, "rate", "r7", "nan", code=2)
        assert listener.messages == []
        fleet(hub, "resume", "r7")
        assert controller.end() == 0, controller.err
        assert listener.payloads(2) == expected()[118:]
        assert "no operation is running" in fleet(hub, "pause", "r7", code=2)
        assert fleet(hub, "stop", "r7")["busy"] is False


def test_progress_is_told_to_whoever_listens(bus: str, hub: str, logs: Path) -> None:
    with Listener(bus, "a/*"), Listener(hub, "@riot/*/agent/progress") as news, agent(logs, bus, hub) as robot:
        with playing(hub, "log.mcap", "--rate=2") as controller:
            assert controller.end() == 0, controller.err
        robot.expect("play ended")
        assert wait_until(lambda: json.loads(news.messages[-1].payload)["busy"] is False, 60)
        told = [json.loads(each.payload)["operation"] for each in news.messages]
    states = [each["state"] for each in told]
    order = ["starting", "waiting", "ready", "playing", "stopping", "ended"]
    assert states == sorted(states, key=order.index)
    assert {"playing", "ended"} <= set(states)
    assert told[-1]["result"]["published"] == COUNT
    assert ["result" in each for each in told].count(True) == 1
    assert [each["published"] for each in told if "published" in each] == sorted(
        each["published"] for each in told if "published" in each
    )


def test_somebody_else_may_stop_it(bus: str, hub: str, logs: Path) -> None:
    with Listener(bus, "a/*") as listener, agent(logs, bus, hub), playing(hub, "log.mcap", "--rate=0.2") as controller:
        listener.wait(1)
        fleet(hub, "stop", "r7")
        assert controller.end() == 4
        assert "ended before its end: stopped by " in "".join(controller.err)


def test_injections_travel_along(bus: str, hub: str, logs: Path, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(SET)
    with Listener(bus, "a/*") as listener, agent(logs, bus, hub):
        with playing(hub, "short.mcap", f"--inject={plan}") as controller:
            assert controller.end() == 0, controller.err
        values = [json.loads(each)["v"] for each in listener.payloads(10)]
    assert values == [0, 1, -1, -1, *range(4, 10)]


def test_what_a_robot_refuses(bus: str, hub: str, logs: Path, tmp_path: Path) -> None:
    write(tmp_path / "outside.mcap", numbered(1, "a/x"))
    write(logs / "admin.mcap", [Message(BEGIN, "@/x/router/config/mode", b"1")])
    (logs / "link.mcap").symlink_to(tmp_path / "outside.mcap")
    plan = tmp_path / "plan.toml"
    with agent(logs, bus, hub):
        for name in ("../outside.mcap", str(tmp_path / "outside.mcap"), "link.mcap"):
            assert "is outside of the folder of logs" in fleet(hub, "play", "r7", name, code=2)
        err = fleet(hub, "play", "r7", "lgo.mcap", code=2)
        assert "No such file" in err
        assert "did you mean 'log.mcap'" in err
        assert "is not published from afar" in fleet(hub, "play", "r7", "admin.mcap", code=2)
        assert "is not published from afar" in fleet(hub, "play", "r7", "log.mcap", "-m", "a/x:=@/x/y", code=2)
        assert "the logs have no topic 'a/y'" in fleet(hub, "play", "r7", "log.mcap", "--topics=a/y", code=2)
        plan.write_text('[[inject]]\ntopic = "a/x"\nfault = "duplicate"\ncopies = 1000000\n')
        assert "too much for a robot" in fleet(hub, "play", "r7", "log.mcap", f"--inject={plan}", code=2)
        assert "no agent 'r8' answers" in fleet(hub, "play", "r8", "log.mcap", code=4)
        assert fleet(hub, "status", "r7")["busy"] is False


def test_nonsense_is_answered(bus: str, hub: str, logs: Path) -> None:
    good = {"operation": "0" * 16, "logs": ["short.mcap"], "on_lost_controller": "continue"}
    cases: list[tuple[str, bytes, str]] = [
        ("play", b"", "operation: Field required"),
        ("play", b"\xff\x00", "Invalid JSON"),
        ("play", b"[" * 10_000, "Invalid JSON"),
        ("play", json.dumps({**good, "interceptors": ["x.py"]}).encode(), "unknown argument 'interceptors'"),
        ("play", json.dumps({**good, "definitions": ["/etc/passwd"]}).encode(), "unknown argument 'definitions'"),
        ("play", json.dumps({**good, "rate": "fast"}).encode(), "rate: "),
        ("play", json.dumps({**good, "rate": -1}).encode(), "rate: "),
        ("play", json.dumps({**good, "inject": "not toml"}).encode(), "not a TOML file"),
        ("play", json.dumps({**good, "logs": ["a\nb"]}).encode(), "is not a path"),
        ("play", json.dumps({**good, "on_lost_controller": "stop"}).encode(), "needs one that stays"),
        ("play", b"x" * (2 << 20), "bytes are too many"),
        ("logs", b'{"query": "nonsense"}', "'nonsense' is not a condition"),
        ("seek", b"{}", "the argument 'time' is not a number"),
        ("pause", b'{"whom": 1}', "unknown argument 'whom'"),
        ("dance", b"{}", "no command 'agent/dance'"),
    ]
    with agent(logs, bus, hub), open_client(hub) as client:
        for command, payload, message in cases:
            (reply,) = client.session.get(f"@riot/r7/agent/{command}", payload=payload, timeout=60)
            assert reply.ok is None
            assert reply.err is not None
            found = json.loads(reply.err.payload.to_bytes())
            assert message in found["message"], (command, found)
            assert found["exit_code"] == 2
        replies = [reply.ok for reply in client.session.get("@riot/*/agent/*", timeout=60, payload=b"{}")]
        answered = {json.loads(ok.payload.to_bytes())["command"] for ok in replies if ok is not None}
        assert answered == {"agent/status", "agent/logs"}  # what changes nothing


def test_logs_are_listed(bus: str, hub: str, logs: Path) -> None:
    (logs / "broken.mcap").write_text("nothing")
    with agent(logs, bus, hub):
        assert wait_until(lambda: fleet(hub, "logs", "r7")["complete"], 60)
        found = fleet(hub, "logs", "r7")
        assert [(each["name"], each["messages"]) for each in found["logs"]] == [
            ("log.mcap", COUNT), ("short.mcap", 10), ("broken.mcap", 0)
        ]  # fmt: skip
        assert found["logs"][2]["problem"] == "not an MCAP file"
        write(logs / "new.mcap", numbered(3, "b"))
        assert wait_until(lambda: fleet(hub, "logs", "r7", "topic=b")["count"] == 1, 60)
        assert fleet(hub, "logs", "r7", "min-duration=1", "lossless")["count"] == 1


def test_the_fleet_router_may_come_later(bus: str, logs: Path) -> None:
    with ZenohProcess("router") as process:
        (endpoint,) = process.locators[:1]
    with agent(logs, bus, endpoint, wait=False) as robot:
        robot.expect("waiting for the fleet router: nobody answers")
        with ZenohProcess("router", listen__endpoints=[endpoint]), Listener(bus, "a/*") as listener:
            robot.expect("connected to the fleet router")
            with playing(endpoint, "short.mcap") as controller:
                assert controller.end() == 0, controller.err
            assert listener.payloads(10) == expected(10)
        robot.process.send_signal(signal.SIGTERM)
        assert robot.end() == 0


def test_a_robot_without_a_bus_says_so(hub: str, logs: Path) -> None:
    with ZenohProcess("router") as process:
        (nowhere,) = process.locators[:1]
    with agent(logs, nowhere, hub):
        err = fleet(hub, "play", "r7", "log.mcap", code=4)
        assert f"nobody answers at {nowhere}" in err


def test_an_agent_that_is_killed_is_noticed(bus: str, hub: str, logs: Path) -> None:
    with (
        Listener(bus, "a/*") as listener,
        agent(logs, bus, hub) as robot,
        playing(hub, "log.mcap", "--rate=0.2", "--give-up=60") as controller,
    ):
        listener.wait(2)
        robot.process.kill()
        robot.end()
        with agent(logs, bus, hub):
            assert controller.end() == 4
            assert "r7 no longer knows of it: its agent was started anew" in "".join(controller.err)


def test_an_agent_that_ends_stops_what_it_plays(bus: str, hub: str, logs: Path) -> None:
    with (
        Listener(bus, "a/*") as listener,
        agent(logs, bus, hub) as robot,
        playing(hub, "log.mcap", "--rate=0.2", "--give-up=5") as controller,
    ):
        listener.wait(2)
        robot.process.send_signal(signal.SIGTERM)
        assert robot.end() == 0
        assert controller.end() == 4


@pytest.mark.parametrize("hanging", chosen(["fleet", "bus"], gate=["bus"]))
def test_an_agent_ends_in_time_though_a_link_hangs(bus: str, hub: str, logs: Path, hanging: str) -> None:
    with Cable(hub if hanging == "fleet" else bus) as cable, Listener(bus, "a/*") as listener:
        ends = {"fleet": hub, "bus": bus, hanging: cable.endpoint}
        with (
            agent(logs, ends["bus"], ends["fleet"]) as robot,
            playing(hub, "log.mcap", "--rate=0.2", "--give-up=5"),
        ):
            listener.wait(2)
            cable.freeze()
            robot.process.send_signal(signal.SIGTERM)
            assert robot.end() == 0, robot.err


def test_two_agents_of_one_name_do_nothing(bus: str, hub: str, logs: Path) -> None:
    with agent(logs, bus, hub), agent(logs, bus, hub) as second:
        assert any("another agent is called 'r7' too" in line for line in second.err)
        (robot,) = fleet(hub, "robots")["robots"]
        assert robot["agents"] == 2
        assert "2 agents are called 'r7'" in fleet(hub, "play", "r7", "log.mcap", code=4)


def test_an_agent_may_be_allowed_less(bus: str, hub: str, logs: Path) -> None:
    with agent(logs, bus, hub, "--allow=nothing"):
        err = fleet(hub, "play", "r7", "log.mcap", code=2)
        assert "this agent may not play" in err
        assert fleet(hub, "logs", "r7")["count"] >= 0


def test_a_robot_records_and_plays_what_it_has_recorded(bus: str, hub: str, logs: Path) -> None:
    with open_client(bus) as source, Listener(bus, "a/*") as listener, agent(logs, bus, hub):
        with Process(
            "fleet", "record", "r7", "a/**", "-o", "new.mcap", f"--endpoint={hub}", "--format=json"
        ) as recorder:
            assert wait_until(lambda: (fleet(hub, "status", "r7")["operation"] or {}).get("state") == "recording", 60)
            for number in range(10):
                source.put(Message(BEGIN, "a/x", b'{"v": %d}' % number))
            listener.wait(10)
            assert "is busy: record of new.mcap" in fleet(hub, "play", "r7", "log.mcap", code=4)
            assert "has no command 'seek'" in fleet(hub, "seek", "r7", "1", code=2)
            assert wait_until(lambda: fleet(hub, "status", "r7")["operation"]["recorded"] == 10, 60)
            recorder.process.send_signal(signal.SIGINT)
            assert recorder.end() == 130, recorder.err
            status = json.loads(recorder.out[0])
            assert (status["state"], status["result"]["recorded"], status["result"]["lost"]) == ("stopped", 10, {})
        assert "exists already" in fleet(hub, "record", "r7", "-o", "new.mcap", code=2)
        assert "is outside of" in fleet(hub, "record", "r7", "-o", "../new.mcap", code=2)
        found = fleet(hub, "logs", "r7", "path=*new.mcap", "lossless")
        assert wait_until(lambda: fleet(hub, "logs", "r7", "path=*new.mcap", "lossless")["count"] == 1, 60), found
        listener.clear()
        with playing(hub, "new.mcap") as controller:
            assert controller.end() == 0, controller.err
        assert listener.payloads(10) == expected(10)


def test_a_recording_outlives_its_controller(bus: str, hub: str, logs: Path) -> None:
    with open_client(bus) as source, Listener(bus, "a/*") as listener, agent(logs, bus, hub) as robot:
        with Process("fleet", "record", "r7", "-o", "new.mcap", f"--endpoint={hub}", "--grace=0") as controller:
            assert wait_until(lambda: (fleet(hub, "status", "r7")["operation"] or {}).get("state") == "recording", 60)
            controller.process.kill()
            controller.end()
        source.put(Message(BEGIN, "a/x", b"after"))
        listener.wait(1)
        assert wait_until(lambda: fleet(hub, "status", "r7")["operation"]["recorded"] == 1, 60)
        fleet(hub, "stop", "r7")
        robot.expect("record stopped")
    assert [each.payload for each in read_log(logs / "new.mcap")] == [b"after"]


def test_a_recording_ends_by_itself(bus: str, hub: str, logs: Path) -> None:
    with agent(logs, bus, hub):
        found = fleet(hub, "record", "r7", "-o", "new.mcap", "--duration=1s")
        assert (found["state"], found["result"]["files"]) == ("ended", ["new.mcap"])
    assert read_log(logs / "new.mcap") == ()


def test_a_robot_whose_disk_is_full_does_not_record(bus: str, hub: str, logs: Path) -> None:
    with agent(logs, bus, hub, "--keep-free=1000000TB"):
        assert "are to be kept free" in fleet(hub, "record", "r7", code=4)


def test_the_documented_router_of_a_fleet(bus: str, logs: Path, tmp_path: Path) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "fleet.md").read_text()
    begin = page.index("    [router.segments.fleet]")
    text = textwrap.dedent(page[begin : page.index("Try the rules with each identity")])
    roles = shlex.split(page.partition("    riot agent acl ")[2].partition(" >> riot.toml")[0])
    code, rules, err = riot("agent", "acl", *roles)
    assert code == 0, err
    endpoint = free_endpoint().replace("tcp", "tls")
    (tmp_path / "riot.toml").write_text(text.replace("tls/0.0.0.0:7447", endpoint) + rules)
    write_private(tmp_path / "users.txt", "robot:r\nalice:a\nviewer:v\n")
    make_certificates(tmp_path)
    for ending in ("pem", "key"):
        (tmp_path / f"router.{ending}").rename(tmp_path / f"server.{ending}")

    for user in ("robot", "alice", "viewer"):
        write_private(tmp_path / user, user[0])

    def login(user: str, option: str = "--cfg") -> list[str]:
        return [
            f"{option}=transport/link/tls/root_ca_certificate={tmp_path / 'authority.pem'}",
            f"{option}=transport/auth/usrpwd/user={user}",
            f"{option}=transport/auth/usrpwd/password=@{tmp_path / user}",
        ]

    with Process("router", f"--system={tmp_path / 'riot.toml'}", "--name=fleet", "--no-bypass-watch") as router:
        router.expect("ready: segment fleet tls/")
        with Listener(bus, "a/*") as listener, agent(logs, bus, endpoint, *login("robot", "--fleet-cfg")):
            assert fleet(endpoint, "status", "r7", *login("viewer"))["busy"] is False
            assert "did not answer" in fleet(endpoint, "play", "r7", "short.mcap", *login("viewer"), code=4)
            with playing(endpoint, "short.mcap", *login("alice")) as controller:
                assert controller.end() == 0, controller.err
            assert listener.payloads(10) == expected(10)
