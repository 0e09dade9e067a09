"""`riot bridge mavlink` that is its own router, between real sockets and real Zenoh clients."""

from __future__ import annotations

import json
import queue
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from riot_bus.log.reader import LogReader
from riot_bus.vocabulary.message import Message, Qos
from riot_bus.zenoh.client import open_client
from riot_bus.zenoh.session import free_endpoint, wait_until
from tests.integration.mavlink_bridge import WAIT_S, MavlinkBridgeProcess, UdpEnd
from tests.integration.router_process import riot
from tests.unit.riot_bus_bridges.mavlink.frames import frame_of, unknown_frame

pytestmark = pytest.mark.integration

VEHICLE, GROUND = (1, 1), (255, 190)
PATCH = '[[inject]]\ntopic = "mavlink_raw/fc/1/1/ATTITUDE"\nfield = "roll"\nvalue = 7.0\n'


class Bench:
    """An autopilot's and a ground station's socket, with one process between them."""

    def __init__(self, stack: ExitStack, *options: str) -> None:
        self.ground = stack.enter_context(UdpEnd())
        links = ["system/fc=udpin:127.0.0.1:0", f"unit/gcs=udpout:127.0.0.1:{self.ground.port}"]
        self.bridge = stack.enter_context(MavlinkBridgeProcess(None, links, *options))
        self.vehicle = stack.enter_context(UdpEnd(self.bridge.address("fc")))

    def meet(self) -> None:
        """Let both ends know each other."""
        self.vehicle.send(frame_of(source=VEHICLE, sequence=255).raw)
        assert self.ground.take(1)
        self.ground.send(frame_of(source=GROUND, sequence=255).raw)
        assert self.vehicle.take(1)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as entered:
        yield entered


def attitudes(count: int, **fields: float) -> list[bytes]:
    return [
        frame_of("ATTITUDE", source=VEHICLE, sequence=number % 256, time_boot_ms=number + 1, **fields).raw
        for number in range(count)
    ]


def test_options_that_are_wrong_are_named(tmp_path: Path) -> None:
    link = "--link=udpin:127.0.0.1:0"
    nobody = free_endpoint()
    for arguments, part in (
        (["--segment=a=tcp/127.0.0.1:1", link, "--intercept=HEARTBEAT"], "--intercept is for a bridge that is its own"),
        ([f"--endpoint={nobody}", link, "--record=x.mcap"], "leave --endpoint out"),
        (["--listen=a=tcp/127.0.0.1:0", link, "--cfg=x=1"], "--cfg is for a router elsewhere"),
        (["--listen=a=tcp/127.0.0.1:0", "--link=b=udpin:127.0.0.1:0"], "no segment 'b'"),
        (["--listen=a", link], "is not a segment and its endpoints"),
        ([link], "to which segment"),
    ):
        code, out, err = riot("bridge", "mavlink", *arguments, cwd=tmp_path)
        assert (code, out) == (2, ""), err
        assert part in err


def test_frames_cross_as_they_are(stack: ExitStack) -> None:
    bench = Bench(stack)
    bench.meet()
    telemetry = [frame_of("ATTITUDE", source=VEHICLE, sequence=number, roll=number / 7) for number in range(200)]
    unknown = unknown_frame(source=VEHICLE, sequence=200)
    old = frame_of("PARAM_VALUE", source=VEHICLE, sequence=201, version=1, param_id="RTL_ALT")
    wrong = telemetry[0].raw[:-1] + bytes([telemetry[0].raw[-1] ^ 1])
    bench.vehicle.send(*(frame.raw for frame in telemetry), unknown.raw, b"junk", wrong, old.raw)
    assert bench.ground.take(202) == [*telemetry, unknown, old]
    for target, arrives in (((1, 1), True), ((1, 0), True), ((0, 0), True), ((42, 1), False), ((1, 100), False)):
        command = frame_of("COMMAND_LONG", source=GROUND, target=target, command=400)
        bench.ground.send(command.raw, frame_of("SYSTEM_TIME", source=GROUND).raw)
        found = bench.vehicle.take(2 if arrives else 1)
        assert [frame.message_id for frame in found] == [76, 2][not arrives :]
    assert bench.ground.get(0.2) is None  # nothing comes back
    status = bench.bridge.end()
    vehicle, ground = status["links"]["fc"], status["links"]["gcs"]
    assert (vehicle["in"], vehicle["bad_crc"], vehicle["unknown"]) == (203, 1, 1)
    assert (ground["in"], ground["out"], vehicle["out"]) == (11, 203, 9)
    assert (status["segments"]["unit"]["from_bus"], status["segments"]["system"]["from_bus"]) == (203, 11)
    counts = bench.bridge.router["counts"]
    assert sum(row["received"] for row in counts.values()) == 214
    assert sum(row["forwarded"] for row in counts.values()) == 214


def test_a_field_is_injected_and_counted(stack: ExitStack, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PATCH)
    bench = Bench(stack, f"--inject={plan}")
    bench.meet()
    bench.vehicle.send(*attitudes(300, pitch=2.0))
    assert [frame.raw for frame in bench.ground.take(300)] == attitudes(300, pitch=2.0, roll=7.0)
    bench.bridge.end()
    rows = bench.bridge.router["counts"]
    row = rows["mavlink_raw/fc/1/1/ATTITUDE"]
    assert (row["received"], row["changed"], row["forwarded"], row["lost"]) == (300, 300, 300, 0)


def test_components_on_the_bus_see_and_send_frames(stack: ExitStack, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PATCH)
    bench = Bench(stack, f"--inject={plan}")
    bench.meet()
    heard: dict[str, queue.Queue[Message]] = {"system": queue.Queue(), "unit": queue.Queue()}
    clients = {}
    for name, messages in heard.items():
        clients[name] = open_client(bench.bridge.endpoint(name))
        stack.callback(clients[name].close)
        clients[name].subscribe("mavlink_raw/**", messages.put)
    (sent,), (changed,) = attitudes(1), attitudes(1, roll=7.0)

    def both_heard() -> bool:
        bench.vehicle.send(sent)
        assert bench.ground.take(1)[0].raw == changed
        return all(not messages.empty() for messages in heard.values())

    assert wait_until(both_heard, WAIT_S, interval=0.02)
    assert heard["system"].get().payload == sent
    assert heard["unit"].get().payload == changed
    key, raw = "mavlink_raw/tester/9/9/HEARTBEAT", frame_of(source=(9, 9), sequence=3).raw
    clients["unit"].put(Message(0, key, raw, qos=Qos(congestion="block")))
    assert [bench.ground.take(1)[0].raw, bench.vehicle.take(1)[0].raw] == [raw, raw]


def test_plans_come_and_go_without_a_loss(stack: ExitStack, tmp_path: Path) -> None:
    plan, drop = tmp_path / "plan.toml", tmp_path / "drop.toml"
    plan.write_text(PATCH)
    drop.write_text(PATCH.replace("value = 7.0", "value = 8.0\nfirst = 0"))  # which needs a look at each
    bench = Bench(stack)
    bench.meet()
    router = f"--endpoint={bench.bridge.endpoint('system')}"
    rolls = set()
    for words in (["load", str(plan)], ["load", str(drop)], ["clear"], ["load", str(plan)]):
        bench.vehicle.send(*attitudes(100))
        code, _, err = riot("ctl", router, "plan", *words)
        assert code == 0, err
        bench.vehicle.send(*attitudes(100))
        frames = bench.ground.take(200)
        assert [frame.sequence for frame in frames] == [*range(100), *range(100)]
        rolls.add(frames[-1].raw[14:18])
    assert len(rolls) == 3  # 7, 8, and none
    bench.bridge.end()
    rows = bench.bridge.router["counts"]
    row = rows["mavlink_raw/fc/1/1/ATTITUDE"]
    assert (row["received"], row["forwarded"]) == (800, 800)
    assert 300 <= row["changed"] <= 600


def test_interceptors_drop_delay_and_double(stack: ExitStack) -> None:
    bench = Bench(
        stack,
        "--interceptor=drop select='ATTITUDE where roll > 1'",
        "--interceptor=delay seconds=0.1 select=SYS_STATUS",
        "--interceptor=duplicate copies=1 select=COMMAND_LONG",
    )
    bench.meet()
    late = frame_of("SYS_STATUS", source=VEHICLE)
    bench.vehicle.send(late.raw, *attitudes(2, roll=2.0), *attitudes(2))
    assert [frame.raw for frame in bench.ground.take(3)] == [*attitudes(2), late.raw]
    command = frame_of("COMMAND_LONG", source=GROUND, target=VEHICLE, command=400)
    bench.ground.send(command.raw)
    assert bench.vehicle.take(2) == [command, command]
    bench.bridge.end()
    rows = bench.bridge.router["counts"]
    assert rows["mavlink_raw/fc/1/1/ATTITUDE"]["dropped"] == 2
    assert rows["mavlink_raw/gcs/255/190/COMMAND_LONG"]["added"] == 1


def test_an_interceptor_that_blocks_is_bypassed(stack: ExitStack, tmp_path: Path) -> None:
    hang = tmp_path / "hang.py"
    hang.write_text(
        "import threading\n"
        "class Hang:\n"
        "    topics = 'mavlink_raw/*/*/*/ATTITUDE'\n"
        "    def message(self, event):\n"
        "        if event.index == 5:\n"
        "            threading.Event().wait(60)\n"
    )
    bench = Bench(stack, f"--interceptor={hang}")
    bench.meet()
    bench.vehicle.send(*attitudes(20))
    other = frame_of("SYSTEM_TIME", source=GROUND)
    bench.ground.send(other.raw)
    assert bench.vehicle.take(1) == [other]  # links do not wait for it
    assert [frame.raw for frame in bench.ground.take(20)] == attitudes(20)


def test_what_waits_for_an_interceptor_goes_out_before_the_end(stack: ExitStack, tmp_path: Path) -> None:
    slow = tmp_path / "slow.py"
    slow.write_text(
        "import threading\nclass Slow:\n    def message(self, event):\n        threading.Event().wait(0.002)\n"
    )
    bench = Bench(stack, f"--interceptor={slow}")
    bench.meet()
    sent = attitudes(600)
    bench.vehicle.send(*sent)
    bench.ground.take(1)
    links = bench.bridge.end()["links"]
    taken = links["fc"]["in"] - 1  # but for the heartbeat by which they have met
    assert links["gcs"]["out"] - 1 == taken > 1
    assert [frame.raw for frame in bench.ground.take(taken - 1)] == sent[1:taken]


@pytest.mark.parametrize("segments", [["system", "unit"], ["only"]])
def test_what_passes_is_recorded(stack: ExitStack, tmp_path: Path, segments: list[str]) -> None:
    log = tmp_path / "run.mcap"
    ground = stack.enter_context(UdpEnd())
    links = [f"{segments[0]}/fc=udpin:127.0.0.1:0", f"{segments[-1]}/gcs=udpout:127.0.0.1:{ground.port}"]
    listen = [f"--listen={name}=tcp/127.0.0.1:0" for name in segments]
    bridge = stack.enter_context(MavlinkBridgeProcess(None, links, *listen, f"--record={log}"))
    vehicle = stack.enter_context(UdpEnd(bridge.address("fc")))
    vehicle.send(*attitudes(50))
    assert [frame.raw for frame in ground.take(50)] == attitudes(50)
    bridge.end()
    with LogReader(log) as reader:
        recorded = [message.payload for message in reader.messages() if message.key.endswith("/ATTITUDE")]
    assert recorded == attitudes(50)


def test_a_program_behind_it_gives_the_exit_code(tmp_path: Path) -> None:
    program = "import socket, sys; socket.create_connection(('127.0.0.1', int(sys.argv[1]))); sys.exit(7)"
    listen = ["--listen=system=tcp/127.0.0.1:0", "--listen=unit=tcp/127.0.0.1:0"]
    link = "--link=unit/x=tcpin:127.0.0.1:0"
    code, out, _ = riot("bridge", "mavlink", *listen, link, "--", sys.executable, "-c", program, "{port}", cwd=tmp_path)
    assert code == 7, out


def test_links_show_in_the_graph(stack: ExitStack) -> None:
    bench = Bench(stack)
    bench.meet()
    graph: dict[str, list[dict[str, Any]]] = {}

    def complete() -> bool:
        code, out, err = riot("graph", "-e", bench.bridge.endpoint("unit"), "--format=json")
        assert code == 0, err
        graph.update(json.loads(out))
        return len([each for each in graph["edges"] if "traffic" in each["evidence"]]) == 2

    assert wait_until(complete, WAIT_S)
    assert [(each["segment"], each["name"], each["mode"], each["nodes"]) for each in graph["components"]] == [
        ("system", "fc", "link", ["1/1"]),
        ("unit", "gcs", "link", ["255/190"]),
    ]
    heard, told = "mavlink_raw/fc/1/1/HEARTBEAT", "mavlink_raw/gcs/255/190/HEARTBEAT"
    assert {(each["topic"], each["role"], each["zid"], each["node"]) for each in graph["edges"]} == {
        (heard, "publishes", "system/fc", "1/1"),
        (heard, "subscribes", "unit/gcs", ""),
        (told, "publishes", "unit/gcs", "255/190"),
        (told, "subscribes", "system/fc", ""),
    }
    assert graph["unknown"] == []
